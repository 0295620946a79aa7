"""Replace the mission of a flying vehicle as a transaction.

At no moment it flies a mixture of two plans, whatever is lost on the way. How that is done depends on the
vehicle: where a new mission takes the old one's place at once (`swap_at_once`) it flies on meanwhile; else
the new route is written behind the old one (`swap_behind`), or it holds (`swap_in_place`).
"""

from __future__ import annotations

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.guarded import HandsOff, foreign
from swarmctl.mavlink.outcome import Flying, Swapped
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.swap_at_once import swap_at_once
from swarmctl.mavlink.swap_behind import swap_behind
from swarmctl.mavlink.swap_steps import Flown, takes_off
from swarmctl.mavlink.wait import Until

CLIMB_LIMIT_S = 60.0
"""until it is up at its take-off altitude"""


def swap(ctx: Context, new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    """Fly `new` from its first waypoint; or the old mission again; or hold, and say so.

    Nothing is touched any more where somebody else has chosen another mode.
    """
    stood_s = ctx.telemetry.stood_still_s
    flown = Flown.by(ctx)
    # Stopped on its first metres it would go on to the first waypoint from down there.
    yield Until(lambda: not takes_off(ctx), CLIMB_LIMIT_S)
    if ctx.state.mode not in (ctx.dialect.hold_mode, ctx.dialect.mission_mode):
        return Swapped(foreign(ctx.state))
    kept: Flying = "old" if flown.items else "unknown"
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("it is not flying", kept)
    if takes_off(ctx) or ctx.state.landed is Landed.LANDING:
        return Swapped("it takes off or lands just now", kept)
    way = swap_at_once if ctx.dialect.uploads_at_once else swap_behind
    try:
        done: Swapped = yield from way(ctx, new)
    except HandsOff as why:
        done = Swapped(str(why), "unknown")
    return Swapped(done.failure, done.flying, ctx.telemetry.stood_still_s - stood_s)
