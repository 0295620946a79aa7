"""A whole mission onto a vehicle, verified: upload, read back, compare."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.mission_upload import Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.outcome import Done
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.wait import wait

UPLOAD_TRIES = 3
DOWNLOAD_TRIES = 4


@dataclass(frozen=True, slots=True)
class Placed(Done):
    """How it ended, and what was read back last; None where nothing could be."""

    found: tuple[MissionItem, ...] | None = None


def put(
    ctx: Context, items: tuple[MissionItem, ...], current: int | None = None, tries: int = UPLOAD_TRIES
) -> Procedure[Placed]:
    """Upload, read back, compare; tried again after what another try can cure.

    Ends without failure only if exactly `items` are on the vehicle. `current` is marked as the one to fly.
    """
    ctx.on_vehicle, ctx.flown_from = (), ctx.dialect.first_waypoint_seq
    failure, found = "not tried", None
    for attempt in range(tries):
        if attempt:
            # A vehicle still in the old transfer would take items of the new one into it.
            yield wait(ctx.dialect.upload_timeout_s)
        result: UploadResult = yield Upload(ctx.peer, items, current=current)
        failure = result.text
        if result.outcome is UploadOutcome.REJECTED:
            break
        if result.outcome in (UploadOutcome.DENIED, UploadOutcome.NO_ANSWER):
            continue
        # Also after a time-out: the items may all be there and only the last word lost.
        read = yield from read_back(ctx)
        if read.outcome is not DownloadOutcome.COMPLETE:
            failure = f"{failure}; {read.text}"
            continue
        found = read.items
        gaps = ctx.dialect.differences(items, found)
        if not gaps:
            ctx.on_vehicle = found
            return Placed(None, found)
        failure = f"{failure}; read back: {gaps[0]}"
    return Placed(failure, found)


def read_back(ctx: Context, first: int = 0) -> Procedure[DownloadResult]:
    """The items from `first` on, as the vehicle has them."""
    result: DownloadResult = yield Download(ctx.peer, first=first)
    for _ in range(DOWNLOAD_TRIES - 1):
        if result.outcome is not DownloadOutcome.REFUSED:
            break
        # DENIED while it has not yet given up an upload.
        yield wait(ctx.dialect.upload_timeout_s / (DOWNLOAD_TRIES - 1))
        result = yield Download(ctx.peer, first=first)
    return result
