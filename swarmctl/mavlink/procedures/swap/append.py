"""Append swap for autopilots that use each item as soon as it is stored: the new route follows the old route.

No item of the old route changes. After the read-back one command makes an item of the new route current. An
ArduCopter brakes and speeds up again; other vehicles turn without braking. If the link ends before that
command, the vehicle flies its old route and lands.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.procedures.guarded import (
    UNTIL_REPLACED_S,
    CommandLate,
    GuardedCommand,
    TakenOver,
    confirm_state,
    in_modes,
    send_guarded,
)
from swarmctl.mavlink.procedures.set_current import await_current_item
from swarmctl.mavlink.procedures.swap.in_hold import swap_in_hold
from swarmctl.mavlink.procedures.swap.route_progress import CORNER_MARGIN_S, SAME_PLACE_M, RoutePosition
from swarmctl.mavlink.procedures.swap.steps import (
    MAX_ITEMS,
    PAST_SPLICE,
    POSITION_UNKNOWN,
    OldPlan,
    SwapPlan,
    confirm_flying,
    stopping_distance_m,
)
from swarmctl.mavlink.procedures.verified_upload import read_back
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.mission_append import Append, AppendResult
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil
from swarmctl.mavlink.telemetry.vehicle_state import STILL_M_S

CLEAR_WAIT_S = 10.0
"""longest wait until the vehicle is clear of corners"""
DECISIONS = 3
"""greatest number of decisions for the change to the new route; each late command needs a new one"""
MAX_BESIDE_LEG_M = 2.0
"""greatest distance from the route at which a vehicle may begin a new leg"""


def swap_append(ctx: Context, plan: SwapPlan) -> Procedure[Swapped]:
    """Append the new route, read it back and make it current. If this is impossible or fails, swap in hold.

    A vehicle that is past the splice point, off the new route, landing, or without a known position stays on
    the old route. Raises NotInControl.
    """
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)
    old, stored = OldPlan.of(ctx), ctx.verified_items
    tail = plan.items[ctx.dialect.first_waypoint_seq :]
    if not stored or not mission(ctx.state) or len(stored) + len(tail) > MAX_ITEMS:
        return (yield from swap_in_hold(ctx, plan, old))
    # From now on the vehicle stores items that are not verified.
    ctx.verified_items = ()
    is_past = partial(plan.is_past_splice, ctx)
    appended: AppendResult = yield Append(ctx.peer, len(stored), tail, is_past)
    if appended.is_foreign:
        raise TakenOver(f"another station has changed the mission: {appended.failure}")
    found, failure = yield from _read_back(ctx, len(stored), tail, appended)
    if appended.is_late:
        yield from confirm_state(ctx, mission)
        # Without a read-back the stored items are unknown, so the next plan is written as a whole.
        ctx.verified_items = () if failure else stored + found
        return Swapped(PAST_SPLICE, "old", is_late=True)
    if not failure:
        # A command is based on telemetry. When the command arrives, that telemetry is one round trip old.
        failure, stays = yield from _make_tail_current(ctx, plan, len(stored), tail, appended.round_trip_s)
        if stays is not None:
            # Another station or the pilot may have ordered a landing.
            yield from confirm_state(ctx, mission)
            ctx.verified_items = stored + found
            return stays
    if not failure:
        plan.record_current(ctx)
        ctx.verified_items, ctx.plan_first_seq = stored + found, len(stored)
        failure = yield from confirm_flying(ctx, len(stored))
    if not failure:
        return Swapped(None, "new")
    done = yield from swap_in_hold(ctx, plan, old)
    return done if done.failure is None else replace(done, failure=f"{failure}; {done.failure}")


def _read_back(
    ctx: Context, count: int, tail: tuple[MissionItem, ...], appended: AppendResult
) -> Procedure[tuple[tuple[MissionItem, ...], str | None]]:
    """Return the items stored after the first `count`, and the failure if `tail` was not appended."""
    if appended.failure and not appended.is_late:
        return (), appended.failure
    read = yield from read_back(ctx, count)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return (), read.text
    mismatches = () if appended.is_late else ctx.dialect.differences(tail, read.items, count)
    return read.items, f"read back after the old route: {mismatches[0]}" if mismatches else None


def _next_item_is_certain(ctx: Context, plan: SwapPlan, later_s: float) -> bool:
    """Return whether it is certain which item of the new route is next when a command arrives."""
    if plan.lacks_position(ctx):
        return False
    if not plan.leaves_ahead or ctx.state.ground_speed_m_s < STILL_M_S:
        return True
    at = plan.position(ctx, later_s)
    is_late = plan.is_past_splice(ctx, later_s)
    return is_late or (at.corner_s > CORNER_MARGIN_S and not _leaves_leg(ctx, at))


def _leaves_leg(ctx: Context, at: RoutePosition) -> bool:
    """Return whether the new leg of a vehicle that brakes would leave the route.

    The new leg begins where the vehicle stops: behind the next item, or beside the route soon after a corner.
    False at the splice point: flying back to that point is better than leaving it out.
    """
    is_at_splice = abs(at.to_item_m + at.past_splice_m) <= SAME_PLACE_M
    if ctx.dialect.brakes_m_s2 is None or is_at_splice:
        return False
    return at.to_item_m < stopping_distance_m(ctx) or at.cross_track_m > MAX_BESIDE_LEG_M


def _make_tail_current(
    ctx: Context, plan: SwapPlan, begin: int, tail: tuple[MissionItem, ...], later_s: float
) -> Procedure[tuple[str | None, Swapped | None]]:
    """Make the next item of the tail current; return the failure, and the outcome if the old route stays.

    Each try decides its item by the vehicle's position. After a late command the change is decided anew: the
    next item may be another one, or the vehicle may have to stay on its old route.
    """
    mission = in_modes({ctx.dialect.mission_mode}, armed=True)

    def follows(state: VehicleState) -> bool:
        seq = state.mission_seq
        return mission(state) and seq is not None and begin <= seq < begin + len(tail)

    def next_try(attempt: int) -> Conversation[CommandResult] | None:
        is_certain = attempt == 0 or _next_item_is_certain(ctx, plan, later_s)
        if not is_certain or _stays_on_old(ctx, plan, later_s) is not None:
            return None
        return ctx.dialect.set_current(ctx.peer, begin + plan.next_waypoint(ctx, later_s), attempt)

    failure: str | None = None
    for decision in range(DECISIONS):
        yield WaitUntil(lambda: _next_item_is_certain(ctx, plan, later_s), CLEAR_WAIT_S)
        # A command that was sent before this decision may have taken effect.
        if decision and (yield from await_current_item(ctx, lambda _seq: follows(ctx.state))):
            return None, None
        if (stays := _stays_on_old(ctx, plan, later_s)) is not None:
            # An earlier command may still be on its way, so the vehicle's route is not certain.
            return (stays.failure, None) if decision and stays.is_late else (None, stays)
        order = GuardedCommand(next_try, UNTIL_REPLACED_S)
        try:
            failure = yield from send_guarded(ctx, order, mission, follows, skip_if_done=decision > 0)
        except CommandLate as why:
            failure = str(why)
        else:
            break
    return failure, None


def _stays_on_old(ctx: Context, plan: SwapPlan, later_s: float) -> Swapped | None:
    """Return the outcome if the vehicle has to stay on its old route now, else None."""
    if plan.is_past_splice(ctx, later_s):
        return Swapped(PAST_SPLICE, "old", is_late=True)
    if plan.lacks_position(ctx):
        return Swapped(POSITION_UNKNOWN, "old")
    if ctx.state.landed is Landed.LANDING:
        return Swapped("the vehicle is landing [landing]", "old")
    return None
