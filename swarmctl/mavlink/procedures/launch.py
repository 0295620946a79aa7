"""Arm a vehicle and start its mission."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.procedures.guarded import (
    UNTIL_REPLACED_S,
    GuardedCommand,
    NotInControl,
    command,
    in_modes,
    send_guarded,
    set_mode,
)
from swarmctl.mavlink.procedures.set_current import ensure_current_item
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.outcome import Done, LaunchBlocked
from swarmctl.mavlink.protocol.procedure import Context, Procedure

LAUNCH_LASTS_S = 20.0
"""life of a decision to arm, and of one to take off [s]: people and vehicles nearby move on"""
CLIMB_WAIT_S = 20.0
"""longest wait until the vehicle has left the ground"""
BlockedBy = Callable[[], str]
"""function that returns the current obstacle to a take-off as text; empty if there is none"""


class _Blocked(Exception):
    """Another vehicle blocks the take-off."""


def launch(ctx: Context, blocked_by: BlockedBy = lambda: "") -> Procedure[Done]:
    """Arm the vehicle and start its mission; end when the vehicle has left the ground.

    `blocked_by` is called before the first command to arm and before each command to take off.
    """
    if not ctx.verified_items:
        return Done("the vehicle has no verified mission; upload one first [no-mission]")
    if ctx.state.armed:
        return Done(f"the vehicle is already armed, in {ctx.state.mode}; no command was sent [armed]")
    try:
        if failure := (yield from _arm(ctx, blocked_by)):
            return Done(failure)
        return (yield from _take_off(ctx, blocked_by))
    except _Blocked as why:
        return LaunchBlocked(str(why))
    except NotInControl as why:
        return Done(str(why))


def _arm(ctx: Context, blocked_by: BlockedBy) -> Procedure[str | None]:
    """Arm the vehicle in hold mode at the beginning of its mission; return the failure.

    Raises NotInControl, and _Blocked while the vehicle is disarmed.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # The command's life begins here: mode and first item may take long over a bad link.
    arm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), lasts_s=LAUNCH_LASTS_S)
    # An unanswered command may have armed the vehicle, so its repetitions are not blocked.
    arm = _checked(blocked_by, arm, tries=1)
    # After a landing the vehicle stays in mission mode.
    is_disarmed = in_modes({hold, mission}, armed=False)
    failure = yield from set_mode(ctx, hold, is_disarmed, armed=False)
    if failure:
        return failure
    holds_disarmed = in_modes({hold}, armed=False)
    if ctx.dialect.first_seq is not None:
        failure = yield from ensure_current_item(ctx, ctx.dialect.first_seq, holds_disarmed)
        if failure:
            return f"the first mission item cannot be made current: {failure} [no-first-item]"
    failure = yield from send_guarded(ctx, arm, holds_disarmed, in_modes({hold}, armed=True))
    return f"the vehicle does not arm: {failure} [no-arming]" if failure else None


def _take_off(ctx: Context, blocked_by: BlockedBy) -> Procedure[Done]:
    """Start the mission of an armed vehicle; disarm it if it stays on the ground. Raises NotInControl."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    ground_m = ctx.state.alt_rel_m or 0.0
    started = in_modes({mission}, armed=True)
    start = _checked(blocked_by, command(ctx, *ctx.dialect.start_mission, lasts_s=LAUNCH_LASTS_S))
    blocked = ""
    try:
        failure = yield from send_guarded(
            ctx,
            start,
            in_modes({hold}, armed=True),
            started,
            awaited=lambda s: started(s) and _has_left_ground(s, ground_m),
            wait_s=CLIMB_WAIT_S,
        )
    except _Blocked as why:
        failure = blocked = str(why)
    if failure is None:
        return Done()
    if ctx.state.landed is Landed.ON_GROUND:
        # A flying vehicle would refuse this unforced disarming.
        is_armed, is_disarmed = (in_modes({hold, mission}, armed=armed) for armed in (True, False))
        number = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        disarm = command(ctx, number, (0.0,), lasts_s=UNTIL_REPLACED_S)
        yield from send_guarded(ctx, disarm, is_armed, is_disarmed, skip_if_done=True)
    if ctx.state.armed:
        return Done(
            f"the vehicle does not take off and is still armed: {failure} [no-take-off] [no-disarming]"
        )
    if blocked:
        return LaunchBlocked(blocked, was_armed=True)
    return Done(f"the vehicle does not take off: {failure} [no-take-off]")


def _checked(blocked_by: BlockedBy, order: GuardedCommand, tries: int | None = None) -> GuardedCommand:
    """Return `order` with a check before each try, or before the first `tries`: a block raises _Blocked."""

    def next_try(attempt: int) -> Conversation[CommandResult] | None:
        if (tries is None or attempt < tries) and (why := blocked_by()):
            raise _Blocked(why)
        return order.next_try(attempt)

    return replace(order, next_try=next_try)


def _has_left_ground(state: VehicleState, ground_m: float) -> bool:
    flies = state.landed in (Landed.IN_AIR, Landed.TAKEOFF)
    return flies and state.alt_rel_m is not None and state.alt_rel_m > ground_m + 0.5
