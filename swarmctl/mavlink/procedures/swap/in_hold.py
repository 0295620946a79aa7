"""Swap in hold: the vehicle holds while its mission is replaced item by item."""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import UNTIL_REPLACED_S, confirm_state, in_modes, set_mode
from swarmctl.mavlink.procedures.set_current import set_current_item
from swarmctl.mavlink.procedures.swap.steps import (
    NOT_ON_OLD_MISSION,
    PAST_SPLICE,
    POSITION_UNKNOWN,
    OldPlan,
    SwapPlan,
    confirm_flying,
    end_in_hold,
    enter_hold,
)
from swarmctl.mavlink.procedures.verified_upload import upload_mission
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure

HOLD_LIMIT_S = 120.0
"""time in hold after which no further upload begins, because holding uses battery; then the agent decides"""


def swap_in_hold(ctx: Context, plan: SwapPlan, old: OldPlan) -> Procedure[Swapped]:
    """Hold, upload, read back, set the current item, fly; after a failure do the same with the old mission.

    After a second failure, or after HOLD_LIMIT_S, the vehicle stays in hold. Raises NotInControl.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    failure = yield from enter_hold(ctx, plan)
    if failure:
        yield from confirm_state(ctx, in_modes({mission}, armed=True))
        return Swapped(f"the vehicle does not hold: {failure} [no-hold]", "old" if old.items else "unknown")
    first, until_s = ctx.dialect.first_waypoint_seq, ctx.state.time_boot_s + HOLD_LIMIT_S

    def is_over() -> bool:
        return ctx.state.time_boot_s > until_s

    is_late = bool(old.items) and plan.is_past_splice(ctx, 0.0)
    failure = PAST_SPLICE if is_late else POSITION_UNKNOWN
    if not (is_late or plan.lacks_position(ctx)):
        failure = yield from _fly_from_hold(
            ctx, plan, plan.items, lambda: first + plan.next_waypoint(ctx), is_over
        )
    if not failure:
        plan.record_current(ctx)
        return Swapped(None, "new")
    if is_over():
        failure = f"{failure}; the vehicle has held for more than {HOLD_LIMIT_S:g} s [hold-limit]"
    elif old.items:
        second = yield from _return_to_old(ctx, plan, old, is_over)
        if not second:
            return Swapped(failure, "old", is_late=is_late)
        failure = f"{failure}; back to the old mission: {second}"
    yield from confirm_state(ctx, in_modes({hold}, armed=True))
    return Swapped(failure, "hold")


def _return_to_old(
    ctx: Context, plan: SwapPlan, old: OldPlan, is_over: Callable[[], bool]
) -> Procedure[str | None]:
    """Make a vehicle that is still on the old route fly the old mission; return the failure."""
    seq = old.next_item(ctx)
    if seq is None:
        return NOT_ON_OLD_MISSION
    return (yield from _fly_from_hold(ctx, plan, old.items, lambda: seq, is_over))


def _fly_from_hold(
    ctx: Context,
    plan: SwapPlan,
    items: tuple[MissionItem, ...],
    first_item: Callable[[], int],
    is_over: Callable[[], bool],
) -> Procedure[str | None]:
    """Upload `items` to a holding vehicle, then make it fly from item `first_item()`.

    Return the failure, with the vehicle in hold again. Raises NotInControl.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    holds = in_modes({hold}, armed=True)
    yield from confirm_state(ctx, holds)
    uploaded = yield from upload_mission(ctx, items, is_over=is_over)
    if uploaded.failure:
        return uploaded.failure
    seq = first_item()
    failure = yield from set_current_item(ctx, seq, holds, lasts_s=UNTIL_REPLACED_S)
    if failure:
        return failure
    plan.holds = False
    failure = yield from set_mode(ctx, mission, holds, armed=True)
    if not failure:
        failure = yield from confirm_flying(ctx, seq)
    if failure:
        yield from end_in_hold(ctx, plan, failure)
    return failure
