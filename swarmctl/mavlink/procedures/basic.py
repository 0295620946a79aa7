"""The jobs of a ground station, each from top to bottom: identify, prepare, upload, launch, swap, hold ...

Acknowledgements are not believed: every step is done when the telemetry shows it. The longer ones have a
file each: `launching`, `swapping`.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import HEARTBEAT_WAIT_S, NotInControl, command, in_modes, set_mode
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
    "swap",
    "upload",
]

MODE_AGAIN_S = 3.0
"""how often a mode that did not stay is set again before the flight"""
MODE_TRIES = 3


def identify(ctx: Context) -> Procedure[Message]:
    """AUTOPILOT_VERSION, asked for until it comes."""
    version = yield RequestMessage(ctx.peer, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return version


def prepare(ctx: Context) -> Procedure[Done]:
    """Until it would arm: set the mode that its readiness is judged in, again and again, and wait.

    The streams are kept coming by the session. Has no time limit of its own: booting takes what it takes.
    """
    while True:
        heard = yield RequestUntil(ctx.peer, lambda: True, HEARTBEAT_WAIT_S)
        if ctx.state.armed:
            return Done("it is armed already; prepare it on the ground, disarmed")
        # A mode set in the first seconds after boot is acknowledged and silently undone.
        if heard and ctx.state.mode != ctx.dialect.hold_mode:
            yield command(ctx, mavlink.MAV_CMD_DO_SET_MODE, ctx.dialect.mode_params(ctx.dialect.hold_mode))(0)
        ready = yield WaitUntil(ctx.after_heartbeat(lambda s: s.ready), MODE_AGAIN_S)
        if ready and ctx.state.ready:
            return Done()
        if heard and _is_left_amid_a_mission(ctx):
            yield ctx.dialect.set_current(ctx.peer, ctx.dialect.first_seq or 0, 0)


def _is_left_amid_a_mission(ctx: Context) -> bool:
    """Whether it stands there where it would not arm for the item that it flew last."""
    state, first = ctx.state, ctx.dialect.first_seq
    stands = state.mode == ctx.dialect.hold_mode and not state.armed
    return stands and not ctx.dialect.arms_anywhere and state.mission_seq not in (None, 0, first)


def upload(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Uploaded]:
    """Put a mission on a vehicle that stands on the ground, verified."""
    if ctx.state.armed:
        # It might fly the mission that we write over, item by item.
        return Uploaded("it is armed; the mission of a flying vehicle is swapped")
    begin_s, n_texts = ctx.state.time_boot_s, ctx.telemetry.n_texts
    uploaded = yield from upload_mission(ctx, items, ctx.dialect.first_seq)
    took_s = max(ctx.state.time_boot_s - begin_s, 0.0)
    return Uploaded(
        uploaded.failure or complaint(ctx, n_texts), swap_takes_s(ctx.dialect, len(items), took_s)
    )


def hold(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    """`check_mode_first`, as of `return_home` and `land`: sent only where a new heartbeat shows a mode of ours."""
    return Done((yield from _insist(ctx, ctx.dialect.hold_mode, check_mode_first=check_mode_first)))


def return_home(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.return_mode, check_mode_first=check_mode_first)))


def land(ctx: Context, *, check_mode_first: bool = False) -> Procedure[Done]:
    if ctx.dialect.land_command is not None:
        return Done(
            (yield from land_by_mission(ctx, ctx.dialect.land_command, check_mode_first=check_mode_first))
        )
    return Done((yield from _insist(ctx, ctx.dialect.land_mode, check_mode_first=check_mode_first)))


def _insist(ctx: Context, mode: str, *, check_mode_first: bool) -> Procedure[str | None]:
    """What the operator wants now: at once and more than once, also against one that has just booted.

    But only the first time unseen: once the vehicle has told of a mode that was neither there before nor is
    one of ours, somebody else has chosen it since. What no person has ordered never goes out unseen.
    """
    dialect, failure = ctx.dialect, None
    ours = {mode, ctx.state.mode}
    if ctx.interrupted or not check_mode_first:
        # What was interrupted may just have changed the mode.
        ours |= {dialect.hold_mode, dialect.mission_mode}
    if not check_mode_first:
        ours |= {dialect.return_mode, dialect.land_mode}
    try:
        for attempt in range(MODE_TRIES):
            at_once = attempt == 0 and not check_mode_first
            failure = yield from set_mode(ctx, mode, in_modes(ours), at_once=at_once)
            if failure is None:
                break
    except NotInControl as why:
        return str(why) if failure is None else f"{failure}; {why}"
    return failure
