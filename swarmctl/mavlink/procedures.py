"""The jobs of a ground station, each from top to bottom: identify, prepare, upload, launch, swap, hold ...

Acknowledgements are not believed: every step is done when the telemetry shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import Command
from swarmctl.mavlink.guarded import (
    HEARTBEAT_WAIT_S,
    MODE_ENABLED,
    HandsOff,
    foreign,
    guarded,
    in_modes,
    look,
    set_mode,
)
from swarmctl.mavlink.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.mission_upload import Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.wait import Ask, Look, Until, wait

MODE_AGAIN_S = 3.0
"""how often a mode that did not stay is set again before the flight"""
CLIMB_WAIT_S = 20.0
"""until it has left the ground"""
CLIMB_LIMIT_S = 60.0
"""until it is up at its take-off altitude"""
MOVE_WAIT_S = 10.0
MODE_TRIES = 3
UPLOAD_TRIES = 3
DOWNLOAD_TRIES = 4


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
        heard = yield Look(ctx.peer, lambda: True, HEARTBEAT_WAIT_S)
        if ctx.state.armed:
            return Done("it is armed already; prepare it on the ground, disarmed")
        # A mode set in the first seconds after boot is acknowledged and silently undone.
        if heard and ctx.state.mode != ctx.dialect.hold_mode:
            number = float(ctx.dialect.mode_number(ctx.dialect.hold_mode))
            yield Command(ctx.peer, mavlink.MAV_CMD_DO_SET_MODE, MODE_ENABLED, number)
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
    may_start = in_modes({hold}, armed=True)
    failure = yield from guarded(
        ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), in_modes({hold}, armed=False), may_start
    )
    if failure:
        return f"it does not arm: {failure}"
    ground_m = ctx.state.alt_rel_m or 0.0
    started = in_modes({mission}, armed=True)
    failure = yield from guarded(
        ctx,
        mavlink.MAV_CMD_MISSION_START,
        (),
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
        yield from guarded(
            ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,), still, stands, skip_if_done=True
        )
    return f"it does not take off: {failure}"


def _has_left_ground(state: VehicleState, ground_m: float) -> bool:
    flies = state.landed in (Landed.IN_AIR, Landed.TAKEOFF)
    return flies and state.alt_rel_m is not None and state.alt_rel_m > ground_m + 0.5


def swap(ctx: Context, new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    """Replace the mission of a flying vehicle as a transaction.

    The upload of some firmwares is not atomic and steers a vehicle that flies the mission with every item,
    so: hold, upload, read back, set the current item, fly; or go back to the old mission the same way; or
    stay in hold. Nothing is touched any more where somebody else has chosen another mode.
    """
    old = ctx.on_vehicle
    # Held on its first metres it would go on to the first waypoint from down there.
    yield Until(lambda: not _takes_off(ctx), CLIMB_LIMIT_S)
    if ctx.state.mode not in (ctx.dialect.hold_mode, ctx.dialect.mission_mode):
        return Swapped(foreign(ctx.state))
    if not ctx.state.armed or ctx.state.landed is Landed.ON_GROUND:
        return Swapped("it is not flying", "old" if old else "unknown")
    if _takes_off(ctx) or ctx.state.landed is Landed.LANDING:
        return Swapped("it takes off or lands just now", "old" if old else "unknown")
    try:
        return (yield from _swap(ctx, old, new))
    except HandsOff as why:
        return Swapped(str(why), "unknown")


def _swap(ctx: Context, old: tuple[MissionItem, ...], new: tuple[MissionItem, ...]) -> Procedure[Swapped]:
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    failure = yield from set_mode(ctx, hold, in_modes({hold, mission}, armed=True), armed=True)
    if failure:
        yield from look(ctx, in_modes({mission}, armed=True))
        return Swapped(f"it does not hold: {failure}", "old" if old else "unknown")
    failure = yield from _fly_from_hold(ctx, new)
    if not failure:
        return Swapped(None, "new")
    if old:
        second = yield from _fly_from_hold(ctx, old)
        if not second:
            return Swapped(failure, "old")
        failure = f"{failure}; back to the old mission: {second}"
    yield from look(ctx, in_modes({hold}, armed=True))
    return Swapped(failure, "hold")


def _takes_off(ctx: Context) -> bool:
    seq = ctx.state.mission_seq
    return (
        ctx.state.mode == ctx.dialect.mission_mode
        and seq is not None
        and seq < ctx.dialect.first_waypoint_seq
    )


def _fly_from_hold(ctx: Context, items: tuple[MissionItem, ...]) -> Procedure[str | None]:
    """Upload to a vehicle that holds, and see it fly the mission from its first waypoint.

    Where that fails it holds again. Raises HandsOff where somebody else has it.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    holds = in_modes({hold}, armed=True)
    yield from look(ctx, holds)
    uploaded: Done = yield from _put(ctx, items)
    if uploaded.failure:
        return uploaded.failure
    first = ctx.dialect.first_waypoint_seq
    failure = yield from guarded(
        ctx,
        mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
        (float(first),),
        holds,
        lambda s: holds(s) and s.mission_seq == first,
    )
    if failure:
        return failure
    failure = yield from set_mode(ctx, mission, holds, armed=True)
    if not failure:
        # The last position may be of the way to where it held.
        since_s = ctx.state.time_boot_s
        yield Until(
            lambda: _flies_on(ctx, first, since_s) or ctx.state.mode not in (hold, mission), MOVE_WAIT_S
        )
        if _flies_on(ctx, first, since_s):
            return None
        failure = f"it does not fly on: {ctx.state.mode}, item {ctx.state.mission_seq}"
    back = yield from set_mode(ctx, hold, in_modes({hold, mission}, armed=True), armed=True)
    if back:
        raise HandsOff(f"{failure}; nor does it hold: {back}")
    return failure


def _flies_on(ctx: Context, first: int, since_s: float) -> bool:
    state, last = ctx.state, len(ctx.on_vehicle) - 1
    if state.mode != ctx.dialect.mission_mode or state.mission_seq is None or state.time_boot_s <= since_s:
        return False
    moves = state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3
    return first < state.mission_seq <= last or (state.mission_seq == first and moves)


def hold(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.hold_mode)))


def return_home(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.return_mode)))


def land(ctx: Context) -> Procedure[Done]:
    return Done((yield from _insist(ctx, ctx.dialect.land_mode)))


def _insist(ctx: Context, mode: str) -> Procedure[str | None]:
    """What the operator wants now: at once and more than once, also against one that has just booted.

    But only the first time unseen: once the vehicle has told of a mode that was neither there before nor is
    one of ours, somebody else has chosen it since.
    """
    dialect = ctx.dialect
    ours = {dialect.hold_mode, dialect.mission_mode, dialect.return_mode, dialect.land_mode, ctx.state.mode}
    failure: str | None = None
    try:
        for attempt in range(MODE_TRIES):
            failure = yield from set_mode(ctx, mode, in_modes(ours), at_once=attempt == 0)
            if failure is None:
                break
    except HandsOff as why:
        return str(why) if failure is None else f"{failure}; {why}"
    return failure
