"""Arm a vehicle and start its mission."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.guarded import HandsOff, command, guarded, in_modes, set_mode
from swarmctl.mavlink.making_current import make_current
from swarmctl.mavlink.outcome import Done
from swarmctl.mavlink.procedure import Context, Procedure

CLIMB_WAIT_S = 20.0
"""until it has left the ground"""


def launch(ctx: Context) -> Procedure[Done]:
    """Arm and start the mission that is on the vehicle; done when it leaves the ground."""
    if not ctx.on_vehicle:
        return Done("no verified mission is on the vehicle; upload one first")
    if ctx.state.armed:
        return Done(f"it is armed already, in {ctx.state.mode}; nothing was sent")
    try:
        return Done((yield from _take_off(ctx)))
    except HandsOff as why:
        return Done(str(why))


def _take_off(ctx: Context) -> Procedure[str | None]:
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # After a landing it stands there in its mission mode.
    stands = in_modes({hold, mission}, armed=False)
    failure = yield from set_mode(ctx, hold, stands, armed=False)
    if failure:
        return failure
    holds = in_modes({hold}, armed=False)
    if ctx.dialect.first_seq is not None:
        failure = yield from make_current(ctx, ctx.dialect.first_seq, holds)
        if failure:
            return f"it does not begin its mission at the beginning: {failure}"
    may_start = in_modes({hold}, armed=True)
    arm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))
    failure = yield from guarded(ctx, arm, holds, may_start)
    if failure:
        return f"it does not arm: {failure}"
    ground_m = ctx.state.alt_rel_m or 0.0
    started = in_modes({mission}, armed=True)
    failure = yield from guarded(
        ctx,
        command(ctx, *ctx.dialect.start_mission),
        may_start,
        started,
        seen=lambda s: started(s) and _has_left_ground(s, ground_m),
        wait_s=CLIMB_WAIT_S,
    )
    if failure is None:
        return None
    if ctx.state.landed is Landed.ON_GROUND:
        # Armed, on the ground and not going anywhere: an ordinary disarm, which a flying vehicle refuses.
        still = in_modes({hold, mission}, armed=True)
        disarm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))
        yield from guarded(ctx, disarm, still, stands, skip_if_done=True)
    return f"it does not take off: {failure}"


def _has_left_ground(state: VehicleState, ground_m: float) -> bool:
    flies = state.landed in (Landed.IN_AIR, Landed.TAKEOFF)
    return flies and state.alt_rel_m is not None and state.alt_rel_m > ground_m + 0.5
