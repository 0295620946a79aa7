"""The swap where a mission is written item by item under a vehicle that follows at once."""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.guarded import in_modes, look, set_mode
from swarmctl.mavlink.making_current import jump_to
from swarmctl.mavlink.outcome import Swapped
from swarmctl.mavlink.placing import put
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.swap_steps import Flown, Way, have_it_hold, held, see_it_fly


def swap_in_place(ctx: Context, way: Way, old: Flown) -> Procedure[Swapped]:
    """Hold, upload, read back, set the current item, fly; or go back to the old mission the same way.

    Raises HandsOff.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    failure = yield from have_it_hold(ctx, way)
    if failure:
        yield from look(ctx, in_modes({mission}, armed=True))
        return Swapped(f"it does not hold: {failure}", "old" if old.items else "unknown")
    first = ctx.dialect.first_waypoint_seq
    failure = yield from _fly_from_hold(ctx, way, way.items, lambda: first + way.first(ctx))
    if not failure:
        way.is_taken_over(ctx)
        return Swapped(None, "new")
    if old.items:
        second = yield from _fly_from_hold(ctx, way, old.items, lambda: old.seq)
        if not second:
            return Swapped(failure, "old")
        failure = f"{failure}; back to the old mission: {second}"
    yield from look(ctx, in_modes({hold}, armed=True))
    return Swapped(failure, "hold")


def _fly_from_hold(
    ctx: Context, way: Way, items: tuple[MissionItem, ...], item: Callable[[], int]
) -> Procedure[str | None]:
    """Upload to a vehicle that holds, and see it fly the mission from an item on, found when it is there.

    Where that fails it holds again. Raises HandsOff where somebody else has it.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    holds = in_modes({hold}, armed=True)
    yield from look(ctx, holds)
    placed = yield from put(ctx, items)
    if placed.failure:
        return placed.failure
    seq = item()
    failure = yield from jump_to(ctx, seq, holds)
    if failure:
        return failure
    way.holds = False
    failure = yield from set_mode(ctx, mission, holds, armed=True)
    if not failure:
        failure = yield from see_it_fly(ctx, seq)
    if failure:
        yield from held(ctx, way, failure)
    return failure
