"""Procedures of a ground station: identify, prepare, upload, hold, return, land, speed, set-points.

An acknowledgement is no proof: a step is done when telemetry or a read-back shows its effect. Only a change
of speed ends with its acknowledgement. `launch` and `swap` have their own modules.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import FlightOrder
from swarmctl.core.mission import MissionItem
from swarmctl.core.setpoint import STOP
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures.guarded import (
    HEARTBEAT_WAIT_S,
    UNTIL_REPLACED_S,
    NotInControl,
    command,
    confirm_state,
    describe_takeover,
    in_modes,
    send_acknowledged,
    send_guarded,
    set_mode,
)
from swarmctl.mavlink.procedures.land import land_by_mission
from swarmctl.mavlink.procedures.launch import launch
from swarmctl.mavlink.procedures.swap.atomic import rejection_text
from swarmctl.mavlink.procedures.swap.choice import lands, swap, swap_takes_s, takes_off
from swarmctl.mavlink.procedures.verified_upload import upload_mission
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import Command
from swarmctl.mavlink.protocol.outcome import Done, Swapped, Uploaded
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.setpoint import setpoint_message
from swarmctl.mavlink.protocol.wait import RequestUntil, SendUntil, WaitUntil, collect_messages
from swarmctl.mavlink.telemetry.vehicle_state import STILL_CLIMB_M_S, STILL_M_S

__all__ = [
    "ORDERS",
    "Done",
    "Swapped",
    "Uploaded",
    "follow_setpoints",
    "hold",
    "identify",
    "land",
    "launch",
    "prepare",
    "return_home",
    "set_speed",
    "swap",
    "upload",
]

MODE_PERIOD_S = 3.0
"""period for setting the hold mode again before the flight"""
MODE_TRIES = 3
SETPOINTS_LAST_S = 10.0
"""time after the last set-point in which a vehicle may still receive or follow set-points [s]"""
STOP_WAIT_S = 10.0
"""longest wait for the stop of a vehicle that has followed set-points"""
SPEED_LASTS_S = 10.0
"""life of a speed command [s]; then the agent decides the speed anew"""
SAME_THROTTLE = -1.0
"""value of the throttle parameter that does not change the throttle"""


def identify(ctx: Context) -> Procedure[Message]:
    """Request AUTOPILOT_VERSION until it arrives; return it."""
    number = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    received: dict[int, tuple[Message, float]] = yield collect_messages(ctx.peer, (number,))
    return received[number][0]


def prepare(ctx: Context) -> Procedure[Done]:
    """Set hold mode, repeatedly if needed, and wait until the vehicle is ready to arm.

    The session requests the telemetry streams. The caller sets the time limit, because a boot may take long.
    """
    while True:
        has_heartbeat = yield RequestUntil(ctx.peer, lambda: True, HEARTBEAT_WAIT_S)
        if ctx.state.armed:
            return Done("the vehicle is already armed; disarm it on the ground, then prepare it [armed]")
        # In the first seconds after boot ArduPilot acknowledges a mode, then leaves that mode silently.
        if has_heartbeat and ctx.state.mode != ctx.dialect.hold_mode:
            params = ctx.dialect.mode_params(ctx.dialect.hold_mode)
            yield Command(ctx.peer, mavlink.MAV_CMD_DO_SET_MODE, *params)
        ready = yield WaitUntil(ctx.after_heartbeat(lambda s: s.ready), MODE_PERIOD_S)
        if ready and ctx.state.ready:
            return Done()
        if has_heartbeat and _item_prevents_arming(ctx):
            yield ctx.dialect.set_current(ctx.peer, ctx.dialect.first_seq or 0, 0)


def _item_prevents_arming(ctx: Context) -> bool:
    """Return whether a disarmed vehicle in hold mode has a current item that prevents arming."""
    state, first = ctx.state, ctx.dialect.first_seq
    is_waiting = state.mode == ctx.dialect.hold_mode and not state.armed
    return is_waiting and not ctx.dialect.arms_at_any_item and state.mission_seq not in (None, 0, first)


def upload(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Uploaded]:
    """Upload a mission to a disarmed vehicle and verify it."""
    if ctx.state.armed:
        # The vehicle may be flying the mission that the upload would overwrite item by item.
        return Uploaded("the vehicle is armed; in flight only a swap changes the mission [armed]")
    begin_s, n_texts = ctx.state.time_boot_s, ctx.telemetry.n_texts
    uploaded = yield from upload_mission(ctx, items, ctx.dialect.first_seq)
    took_s = max(ctx.state.time_boot_s - begin_s, 0.0)
    return Uploaded(
        uploaded.failure or rejection_text(ctx, n_texts), swap_takes_s(ctx.dialect, len(items), took_s)
    )


def hold(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Set hold mode.

    If `check_mode_first`, a new heartbeat also precedes the first command, and a mode that has just changed
    stops the procedure. The same applies to `return_home` and `land`.
    """
    dialect, stop = ctx.dialect, setpoint_message(ctx.peer, STOP)
    # If the hold mode also follows set-points, setting it again does not stop the vehicle.
    stops = dialect.setpoint_mode == dialect.hold_mode and ctx.now - ctx.setpoint_sent_s <= SETPOINTS_LAST_S
    # PX4 may hold because set-points stopped. It would follow the next set-point, but not after a command.
    done = yield from _set_mode_urgently(
        ctx, dialect.hold_mode, check_mode_first=check_mode_first, skip_if_done=False
    )
    if stops and done.failure is None:
        yield SendUntil(stop, lambda: _stands(ctx) or ctx.state.mode != dialect.hold_mode, STOP_WAIT_S)
        if ctx.state.mode != dialect.hold_mode:
            return Done(describe_takeover(ctx.state))
        if not _stands(ctx):
            return Done(f"the vehicle is in hold mode, but still moves after {STOP_WAIT_S:g} s [no-hold]")
    return done


