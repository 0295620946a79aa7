"""The swap where a new mission takes the old one's place when it is complete: it flies on meanwhile."""

from __future__ import annotations

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.guarded import in_modes, look, set_mode
from swarmctl.mavlink.making_current import jump_to, see_current
from swarmctl.mavlink.mission_download import DownloadOutcome
from swarmctl.mavlink.outcome import Swapped
from swarmctl.mavlink.placing import UPLOAD_TRIES, put, read_back
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.swap_steps import Flown, held, see_it_fly


def swap_at_once(ctx: Context, new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    """Upload, marked with the item to fly, read back, see that one flown; or back to the old mission.

    One try: it flies on meanwhile, and a route that is late begins behind it. Raises HandsOff.
    """
    old = Flown.by(ctx)
    failure = yield from _exchange(ctx, new, ctx.dialect.first_waypoint_seq, tries=1)
    if failure is None:
        return Swapped(None, "new")
    if not old.items:
        return (yield from held(ctx, failure))
    if (yield from _has_still(ctx, old)):
        return Swapped(failure, "old")
    second = yield from _exchange(ctx, old.items, old.seq, tries=UPLOAD_TRIES)
    if second is None:
        return Swapped(failure, "old")
    return (yield from held(ctx, f"{failure}; back to the old mission: {second}"))


def _exchange(ctx: Context, items: tuple[MissionItem, ...], seq: int, tries: int) -> Procedure[str | None]:
    """Put `items` on a vehicle that flies or holds, and see it fly them from `seq` on."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    ours = in_modes({hold, mission}, armed=True)
    before = ctx.state.mission_seq or 0
    yield from look(ctx, ours)
    placed = yield from put(ctx, items, seq, tries)
    if placed.failure:
        return placed.failure
    # Ahead of `seq`, but behind where the old index would be: it has got on since.
    kept = min(before, len(items) - 1)
    failure = None
    if not (yield from see_current(ctx, lambda now: now == seq or seq < now < kept)):
        failure = yield from jump_to(ctx, seq, ours)
    if failure is None:
        failure = yield from set_mode(ctx, mission, ours, armed=True)
    return failure or (yield from see_it_fly(ctx, seq))


def _has_still(ctx: Context, old: Flown) -> Procedure[bool]:
    """Whether it flies the old mission as if nothing had been: the new one was refused, or never complete."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    read = yield from read_back(ctx)
    if read.outcome is not DownloadOutcome.COMPLETE or ctx.dialect.differences(old.items, read.items):
        return False
    yield from look(ctx, in_modes({hold, mission}, armed=True))
    if ctx.state.mode != mission:
        return False
    ctx.on_vehicle = read.items
    return True
