"""The swap where a mission is written item by item under a vehicle that follows at once."""

from __future__ import annotations

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.guarded import in_modes, look, set_mode
from swarmctl.mavlink.making_current import jump_to
from swarmctl.mavlink.outcome import Swapped
from swarmctl.mavlink.placing import put
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.swap_steps import Flown, held, see_it_fly


def swap_in_place(ctx: Context, new: tuple[MissionItem, ...], old: Flown) -> Procedure[Swapped]:
    """Hold, upload, read back, set the current item, fly; or go back to the old mission the same way.

    Raises HandsOff.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    failure = yield from set_mode(ctx, hold, in_modes({hold, mission}, armed=True), armed=True)
    if failure:
        yield from look(ctx, in_modes({mission}, armed=True))
        return Swapped(f"it does not hold: {failure}", "old" if old.items else "unknown")
    failure = yield from _fly_from_hold(ctx, new, ctx.dialect.first_waypoint_seq)
    if not failure:
        return Swapped(None, "new")
    if old.items:
        second = yield from _fly_from_hold(ctx, old.items, old.seq)
        if not second:
            return Swapped(failure, "old")
        failure = f"{failure}; back to the old mission: {second}"
    yield from look(ctx, in_modes({hold}, armed=True))
    return Swapped(failure, "hold")


def _fly_from_hold(ctx: Context, items: tuple[MissionItem, ...], seq: int) -> Procedure[str | None]:
    """Upload to a vehicle that holds, and see it fly the mission from `seq` on.

    Where that fails it holds again. Raises HandsOff where somebody else has it.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    holds = in_modes({hold}, armed=True)
    yield from look(ctx, holds)
    placed = yield from put(ctx, items)
    if placed.failure:
        return placed.failure
    failure = yield from jump_to(ctx, seq, holds)
    if failure:
        return failure
    failure = yield from set_mode(ctx, mission, holds, armed=True)
    if not failure:
        failure = yield from see_it_fly(ctx, seq)
    if failure:
        yield from held(ctx, failure)
    return failure
