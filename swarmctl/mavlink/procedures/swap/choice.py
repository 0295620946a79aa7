"""Replace the mission of a flying vehicle as a transaction.

At no moment it flies a mixture of two plans, whatever is lost on the way. How that is done depends on the
vehicle: where a new mission takes the old one's place at once (`swap_atomic`) it flies on meanwhile; else
the new route is written behind the old one (`swap_append`), or it holds (`swap_in_hold`).
"""

from __future__ import annotations

import math
from dataclasses import replace

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import STALE_MODE_S, Landed
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.procedures.guarded import (
    NotInControl,
    TakenOver,
    confirm_state,
    describe_takeover,
    in_modes,
)
from swarmctl.mavlink.procedures.land import landing_items
from swarmctl.mavlink.procedures.swap.append import swap_append
from swarmctl.mavlink.procedures.swap.atomic import swap_atomic
from swarmctl.mavlink.procedures.swap.route_progress import RouteProgress
from swarmctl.mavlink.procedures.swap.steps import OldPlan, SwapPlan, takes_off
from swarmctl.mavlink.protocol.mission_upload import WINDOW
from swarmctl.mavlink.protocol.outcome import FlyingAfterSwap, Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

CLIMB_LIMIT_S = 60.0
"""until it is up at its take-off altitude"""


def _lands(ctx: Context) -> bool:
    """It comes down, or flies to the circle from which it does."""
    state = ctx.state
    by_mission = state.mode == ctx.dialect.mission_mode and state.mission_seq in landing_items(
        ctx.verified_items
    )
    return by_mission or state.landed is Landed.LANDING


def swap_takes_s(dialect: Dialect, n_items: int, upload_s: float) -> float:
    """How long a change in flight will take until the new plan is flown, where an upload of so many items
    took `upload_s`: by the questions and answers of each."""
    windows = math.ceil(n_items / WINDOW)
    up, down = 2 + windows, 1 + windows  # the number of items, the items, and the last one by itself
    if dialect.uploads_atomically:
        return upload_s * up / (up + down)
    # Written, read back, seen, taken over.
    return upload_s * (windows + down + 2) / (up + down)


def swap(
    ctx: Context, new: tuple[MissionItem, ...], *, leaves_ahead: bool = False, from_hold: bool = False
) -> Procedure[Swapped]:
    """Fly `new` from its first waypoint; or the old mission again; or hold, and say so.

    `leaves_ahead`: it begins as the old one goes on from here, and leaves that farther on. Then it is flown
    from what of it lies ahead when it is taken over, and not at all by who is past that place.

    Nothing is touched any more where somebody else has chosen another mode. Its hold mode is such a one as
    well, unless it was put in it (`from_hold`).
    """
    begin, stood_s = ctx.state, ctx.telemetry.stood_still_s
    ours = {ctx.dialect.mission_mode, *([ctx.dialect.hold_mode] if from_hold else [])}
    flown = OldPlan.of(ctx)
    ahead = RouteProgress(begin, new[ctx.dialect.first_waypoint_seq :], flown.items[flown.seq :])
    plan = SwapPlan(new, ahead, leaves_ahead, ours)
    # Stopped on its first metres it would go on to the first waypoint from down there.
    yield WaitUntil(lambda: not takes_off(ctx), CLIMB_LIMIT_S)
    # A heartbeat that was overtaken on its way may show a mode from before.
    yield WaitUntil(lambda: ctx.state.mode in plan.own_modes, STALE_MODE_S)
    if ctx.state.mode not in plan.own_modes:
        return Swapped(describe_takeover(ctx.state), "theirs")
    kept: FlyingAfterSwap = "old" if flown.items else "unknown"
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("it is not flying", kept)
    scheme = swap_atomic if ctx.dialect.uploads_atomically else swap_append
    try:
        if takes_off(ctx) or _lands(ctx):
            # Who comes down may have been told so by somebody else.
            yield from confirm_state(ctx, in_modes(plan.own_modes, armed=True))
            return Swapped("it takes off or lands just now", kept)
        done: Swapped = yield from scheme(ctx, plan)
    except TakenOver as why:
        done = Swapped(str(why), "theirs")
    except NotInControl as why:
        done = Swapped(str(why), "hold" if plan.holds else "unknown")
    took_s = None if plan.taken_over_s is None else max(plan.taken_over_s - begin.time_boot_s, 0.0)
    stood_s = ctx.telemetry.stood_still_s - stood_s
    return replace(done, stood_still_s=stood_s, took_s=took_s if done.failure is None else None)
