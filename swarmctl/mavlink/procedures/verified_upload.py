"""A whole mission onto a vehicle, verified: upload, read back, compare."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.protocol.mission_upload import MISSION, WINDOW, Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import wait

UPLOAD_TRIES = 3
WINDOWS_ANY_ORDER = ((WINDOW, 1),) * 4
WINDOWS_IN_ORDER = ((WINDOW, 1), (5, 3), (3, 8), (3, 8), (1, 2), (1, 1), (1, 1))
"""Items asked for at a time, and by how many questions each, try by try. Where 5 % of all is lost, 50 items
fail in the second way once in 20 times, where 30 % is, in the third way once in five times; one by one what
is lost can be asked for again, but each takes as long as an answer. A question that is overtaken is none in
order either: the last ways ask once."""


def upload_mission(
    ctx: Context,
    items: tuple[MissionItem, ...],
    current: int | None = None,
    tries: int = UPLOAD_TRIES,
    flown: int | None = None,
    too_late: Callable[[float], bool] = lambda _round_trip_s: False,
    is_over: Callable[[], bool] = lambda: False,
) -> Procedure[VerifiedUpload]:
    """Upload, read back, compare; tried again after what another try can cure.

    Ends without failure only if exactly `items` are on the vehicle. `current` is marked as the one to fly;
    `flown` is the one that the vehicle flies to now, and goes on to where none is marked. What comes
    `too_late` is not put there; when the time for it `is_over` it is not tried again.
    """
    ctx.verified_items, ctx.plan_first_seq = (), ctx.dialect.first_waypoint_seq

    def upload() -> Upload:
        return Upload(ctx.peer, items, current=current, flown=flown, too_late=too_late)

    def differences(found: tuple[MissionItem, ...]) -> tuple[str, ...]:
        return ctx.dialect.differences(items, found)

    uploaded = yield from upload_verified(ctx, upload, differences, tries, is_over)
    if uploaded.failure is None:
        ctx.verified_items = uploaded.found
    return uploaded


@dataclass(frozen=True, slots=True)
class VerifiedUpload(Done):
    """How it ended, and what was read back where that is as sent."""

    found: tuple[MissionItem, ...] = ()
    uploaded_s: float = 0.0
    """when the last upload ended, by the vehicle's clock; reading back comes after"""
    is_late: bool = False
    """it was broken off as of no use any more"""


def upload_verified(
    ctx: Context,
    upload: Callable[[], Upload],
    differences: Callable[[tuple[MissionItem, ...]], tuple[str, ...]],
    tries: int,
    is_over: Callable[[], bool] = lambda: False,
) -> Procedure[VerifiedUpload]:
    """A list of items of one kind onto a vehicle; `differences` of what is read back from what is sent."""
    failure, uploaded_s = "not tried", 0.0
    for attempt in range(tries):
        if attempt:
            # A vehicle still in the old transfer would take items of the new one into it.
            yield wait(ctx.dialect.upload_timeout_s)
        if attempt and is_over():
            break
        conversation = upload()
        result: UploadResult = yield conversation
        failure, uploaded_s = result.text, ctx.state.time_boot_s
        if result.outcome in (UploadOutcome.REJECTED, UploadOutcome.TOO_LATE):
            return VerifiedUpload(failure, is_late=result.outcome is UploadOutcome.TOO_LATE)
        if result.outcome in (UploadOutcome.DENIED, UploadOutcome.NO_ANSWER):
            continue
        # Also after a time-out: the items may all be there and only the last word lost.
        there = yield from read_back(ctx, mission_type=conversation.mission_type, is_lossy=result.is_lossy)
        if there.outcome is not DownloadOutcome.COMPLETE:
            failure = f"{failure}; {there.text}"
            continue
        gaps = differences(there.items)
        if not gaps:
            return VerifiedUpload(None, there.items, uploaded_s)
        failure = f"{failure}; read back: {gaps[0]}"
    return VerifiedUpload(failure, uploaded_s=uploaded_s)


def read_back(
    ctx: Context, first: int = 0, mission_type: int = MISSION, *, is_lossy: bool = False
) -> Procedure[DownloadResult]:
    """The items from `first` on, as the vehicle has them; asked for again after what another try can cure.

    Who tells them in order only is asked several times for each: on a link that `is_lossy`, and after the
    first try.
    """
    in_order = not ctx.dialect.serves_single_items
    ways = WINDOWS_ANY_ORDER if not in_order else WINDOWS_IN_ORDER[1:] if is_lossy else WINDOWS_IN_ORDER
    for window, copies in ways:
        asking = Download(ctx.peer, mission_type, first, window, copies, in_order=in_order)
        result: DownloadResult = yield asking
        if result.outcome in (DownloadOutcome.COMPLETE, DownloadOutcome.NO_ANSWER):
            break
        if result.outcome is DownloadOutcome.REFUSED:
            # DENIED while it has not yet given up an upload.
            yield wait(ctx.dialect.upload_timeout_s / len(WINDOWS_ANY_ORDER))
    return result
