"""The swap where a vehicle follows every item that is written: the new route goes behind the old one.

Nothing that it flies, or would fly, is touched until the new route is there and read back; then one order
takes it over. A copter of ArduPilot brakes then and speeds up again; the others just turn. Were everything to
end before that, it would fly its old route and land.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.procedures.guarded import TakenOver, confirm_state, in_modes, send_guarded
from swarmctl.mavlink.procedures.swap.in_hold import swap_in_hold
from swarmctl.mavlink.procedures.swap.route_progress import CORNER_S, SAME_PLACE_M, RoutePosition
from swarmctl.mavlink.procedures.swap.steps import (
    MAX_ITEMS,
    PAST_SPLIT,
    POSITION_UNKNOWN,
    OldPlan,
    SwapPlan,
    confirm_flying,
)
from swarmctl.mavlink.procedures.verified_upload import read_back
from swarmctl.mavlink.protocol.mission_append import Append, AppendResult
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil
from swarmctl.mavlink.telemetry.vehicle_state import STILL_M_S

MOMENT_S = 10.0
"""for so long it is waited for a moment that is not beside a corner"""


def swap_append(ctx: Context, plan: SwapPlan) -> Procedure[Swapped]:
    """Write behind the old route, read back, take it over; where that fails, `swap_in_hold`.

    Raises NotInControl.
    """
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)
    old, kept = OldPlan.of(ctx), ctx.verified_items
    tail = plan.items[ctx.dialect.first_waypoint_seq :]
    if not kept or not mission(ctx.state) or len(kept) + len(tail) > MAX_ITEMS:
        return (yield from swap_in_hold(ctx, plan, old))
    # From here on it holds more than is known.
    ctx.verified_items = ()
    is_past = partial(plan.is_past_split, ctx)
    appended: AppendResult = yield Append(ctx.peer, len(kept), tail, is_past)
    if appended.is_foreign:
        raise TakenOver(f"another station has changed its mission: {appended.failure}")
    found, failure = yield from _read_back(ctx, len(kept), tail, appended)
    if appended.is_late:
        yield from confirm_state(ctx, mission)
        # What was not read is not known: the next plan is written anew.
        ctx.verified_items = () if failure else kept + found
        return Swapped(PAST_SPLIT, "old", is_late=True)
    if not failure:
        # An order goes by what was told as long ago as it takes to be answered.
        later_s = appended.round_trip_s
        yield WaitUntil(lambda: _is_clear(ctx, plan, later_s), MOMENT_S)
        late, blind = is_past(appended.round_trip_s), plan.lacks_position(ctx)
        if late or blind or ctx.state.landed is Landed.LANDING:
            # Who comes down may have been told so by somebody else.
            yield from confirm_state(ctx, mission)
            ctx.verified_items = kept + found
            why = PAST_SPLIT if late else POSITION_UNKNOWN if blind else "it lands just now"
            return Swapped(why, "old", is_late=late)
        failure = yield from _taken_over(ctx, len(kept), tail, lambda: plan.next_waypoint(ctx, later_s))
    if not failure:
        plan.mark_taken_over(ctx)
        ctx.verified_items, ctx.plan_first_seq = kept + found, len(kept)
        failure = yield from confirm_flying(ctx, len(kept))
    if not failure:
        return Swapped(None, "new")
    done = yield from swap_in_hold(ctx, plan, old)
    return done if done.failure is None else Swapped(f"{failure}; {done.failure}", done.flying)


def _read_back(
    ctx: Context, count: int, tail: tuple[MissionItem, ...], appended: AppendResult
) -> Procedure[tuple[tuple[MissionItem, ...], str | None]]:
    """What is there behind the first `count` items; and the failure, if that is not what was to be."""
    if appended.failure and not appended.is_late:
        return (), appended.failure
    read = yield from read_back(ctx, count)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return (), read.text
    gaps = () if appended.is_late else ctx.dialect.differences(tail, read.items, count)
    return read.items, f"read back behind the old route: {gaps[0]}" if gaps else None


def _is_clear(ctx: Context, plan: SwapPlan, later_s: float) -> bool:
    """Whether it is known which corner of the new route lies ahead when an order arrives."""
    if plan.lacks_position(ctx):
        return False
    if not plan.leaves_ahead or ctx.state.ground_speed_m_s < STILL_M_S:
        return True
    at = plan.position(ctx, later_s)
    return at.is_late or (at.corner_s > CORNER_S and not _passes_it_braking(ctx, at))


def _passes_it_braking(ctx: Context, at: RoutePosition) -> bool:
    """Whether it would have to fly back to the item ahead; to that at which the new route leaves the old one
    it may, rather than leave that unflown."""
    brakes_m_s2 = ctx.dialect.brakes_m_s2
    leaves_there = at.item_m + at.past_split_m > -SAME_PLACE_M
    if brakes_m_s2 is None or leaves_there:
        return False
    return at.item_m < ctx.state.ground_speed_m_s**2 / (2.0 * brakes_m_s2)


def _taken_over(
    ctx: Context, begin: int, tail: tuple[MissionItem, ...], first: Callable[[], int]
) -> Procedure[str | None]:
    """`first`: the item of the tail to fly to, found when the order goes out."""
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)

    def follows(state: VehicleState) -> bool:
        seq = state.mission_seq
        return mission(state) and seq is not None and begin <= seq < begin + len(tail)

    return (
        yield from send_guarded(
            ctx, lambda attempt: ctx.dialect.set_current(ctx.peer, begin + first(), attempt), mission, follows
        )
    )
