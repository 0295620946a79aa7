"""Replace the mission of a flying vehicle as a transaction.

The vehicle never flies a mixture of two plans, even if messages are lost. The kind of swap depends on the
autopilot:

| swap | condition | during the swap the vehicle |
|---|---|---|
| `swap_atomic` | the autopilot exchanges whole missions | flies on |
| `swap_append` | the autopilot uses each item as soon as it is stored | flies on |
| `swap_in_hold` | appending is impossible or failed | holds |
"""

from __future__ import annotations

import math
from dataclasses import replace

from swarmctl.core.mission import MAX_OVERSHOOT_M, MissionItem
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
"""longest wait until the vehicle has reached its take-off altitude"""


def _lands(ctx: Context) -> bool:
    """Return whether the vehicle flies an item of its landing, or descends to land."""
    state = ctx.state
    by_mission = state.mode == ctx.dialect.mission_mode and state.mission_seq in landing_items(
        ctx.verified_items
    )
    return by_mission or state.landed is Landed.LANDING


def swap_takes_s(dialect: Dialect, n_items: int, upload_s: float) -> float:
    """Return the expected time of a swap [s], if upload and read-back of `n_items` took `upload_s`.

    The estimate compares numbers of round trips.
    """
    windows = math.ceil(n_items / WINDOW)
    # Each transfer exchanges the number of items, then windows of items; an upload sends the last item alone.
    n_upload, n_read_back = 2 + windows, 1 + windows
    if dialect.uploads_atomically:
        return upload_s * n_upload / (n_upload + n_read_back)
    # Append, read back, confirm, make current.
    return upload_s * (windows + n_read_back + 2) / (n_upload + n_read_back)


def swap(
    ctx: Context,
    new: tuple[MissionItem, ...],
    *,
    leaves_ahead: bool = False,
    max_overshoot_m: float = MAX_OVERSHOOT_M,
    from_hold: bool = False,
) -> Procedure[Swapped]:
    """Fly `new` from its first waypoint; after a failure fly the old mission, or hold. Return the outcome.

    leaves_ahead: True if the new mission begins with the old mission's next waypoints, up to a splice point.
        The vehicle continues with its next item. The swap fails if the vehicle has passed the splice point.
    max_overshoot_m: greatest distance past that point at which a vehicle that brakes may stop [m]
    from_hold: True if this program has set hold mode; otherwise hold mode is another party's choice

    After another party has chosen a mode, no command is sent.
    """
    begin, stood_before_s = ctx.state, ctx.telemetry.stood_still_s
    own_modes = {ctx.dialect.mission_mode, *([ctx.dialect.hold_mode] if from_hold else [])}
    old = OldPlan.of(ctx)
    progress = RouteProgress(begin, new[ctx.dialect.first_waypoint_seq :], old.items[max(old.seq - 1, 0) :])
    plan = SwapPlan(new, progress, leaves_ahead, max_overshoot_m, own_modes)
    # A vehicle stopped during its climb would fly to the first waypoint at that low altitude.
    yield WaitUntil(lambda: not takes_off(ctx), CLIMB_LIMIT_S)
    began_s = ctx.state.time_boot_s
    # The last heartbeat may show an earlier mode.
    yield WaitUntil(lambda: ctx.state.mode in plan.own_modes, STALE_MODE_S)
    if ctx.state.mode not in plan.own_modes:
        return Swapped(describe_takeover(ctx.state), "theirs")
    unchanged: FlyingAfterSwap = "old" if old.items else "unknown"
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("the vehicle is not flying [not-flying]", unchanged)
    swap_kind = swap_atomic if ctx.dialect.uploads_atomically else swap_append
    try:
        if takes_off(ctx) or _lands(ctx):
            # Another station or the pilot may have ordered a landing.
            yield from confirm_state(ctx, in_modes(plan.own_modes, armed=True))
            return Swapped("the vehicle is taking off or landing [landing]", unchanged)
        done: Swapped = yield from swap_kind(ctx, plan)
    except TakenOver as why:
        done = Swapped(str(why), "theirs")
    except NotInControl as why:
        done = Swapped(str(why), "hold" if plan.holds else "unknown")
    took_s = None if plan.current_since_s is None else max(plan.current_since_s - began_s, 0.0)
    stood_s = ctx.telemetry.stood_still_s - stood_before_s
    return replace(done, stood_still_s=stood_s, took_s=took_s if done.failure is None else None)
