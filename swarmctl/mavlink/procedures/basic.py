"""Procedures of a ground station: identify, prepare, upload, hold, return, land, speed.

An acknowledgement is no proof: a step is done when telemetry or a read-back shows its effect. Only a change
of speed ends with its acknowledgement. `launch` and `swap` have their own modules.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import (
    HEARTBEAT_WAIT_S,
    NotInControl,
    command,
    in_modes,
    send_acknowledged,
    set_mode,
)
from swarmctl.mavlink.procedures.land import land_by_mission
from swarmctl.mavlink.procedures.launch import launch
from swarmctl.mavlink.procedures.swap.atomic import rejection_text
from swarmctl.mavlink.procedures.swap.choice import swap, swap_takes_s
from swarmctl.mavlink.procedures.verified_upload import upload_mission
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import Command
from swarmctl.mavlink.protocol.outcome import Done, Swapped, Uploaded
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import RequestMessage, RequestUntil, WaitUntil

__all__ = [
    "Done",
    "Swapped",
    "Uploaded",
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
SPEED_LASTS_S = 10.0
"""life of a speed command [s]; then the agent decides the speed anew"""
SAME_THROTTLE = -1.0
"""value of the throttle parameter that does not change the throttle"""


def identify(ctx: Context) -> Procedure[Message]:
    """Request AUTOPILOT_VERSION until it arrives; return it."""
    version = yield RequestMessage(ctx.peer, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return version


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
    return Done(
        (yield from _set_mode_urgently(ctx, ctx.dialect.hold_mode, check_mode_first=check_mode_first))
    )


def return_home(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Set return mode."""
    return Done(
        (yield from _set_mode_urgently(ctx, ctx.dialect.return_mode, check_mode_first=check_mode_first))
    )


def land(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Land by the mission's landing if the dialect has a land command, else by land mode."""
    if ctx.dialect.land_command is not None:
        return Done(
            (yield from land_by_mission(ctx, ctx.dialect.land_command, check_mode_first=check_mode_first))
        )
    return Done(
        (yield from _set_mode_urgently(ctx, ctx.dialect.land_mode, check_mode_first=check_mode_first))
    )


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


def _set_mode_urgently(ctx: Context, mode: str, *, check_mode_first: bool) -> Procedure[str | None]:
    """Set a mode at once, with several tries; return the failure.

    The first command is sent without a new heartbeat, unless `check_mode_first` is set. The procedure ends
    when a heartbeat shows a mode outside the allowed modes: another party has chosen that mode.
    """
    dialect, failure = ctx.dialect, None
    allowed = {mode, ctx.state.mode}
    if ctx.interrupted or not check_mode_first:
        # The interrupted procedure may have changed the mode shortly before.
        allowed |= {dialect.hold_mode, dialect.mission_mode}
    if not check_mode_first:
        allowed |= {dialect.return_mode, dialect.land_mode}
    try:
        for attempt in range(MODE_TRIES):
            skip_first_check = attempt == 0 and not check_mode_first
            failure = yield from set_mode(ctx, mode, in_modes(allowed), skip_first_check=skip_first_check)
            if failure is None:
                break
    except NotInControl as why:
        return str(why) if failure is None else f"{failure}; {why}"
    return failure
