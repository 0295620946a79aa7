"""The jobs of a ground station, each from top to bottom: identify, prepare, upload, launch, swap, hold ...

Acknowledgements are not believed: every step is done when the telemetry shows it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import Command, CommandOutcome, CommandResult
from swarmctl.mavlink.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.mission_upload import Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.wait import Ask, Until, wait

HEARTBEAT_WAIT_S = 5.0
"""a heartbeat a second, and several may be lost"""
MODE_AGAIN_S = 3.0
"""how often a mode that did not stay is set again before the flight"""
CLIMB_WAIT_S = 20.0
"""until it has left the ground"""
CLIMB_LIMIT_S = 60.0
"""until it is up at its take-off altitude"""
MOVE_WAIT_S = 10.0
TEXT_WAIT_S = 0.5
MODE_TRIES = 3
UPLOAD_TRIES = 3
DOWNLOAD_TRIES = 4

_WARNING = int(mavlink.MAV_SEVERITY_WARNING)


@dataclass(frozen=True, slots=True)
class Done:
    """How a procedure ended; `failure` is None when it did what it is named after."""

    failure: str | None = None


@dataclass(frozen=True, slots=True)
class Swapped(Done):
    """How a swap ended, and what the vehicle flies now."""

    flying: Literal["new", "old", "hold", "unknown"] = "unknown"


def identify(ctx: Context) -> Procedure[Message]:
    """AUTOPILOT_VERSION, asked for until it comes."""
    version = yield Ask(ctx.peer, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return version


def prepare(ctx: Context) -> Procedure[Done]:
    """Until it would arm: set the mode that its readiness is judged in, again and again, and wait.

    The streams are kept coming by the session. Has no time limit of its own: booting takes what it takes.
    """
    while True:
        if ctx.state.armed:
            return Done("it is armed already; prepare it on the ground, disarmed")
        # A mode set in the first seconds after boot is acknowledged and silently undone.
        if ctx.state.mode != ctx.dialect.hold_mode:
            yield _mode_command(ctx, ctx.dialect.hold_mode)
        ready = yield Until(ctx.after_heartbeat(lambda s: s.ready), MODE_AGAIN_S)
        if ready and ctx.state.ready:
            return Done()


def upload(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Done]:
    """Put a mission on a vehicle that stands on the ground, verified."""
    if ctx.state.armed:
        # It might fly the mission that we write over, item by item.
        return Done("it is armed; the mission of a flying vehicle is swapped")
    return (yield from _put(ctx, items))


def _put(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[Done]:
    """Upload, read back, compare; tried again after what another try can cure.

    Ends without failure only if exactly `items` are on the vehicle.
    """
    ctx.on_vehicle = ()
    failure = "not tried"
    for attempt in range(UPLOAD_TRIES):
        if attempt:
            # A vehicle still in the old transfer would take items of the new one into it.
            yield wait(ctx.dialect.upload_timeout_s)
        result: UploadResult = yield Upload(ctx.peer, items)
        failure = result.text
        if result.outcome is UploadOutcome.REJECTED:
            return Done(failure)
        if result.outcome in (UploadOutcome.DENIED, UploadOutcome.NO_ANSWER):
            continue
        # Also after a time-out: the items may all be there and only the last word lost.
        found = yield from _read_back(ctx)
        if found.outcome is DownloadOutcome.COMPLETE:
            gaps = ctx.dialect.differences(items, found.items)
            if not gaps:
                ctx.on_vehicle = found.items
                return Done()
            failure = f"{failure}; read back: {gaps[0]}"
        else:
            failure = f"{failure}; {found.text}"
    return Done(failure)


def _read_back(ctx: Context) -> Procedure[DownloadResult]:
    result: DownloadResult = yield Download(ctx.peer)
    for _ in range(DOWNLOAD_TRIES - 1):
        if result.outcome is not DownloadOutcome.REFUSED:
            break
        # DENIED while it has not yet given up an upload.
        yield wait(ctx.dialect.upload_timeout_s / (DOWNLOAD_TRIES - 1))
        result = yield Download(ctx.peer)
    return result


def launch(ctx: Context) -> Procedure[Done]:
    """Arm and start the mission that is on the vehicle; done when it leaves the ground."""
    if not ctx.on_vehicle:
        return Done("no verified mission is on the vehicle; upload one first")
    if ctx.state.armed:
        return Done("it is armed already")
    failure = yield from set_mode(ctx, ctx.dialect.hold_mode)
    if failure:
        return Done(failure)
    failure = yield from _command_seen(
        ctx, Command(ctx.peer, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0), lambda s: s.armed
    )
    if failure:
        return Done(f"it does not arm: {failure}")
    ground_m = ctx.state.alt_rel_m or 0.0
    failure = yield from _command_seen(
        ctx,
        Command(ctx.peer, mavlink.MAV_CMD_MISSION_START),
        lambda s: s.mode == ctx.dialect.mission_mode and _has_left_ground(s, ground_m),
        wait_s=CLIMB_WAIT_S,
    )
    if failure and ctx.state.landed is Landed.ON_GROUND:
        # Armed, on the ground and not going anywhere: an ordinary disarm, which a flying vehicle refuses.
        yield Command(ctx.peer, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    return Done(f"it does not take off: {failure}" if failure else None)


def _has_left_ground(state: VehicleState, ground_m: float) -> bool:
    flies = state.landed in (Landed.IN_AIR, Landed.TAKEOFF)
    return flies and state.alt_rel_m is not None and state.alt_rel_m > ground_m + 0.5


def swap(ctx: Context, new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    """Replace the mission of a flying vehicle as a transaction.

    The upload of some firmwares is not atomic and steers a vehicle that flies the mission with every item,
    so: hold, upload, read back, set the current item, fly; or go back to the old mission the same way; or
    stay in hold. Nothing is touched where somebody else has chosen another mode.
    """
    old = ctx.on_vehicle
    # Held on its first metres it would go on to the first waypoint from down there.
    yield Until(lambda: not _takes_off(ctx), CLIMB_LIMIT_S)
    if ctx.state.mode not in (ctx.dialect.hold_mode, ctx.dialect.mission_mode):
        return Swapped(f"its mode is {ctx.state.mode}, set by its pilot, its failsafe or another station")
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("it is not flying", "old" if old else "unknown")
    if _takes_off(ctx) or ctx.state.landed is Landed.LANDING:
        return Swapped("it takes off or lands just now", "old" if old else "unknown")
    failure = yield from set_mode(ctx, ctx.dialect.hold_mode)
    mode = (yield from _mode_now(ctx)) if failure else ctx.dialect.hold_mode
    if mode != ctx.dialect.hold_mode:
        flies_old = mode == ctx.dialect.mission_mode and old
        return Swapped(f"it does not hold: {failure}", "old" if flies_old else "unknown")
    failure = yield from _fly_from_hold(ctx, new)
    if not failure:
        return Swapped(None, "new")
    holds = yield from _returns_to_hold(ctx)
    if holds and old:
        second = yield from _fly_from_hold(ctx, old)
        if not second:
            return Swapped(failure, "old")
        failure = f"{failure}; back to the old mission: {second}"
        holds = yield from _returns_to_hold(ctx)
    return Swapped(failure, "hold" if holds else "unknown")


def _takes_off(ctx: Context) -> bool:
    seq = ctx.state.mission_seq
    return (
        ctx.state.mode == ctx.dialect.mission_mode
        and seq is not None
        and seq < ctx.dialect.first_waypoint_seq
    )


def _fly_from_hold(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[str | None]:
    """Upload to a vehicle that holds, and see it fly the mission from its first waypoint."""
    uploaded: Done = yield from _put(ctx, items)
    if uploaded.failure:
        return uploaded.failure
    if ctx.state.mode != ctx.dialect.hold_mode:
        return f"its mode became {ctx.state.mode} meanwhile"
    first = ctx.dialect.first_waypoint_seq
    failure = yield from _command_seen(
        ctx,
        Command(ctx.peer, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, float(first)),
        lambda s: s.mission_seq == first,
        lags=False,
    )
    if failure:
        return failure
    if ctx.state.mode != ctx.dialect.hold_mode:
        return f"its mode became {ctx.state.mode} meanwhile"
    failure = yield from set_mode(ctx, ctx.dialect.mission_mode)
    if failure:
        return failure
    flies = yield Until(lambda: _flies_on(ctx, first), MOVE_WAIT_S)
    return None if flies else f"it does not fly on: {ctx.state.mode}, item {ctx.state.mission_seq}"


def _flies_on(ctx: Context, first: int) -> bool:
    state, last = ctx.state, len(ctx.on_vehicle) - 1
    if state.mode != ctx.dialect.mission_mode or state.mission_seq is None:
        return False
    moves = state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3
    return first < state.mission_seq <= last or (state.mission_seq == first and moves)


def _returns_to_hold(ctx: Context) -> Procedure[bool]:
    """Hold again, unless somebody else has taken the vehicle over."""
    mode = yield from _mode_now(ctx)
    if mode not in ("", ctx.dialect.hold_mode, ctx.dialect.mission_mode):
        return False
    failure = yield from set_mode(ctx, ctx.dialect.hold_mode)
    return failure is None or (yield from _mode_now(ctx)) == ctx.dialect.hold_mode


def _mode_now(ctx: Context) -> Procedure[str]:
    """The mode in its next heartbeat, or "" if none comes."""
    heard = yield Until(ctx.after_heartbeat(lambda _: True), HEARTBEAT_WAIT_S)
    return ctx.state.mode if heard else ""


def hold(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.hold_mode)))


def return_home(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.return_mode)))


def land(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.land_mode)))


def _insist(ctx: Context, mode: str) -> Procedure[str | None]:
    """For what the operator wants: more than one try, also against a vehicle that has just booted."""
    failure: str | None = None
    for _ in range(MODE_TRIES):
        failure = yield from set_mode(ctx, mode)
        if failure is None:
            break
    return failure


def set_mode(ctx: Context, mode: str) -> Procedure[str | None]:
    """Command a mode and see it in a heartbeat; returns the failure."""
    return (yield from _command_seen(ctx, _mode_command(ctx, mode), _in_mode(mode)))


def _in_mode(mode: str) -> Callable[[VehicleState], bool]:
    return lambda s: s.mode == mode


def _mode_command(ctx: Context, mode: str) -> Command:
    custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    return Command(ctx.peer, mavlink.MAV_CMD_DO_SET_MODE, custom, float(ctx.dialect.mode_number(mode)))


def _command_seen(
    ctx: Context,
    command: Command,
    seen: Callable[[VehicleState], bool],
    *,
    wait_s: float = HEARTBEAT_WAIT_S,
    lags: bool = True,
) -> Procedure[str | None]:
    """Send a command and see its effect, where it `lags` only after a new heartbeat; returns the failure.

    A command without an answer may still have been taken, so only a refusal ends the matter at once. The
    reasons for refusals come as STATUSTEXT, before or after the acknowledgement.
    """
    texts_before = len(ctx.telemetry.texts)
    fresh = ctx.after_heartbeat(seen)
    result: CommandResult = yield command
    if result.outcome is CommandOutcome.REFUSED:
        yield wait(TEXT_WAIT_S)
    elif (yield Until(fresh if lags or not result.accepted else lambda: seen(ctx.state), wait_s)):
        return None
    said = [text for severity, text in ctx.telemetry.texts[texts_before:] if severity <= _WARNING]
    suffix = f" (the vehicle says: {'; '.join(said[-3:])})" if said else ""
    not_seen = ", but it was not seen to happen" if result.accepted else ""
    return f"{result.text}{not_seen}{suffix}"
