"""The swap where a vehicle follows every item that is written: the new route goes behind the old one.

Nothing that it flies, or would fly, is touched until the new route is there and read back; then one order
takes it over, without a stop. Were everything to end before that, it would fly its old route and land.
"""

from __future__ import annotations

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.guarded import guarded, in_modes
from swarmctl.mavlink.mission_append import Append, AppendResult
from swarmctl.mavlink.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.outcome import Swapped
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.swap_in_place import swap_in_place
from swarmctl.mavlink.swap_steps import Flown, see_it_fly

MOST_ITEMS = 400
"""ArduPilot keeps 650 and more; a longer list is written anew, which sets it back to one plan."""


WINDOW = 8
"""items asked for at a time: on a slow link one by one takes as many seconds as it flies on the old route"""


def swap_behind(ctx: Context, new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    """Write behind the old route, read back, take it over; where that fails, `swap_in_place`.

    Raises HandsOff.
    """
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)
    old, kept = Flown.by(ctx), ctx.on_vehicle
    tail = new[ctx.dialect.first_waypoint_seq :]
    if not kept or not mission(ctx.state) or len(kept) + len(tail) > MOST_ITEMS:
        return (yield from swap_in_place(ctx, new, old))
    # From here on it holds more than is known.
    ctx.on_vehicle = ()
    found, failure = yield from _appended(ctx, len(kept), tail)
    if not failure and ctx.state.landed is Landed.LANDING:
        ctx.on_vehicle = kept + found
        return Swapped("it lands just now", "old")
    failure = failure or (yield from _taken_over(ctx, len(kept), tail))
    if not failure:
        ctx.on_vehicle, ctx.flown_from = kept + found, len(kept)
        failure = yield from see_it_fly(ctx, len(kept))
    if not failure:
        return Swapped(None, "new")
    done = yield from swap_in_place(ctx, new, old)
    return done if done.failure is None else Swapped(f"{failure}; {done.failure}", done.flying)


def _appended(
    ctx: Context, count: int, tail: tuple[MissionItem, ...]
) -> Procedure[tuple[tuple[MissionItem, ...], str | None]]:
    """`tail` behind the first `count` items, as read back; and the failure, if that is not what is there."""
    result: AppendResult = yield Append(ctx.peer, count, tail)
    if result.failure:
        return (), result.failure
    read: DownloadResult = yield Download(ctx.peer, first=count, window=WINDOW)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return (), read.text
    gaps = ctx.dialect.differences(tail, read.items, count)
    return read.items, f"read back behind the old route: {gaps[0]}" if gaps else None


def _taken_over(ctx: Context, seq: int, tail: tuple[MissionItem, ...]) -> Procedure[str | None]:
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)

    def follows(state: VehicleState) -> bool:
        return mission(state) and state.mission_seq is not None and seq <= state.mission_seq < seq + len(tail)

    return (
        yield from guarded(
            ctx, lambda attempt: ctx.dialect.set_current(ctx.peer, seq, attempt), mission, follows
        )
    )
