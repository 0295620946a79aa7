"""Verified upload: upload a list of mission items, read it back and compare."""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.protocol.mission_transfer import MISSION
from swarmctl.mavlink.protocol.mission_upload import WINDOW, Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import wait

UPLOAD_TRIES = 3
WINDOWS_ANY_ORDER = ((WINDOW, 1),) * 4
WINDOWS_IN_ORDER = ((WINDOW, 1), (5, 3), (3, 8), (3, 8), (1, 2), (1, 1), (1, 1))
"""(window, copies) of each try of a read-back: items requested at a time, and requests per item.

| (window, copies) | loss | failure rate for 50 items |
|---|---|---|
| (5, 3) | 5 % | 1 in 20 |
| (3, 8) | 30 % | 1 in 5 |

With a window of 1 a lost item can be requested again, but each item takes a whole round trip. Copies of
requests may arrive out of order, so the last tries send each request once."""


def upload_mission(
    ctx: Context,
    items: tuple[MissionItem, ...],
    current: int | None = None,
    tries: int = UPLOAD_TRIES,
    too_late: Callable[[float], bool] | None = None,
    is_over: Callable[[], bool] = lambda: False,
) -> Procedure[VerifiedUpload]:
    """Upload a mission, read it back and compare; try again unless the failure is final.

    A success means that exactly `items` are on the vehicle.

    current, too_late: as for `Upload`
    is_over: called before each further try; True ends the tries
    """
    ctx.verified_items, ctx.plan_first_seq = (), ctx.dialect.first_waypoint_seq

    def upload() -> Upload:
        return Upload(ctx.peer, items, current=current, too_late=too_late)

    def differences(found: tuple[MissionItem, ...]) -> tuple[str, ...]:
        return ctx.dialect.differences(items, found)

    uploaded = yield from upload_verified(ctx, upload, differences, tries, is_over)
    if uploaded.failure is None:
        ctx.verified_items = uploaded.found
    return uploaded


class VerifiedUpload(Done, frozen=True):
    """Result of an upload with read-back."""

    found: tuple[MissionItem, ...] = ()
    """items read back; empty if unknown"""
    uploaded_s: float = 0.0
    """end of the last upload, before its read-back, by the vehicle's clock [s]"""
    is_late: bool = False
    """True if the upload was stopped by `too_late`"""


def upload_verified(
    ctx: Context,
    upload: Callable[[], Upload],
    differences: Callable[[tuple[MissionItem, ...]], tuple[str, ...]],
    tries: int,
    is_over: Callable[[], bool] = lambda: False,
) -> Procedure[VerifiedUpload]:
    """Upload items of one type and read them back; `differences` compares the items read back and sent."""
    failure, uploaded_s = "not tried", 0.0
    for attempt in range(tries):
        if attempt:
            # A vehicle that is still in the old transfer would store new items in that transfer.
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
        # Read back after a time-out too: perhaps only the last acknowledgement was lost.
        stored = yield from read_back(ctx, mission_type=conversation.mission_type, is_lossy=result.is_lossy)
        if stored.outcome is not DownloadOutcome.COMPLETE:
            failure = f"{failure}; {stored.text}"
            continue
        mismatches = differences(stored.items)
        if not mismatches:
            return VerifiedUpload(None, stored.items, uploaded_s)
        failure = f"{failure}; the vehicle stores other items: {mismatches[0]} [read-back-differs]"
    return VerifiedUpload(failure, uploaded_s=uploaded_s)


def read_back(
    ctx: Context, first: int = 0, mission_type: int = MISSION, *, is_lossy: bool = False
) -> Procedure[DownloadResult]:
    """Read the items from `first` on; try again unless no answer arrives. Return the last try's result.

    PX4 serves items in order only, so its tries follow WINDOWS_IN_ORDER; a lossy link skips the first try.
    """
    in_order = not ctx.dialect.serves_single_items
    windows = WINDOWS_ANY_ORDER if not in_order else WINDOWS_IN_ORDER[1:] if is_lossy else WINDOWS_IN_ORDER
    for window, copies in windows:
        download = Download(ctx.peer, mission_type, first, window, copies, in_order=in_order)
        result: DownloadResult = yield download
        if result.outcome in (DownloadOutcome.COMPLETE, DownloadOutcome.NO_ANSWER):
            break
        if result.outcome is DownloadOutcome.REFUSED:
            # The vehicle answers DENIED until it has given up an upload.
            yield wait(ctx.dialect.upload_timeout_s / len(WINDOWS_ANY_ORDER))
    return result
