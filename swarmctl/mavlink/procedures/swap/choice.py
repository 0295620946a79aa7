"""Replace the mission of a flying vehicle as a transaction.

The vehicle never flies a mixture of two plans, even if messages are lost. The kind of swap depends on the
autopilot:

| swap | condition | during the swap the vehicle |
|---|---|---|
| `AtomicSwap` | the autopilot exchanges whole missions | flies on |
| `AppendSwap` | the autopilot uses each item as soon as it is stored | flies on |
| `SwapInHold` | appending is impossible or failed | holds |
| `StoredSwap` | the vehicle holds, and the plan is stored already | holds |
"""

from __future__ import annotations

import math

from swarmctl.core.mission import FlightPlan
from swarmctl.core.records import replace
from swarmctl.core.vehicle import STALE_MODE_S, Landed
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.procedures.guarded import NotInControl, TakenOver, confirm_state, describe_takeover
from swarmctl.mavlink.procedures.land import landing_items
from swarmctl.mavlink.procedures.swap import in_hold, stored
from swarmctl.mavlink.procedures.swap.append import AppendSwap
from swarmctl.mavlink.procedures.swap.atomic import AtomicSwap
from swarmctl.mavlink.procedures.swap.machine import OldPlan, Swap
from swarmctl.mavlink.procedures.swap.route_progress import RouteProgress
from swarmctl.mavlink.procedures.swap.stored import StoredSwap
from swarmctl.mavlink.protocol.mission_upload import WINDOW
from swarmctl.mavlink.protocol.outcome import FlyingAfterSwap, Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

CLIMB_LIMIT_S = 60.0
"""longest wait until the vehicle has reached its take-off altitude"""
_HOLDING_STATES = in_hold.HOLDING_STATES | stored.HOLDING_STATES


def swap(ctx: Context, plan: FlightPlan) -> Procedure[Swapped]:
    """Fly `plan` from its first waypoint; after a failure fly the old mission, or hold. Return the outcome.

    If the plan begins with the old mission's next waypoints (`leaves_ahead`), the vehicle continues with its
    next item, and the swap fails if the vehicle has passed the splice point. Hold mode is another party's
    choice unless the plan begins in a hold of this program (`from_hold`). After another party has chosen a
    mode, no command is sent.
    """
    try:
        items = ctx.dialect.mission_items(plan, ctx.state.takeoff_lat_lon)
    except ValueError as error:
        return Swapped(f"the plan cannot be flown: {error}", "old")
    stood_before_s, old = ctx.telemetry.stood_still_s, OldPlan.of(ctx)
    waypoints, flown = items[ctx.dialect.first_waypoint_seq :], old.items[max(old.seq - 1, 0) :]
    own_modes = {ctx.dialect.mission_mode, *([ctx.dialect.hold_mode] if plan.from_hold else [])}
    running = Swap(ctx, plan, items, RouteProgress(ctx.state, waypoints, flown), own_modes)
    # A vehicle stopped during its climb would fly to the first waypoint at that low altitude.
    yield WaitUntil(lambda: not takes_off(ctx), CLIMB_LIMIT_S)
    began_s = ctx.state.time_boot_s
    # The last heartbeat may show an earlier mode.
    yield WaitUntil(lambda: ctx.state.mode in own_modes, STALE_MODE_S)
    if ctx.state.mode not in own_modes:
        return Swapped(describe_takeover(ctx.state), "theirs")
    unchanged: FlyingAfterSwap = "old" if old.items else "unknown"
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("the vehicle is not flying [not-flying]", unchanged)
    machine = _machine(running)
    try:
        if takes_off(ctx) or lands(ctx):
            # Another station or the pilot may have ordered a landing.
            yield from confirm_state(ctx, machine.in_own_modes)
            return Swapped("the vehicle is taking off or landing [landing]", unchanged)
        done = yield from machine.run()
    except TakenOver as why:
        done = Swapped(str(why), "theirs")
    except NotInControl as why:
        done = Swapped(str(why), "hold" if running.state in _HOLDING_STATES else "unknown")
    stood_s = ctx.telemetry.stood_still_s - stood_before_s
    # A stored mission says nothing about the time of the next upload.
    is_measured = done.failure is None and not isinstance(machine, StoredSwap)
    took_s = max(running.current_since_s - began_s, 0.0) if is_measured else None
    return replace(done, stood_still_s=stood_s, took_s=took_s)


def _machine(running: Swap) -> StoredSwap | AtomicSwap | AppendSwap:
    ctx, old = running.ctx, OldPlan.of(running.ctx)
    if running.plan.from_hold and ctx.state.mode == ctx.dialect.hold_mode:
        begin = stored.stored_at(ctx, running.items)
        if begin is not None:
            return StoredSwap(running, old, begin)
    kind = AtomicSwap if ctx.dialect.uploads_atomically else AppendSwap
    return kind(running, old)


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


def takes_off(ctx: Context) -> bool:
    """Return whether the vehicle flies an item before its first waypoint."""
    seq = ctx.state.mission_seq
    return _is_in_mission(ctx) and seq is not None and seq < ctx.dialect.first_waypoint_seq


def lands(ctx: Context) -> bool:
    """Return whether the vehicle flies an item of its landing, or descends to land."""
    by_mission = _is_in_mission(ctx) and ctx.state.mission_seq in landing_items(ctx.verified_items)
    return by_mission or ctx.state.landed is Landed.LANDING


def _is_in_mission(ctx: Context) -> bool:
    return ctx.state.mode == ctx.dialect.mission_mode
