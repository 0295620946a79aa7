"""Procedures of a ground station: identify, prepare, upload, hold, return, land, speed.

An acknowledgement is no proof: a step is done when telemetry shows it. Longer procedures have modules of
their own, such as `launch` and `swap`.
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
from swarmctl.mavlink.procedures.swap.atomic import complaint
from swarmctl.mavlink.procedures.swap.choice import swap, swap_takes_s
from swarmctl.mavlink.procedures.verified_upload import upload_mission
from swarmctl.mavlink.protocol.codec import Message
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

MODE_AGAIN_S = 3.0
"""period for setting the hold mode again before the flight"""
MODE_TRIES = 3
NO_CHANGE = -1.0
"""value of the throttle parameter that leaves the throttle as it is"""


def identify(ctx: Context) -> Procedure[Message]:
    """Return AUTOPILOT_VERSION, requested until it comes."""
    version = yield RequestMessage(ctx.peer, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return version


def prepare(ctx: Context) -> Procedure[Done]:
    """Set hold mode, again if it does not stay, and wait until the vehicle is ready to arm.

    The session keeps the telemetry streams. The caller sets the time limit, because a boot may take long.
    """
    while True:
        heard = yield RequestUntil(ctx.peer, lambda: True, HEARTBEAT_WAIT_S)
        if ctx.state.armed:
            return Done("the vehicle is armed already; prepare it on the ground, disarmed [armed]")
        # ArduPilot acknowledges a mode set in the first seconds after boot, then undoes it silently.
        if heard and ctx.state.mode != ctx.dialect.hold_mode:
            yield command(ctx, mavlink.MAV_CMD_DO_SET_MODE, ctx.dialect.mode_params(ctx.dialect.hold_mode))(0)
        ready = yield WaitUntil(ctx.after_heartbeat(lambda s: s.ready), MODE_AGAIN_S)
        if ready and ctx.state.ready:
            return Done()
        if heard and _is_stopped_midway(ctx):
            yield ctx.dialect.set_current(ctx.peer, ctx.dialect.first_seq or 0, 0)


def _is_stopped_midway(ctx: Context) -> bool:
    """Return whether the vehicle holds disarmed at a mission item that keeps it from arming."""
    state, first = ctx.state, ctx.dialect.first_seq
    is_waiting = state.mode == ctx.dialect.hold_mode and not state.armed
    return is_waiting and not ctx.dialect.arms_anywhere and state.mission_seq not in (None, 0, first)


def upload(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Uploaded]:
    """Upload a mission to a disarmed vehicle and verify it."""
    if ctx.state.armed:
        # The vehicle may be flying the mission that the upload would overwrite item by item.
        return Uploaded("the vehicle is armed; in flight a mission is changed by a swap [armed]")
    begin_s, n_texts = ctx.state.time_boot_s, ctx.telemetry.n_texts
    uploaded = yield from upload_mission(ctx, items, ctx.dialect.first_seq)
    took_s = max(ctx.state.time_boot_s - begin_s, 0.0)
    return Uploaded(
        uploaded.failure or complaint(ctx, n_texts), swap_takes_s(ctx.dialect, len(items), took_s)
    )


def hold(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Set hold mode.

    `check_mode_first`, here and in `return_home` and `land`: the first command, too, waits for a new
    heartbeat that shows one of this program's own modes.
    """
    return Done((yield from _insist(ctx, ctx.dialect.hold_mode, check_mode_first=check_mode_first)))


def return_home(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Set return mode."""
    return Done((yield from _insist(ctx, ctx.dialect.return_mode, check_mode_first=check_mode_first)))


def land(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """Land by the mission's landing or by land mode, whichever the dialect knows."""
    if ctx.dialect.land_command is not None:
        return Done(
            (yield from land_by_mission(ctx, ctx.dialect.land_command, check_mode_first=check_mode_first))
        )
    return Done((yield from _insist(ctx, ctx.dialect.land_mode, check_mode_first=check_mode_first)))


def set_speed(ctx: Context, speed_m_s: float) -> Procedure[Done]:
    """Set the ground speed or airspeed by MAV_CMD_DO_CHANGE_SPEED; sends nothing outside mission mode.

    The speed lasts until the mode changes.
    """
    flies = in_modes({ctx.dialect.mission_mode}, armed=True)
    params = float(ctx.dialect.speed_type), speed_m_s, NO_CHANGE
    order = command(ctx, mavlink.MAV_CMD_DO_CHANGE_SPEED, params)
    try:
        return Done((yield from send_acknowledged(ctx, order, flies)))
    except NotInControl as why:
        return Done(str(why))


def _insist(ctx: Context, mode: str, *, check_mode_first: bool) -> Procedure[str | None]:
    """Set a mode that the operator needs now, at once and several times; return the failure.

    Only the first command goes out without a new heartbeat. The procedure ends when a heartbeat shows a mode
    that is neither the earlier one nor one of this program's own: another party has chosen it. A command that
    no operator has ordered always waits for a new heartbeat (`check_mode_first`).
    """
    dialect, failure = ctx.dialect, None
    own_modes = {mode, ctx.state.mode}
    if ctx.interrupted or not check_mode_first:
        # The interrupted procedure may just have changed the mode.
        own_modes |= {dialect.hold_mode, dialect.mission_mode}
    if not check_mode_first:
        own_modes |= {dialect.return_mode, dialect.land_mode}
    try:
        for attempt in range(MODE_TRIES):
            skip_first_check = attempt == 0 and not check_mode_first
            failure = yield from set_mode(ctx, mode, in_modes(own_modes), skip_first_check=skip_first_check)
            if failure is None:
                break
    except NotInControl as why:
        return str(why) if failure is None else f"{failure}; {why}"
    return failure
