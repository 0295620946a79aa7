"""The swap where a mission is written item by item under a vehicle that follows at once."""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import in_modes, look, set_mode
from swarmctl.mavlink.procedures.set_current import jump_to
from swarmctl.mavlink.procedures.swap.steps import (
    BLIND,
    NOT_ON_IT,
    PAST,
    Flown,
    Way,
    have_it_hold,
    held,
    see_it_fly,
)
from swarmctl.mavlink.procedures.verified_upload import put
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure

STANDS_LIMIT_S = 120.0
"""It holds on a battery that was counted on for the flight: after so long nothing more is begun, and whoever
plans decides what to do instead."""


def swap_in_place(ctx: Context, way: Way, old: Flown) -> Procedure[Swapped]:
    """Hold, upload, read back, set the current item, fly; or go back to the old mission the same way.

    Raises HandsOff.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    failure = yield from have_it_hold(ctx, way)
    if failure:
        yield from look(ctx, in_modes({mission}, armed=True))
        return Swapped(f"it does not hold: {failure}", "old" if old.items else "unknown")
    first, until_s = ctx.dialect.first_waypoint_seq, ctx.state.time_boot_s + STANDS_LIMIT_S

    def is_over() -> bool:
        return ctx.state.time_boot_s > until_s

    is_late = bool(old.items) and way.is_past(ctx, 0.0)
    failure = PAST if is_late else BLIND
    if not (is_late or way.is_blind(ctx)):
        failure = yield from _fly_from_hold(ctx, way, way.items, lambda: first + way.first(ctx), is_over)
    if not failure:
        way.is_taken_over(ctx)
        return Swapped(None, "new")
    if is_over():
        failure = f"{failure}; it has held for more than {STANDS_LIMIT_S:g} s"
    elif old.items:
        second = yield from _fly_back(ctx, way, old, is_over)
        if not second:
            return Swapped(failure, "old", is_late=is_late)
        failure = f"{failure}; back to the old mission: {second}"
    yield from look(ctx, in_modes({hold}, armed=True))
    return Swapped(failure, "hold")


def _fly_back(ctx: Context, way: Way, old: Flown, is_over: Callable[[], bool]) -> Procedure[str | None]:
    """To the old mission, where it is still on its way; returns why not."""
    seq = old.item(ctx)
    if seq is None:
        return NOT_ON_IT
    return (yield from _fly_from_hold(ctx, way, old.items, lambda: seq, is_over))


def _fly_from_hold(
    ctx: Context,
    way: Way,
    items: tuple[MissionItem, ...],
    item: Callable[[], int],
    is_over: Callable[[], bool],
) -> Procedure[str | None]:
    """Upload to a vehicle that holds, and see it fly the mission from an item on, found when it is there.

    Where that fails it holds again. Raises HandsOff where somebody else has it.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    holds = in_modes({hold}, armed=True)
    yield from look(ctx, holds)
    placed = yield from put(ctx, items, is_over=is_over)
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