def _stands(ctx: Context) -> bool:
    return ctx.state.ground_speed_m_s < STILL_M_S and abs(ctx.state.climb_m_s) < STILL_CLIMB_M_S


def follow_setpoints(ctx: Context) -> Procedure[Done]:
    """Enter the mode that follows set-points, from mission mode in the air.

    Every other mode is another party's choice. PX4 refuses the mode until it has received a recent set-point,
    so the command is repeated after a refusal.
    """
    dialect, mode = ctx.dialect, ctx.dialect.setpoint_mode
    if mode is None:
        return Done(f"{dialect.firmware} is never led by set-points [no-setpoints]")
    own = {dialect.mission_mode}
    order = command(ctx, mavlink.MAV_CMD_DO_SET_MODE, dialect.mode_params(mode), lasts_s=UNTIL_REPLACED_S)
    try:
        yield from confirm_state(ctx, in_modes(own))
        if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
            return Done("the vehicle is not flying [not-flying]")
        if takes_off(ctx) or lands(ctx):
            return Done("the vehicle is taking off or landing [landing]")
        before, after = in_modes(own, armed=True), in_modes({mode}, armed=True)
        return Done((yield from send_guarded(ctx, order, before, after, skip_first_check=True)))
    except NotInControl as why:
        return Done(str(why))


def return_home(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Set return mode."""
    return _set_mode_urgently(ctx, ctx.dialect.return_mode, check_mode_first=check_mode_first)


def land(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Land by the mission's landing if the dialect has a land command, else by land mode."""
    dialect = ctx.dialect
    if dialect.land_command is None:
        return (yield from _set_mode_urgently(ctx, dialect.land_mode, check_mode_first=check_mode_first))
    return Done((yield from land_by_mission(ctx, dialect.land_command, check_mode_first=check_mode_first)))


ORDERS: Mapping[FlightOrder, Callable[..., Procedure[Done]]] = {
    FlightOrder.HOLD: hold,
    FlightOrder.RETURN: return_home,
    FlightOrder.LAND: land,
}
"""orders that a vehicle gets in any state; the procedures have the parameters of `hold`"""


def set_speed(ctx: Context, speed_m_s: float) -> Procedure[Done]:
    """Set the ground speed or airspeed by MAV_CMD_DO_CHANGE_SPEED, in mission mode only.

    The speed is valid until the mode changes.
    """
    flies = in_modes({ctx.dialect.mission_mode}, armed=True)
    params = float(ctx.dialect.speed_type), speed_m_s, SAME_THROTTLE
    order = command(ctx, mavlink.MAV_CMD_DO_CHANGE_SPEED, params, lasts_s=SPEED_LASTS_S)
    try:
        return Done((yield from send_acknowledged(ctx, order, flies)))
    except NotInControl as why:
        return Done(str(why))


def _set_mode_urgently(
    ctx: Context, mode: str, *, check_mode_first: bool, skip_if_done: bool = True
) -> Procedure[Done]:
    """Set a mode at once, with several tries.

    The first command is sent without a new heartbeat, unless `check_mode_first` is set. The procedure ends
    when a heartbeat shows a mode outside the allowed modes: another party has chosen that mode.
    """
    dialect, failure = ctx.dialect, None
    allowed = {mode, ctx.state.mode}
    if ctx.state.mode == dialect.setpoint_mode:
        allowed.add(dialect.hold_mode)  # the usual mode of a PX4 whose set-points have stopped
    if ctx.interrupted or not check_mode_first:
        # The interrupted procedure may have changed the mode shortly before.
        allowed |= {dialect.hold_mode, dialect.mission_mode}
        if dialect.setpoint_mode is not None:
            allowed.add(dialect.setpoint_mode)
    if not check_mode_first:
        allowed |= {dialect.return_mode, dialect.land_mode}
    try:
        for attempt in range(MODE_TRIES):
            skip_first_check = attempt == 0 and not check_mode_first
            failure = yield from set_mode(
                ctx,
                mode,
                in_modes(allowed),
                skip_if_done=skip_if_done,
                skip_first_check=skip_first_check,
            )
            if failure is None:
                break
    except NotInControl as why:
        return Done(str(why) if failure is None else f"{failure}; {why}")
    return Done(failure)
