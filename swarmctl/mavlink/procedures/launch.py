"""Arm a vehicle and start its mission."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.procedures.guarded import (
    CommandFactory,
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

CLIMB_WAIT_S = 20.0
"""until it has left the ground"""
BlockedBy = Callable[[], str]
"""Who is in the way of the take-off just now, in words; empty where nobody is."""


class _Blocked(Exception):
    """Somebody is in the way; nothing was sent."""


def launch(ctx: Context, in_the_way: BlockedBy = lambda: "") -> Procedure[Done]:
    """Arm and start the mission that is on the vehicle; done when it leaves the ground.

    `in_the_way` is asked right before it is armed and right before it takes off.
    """
    if not ctx.verified_items:
        return Done("no verified mission is on the vehicle; upload one first")
    if ctx.state.armed:
        return Done(f"it is armed already, in {ctx.state.mode}; nothing was sent")
    try:
        if failure := (yield from _armed(ctx, in_the_way)):
            return Done(failure)
        return (yield from _take_off(ctx, in_the_way))
    except _Blocked as why:
        return LaunchBlocked(str(why))
    except NotInControl as why:
        return Done(str(why))


def _armed(ctx: Context, in_the_way: BlockedBy) -> Procedure[str | None]:
    """At the beginning of its mission, in its hold mode. Raises NotInControl, and _Blocked before it arms it."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # After a landing it stands there in its mission mode.
    stands = in_modes({hold, mission}, armed=False)
    failure = yield from set_mode(ctx, hold, stands, armed=False)
    if failure:
        return failure
    holds = in_modes({hold}, armed=False)
    if ctx.dialect.first_seq is not None:
        failure = yield from ensure_current_item(ctx, ctx.dialect.first_seq, holds)
        if failure:
            return f"it does not begin its mission at the beginning: {failure}"
    arm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,))
    # An order to arm that is not answered may have been taken: it is seen through.
    arm = _unless(in_the_way, arm, tries=1)
    failure = yield from send_guarded(ctx, arm, holds, in_modes({hold}, armed=True))
    return f"it does not arm: {failure}" if failure else None


def _take_off(ctx: Context, in_the_way: BlockedBy) -> Procedure[Done]:
    """Of one that is armed. Raises NotInControl."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    ground_m = ctx.state.alt_rel_m or 0.0
    started = in_modes({mission}, armed=True)
    start = _unless(in_the_way, command(ctx, *ctx.dialect.start_mission))
    blocked = ""
    try:
        failure = yield from send_guarded(
            ctx,
            start,
            in_modes({hold}, armed=True),
            started,
            seen=lambda s: started(s) and _has_left_ground(s, ground_m),
            wait_s=CLIMB_WAIT_S,
        )
    except _Blocked as why:
        failure = blocked = str(why)
    if failure is None:
        return Done()
    if ctx.state.landed is Landed.ON_GROUND:
        # Armed, on the ground and not going anywhere: an ordinary disarm, which a flying vehicle refuses.
        still, stands = (in_modes({hold, mission}, armed=armed) for armed in (True, False))
        disarm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))
        yield from send_guarded(ctx, disarm, still, stands, skip_if_done=True)
    if blocked and not ctx.state.armed:
        return LaunchBlocked(blocked, was_armed=True)
    return Done(f"it does not take off: {failure}" + ("; and it does not disarm" if blocked else ""))


def _unless(in_the_way: BlockedBy, order: CommandFactory, tries: int | None = None) -> CommandFactory:
    """An order that is not given while somebody is in the way: none of its first `tries`; None: never.
    Raises _Blocked."""

    def given(attempt: int) -> Conversation[CommandResult]:
        if (tries is None or attempt < tries) and (why := in_the_way()):
            raise _Blocked(why)
        return order(attempt)

    return given


def _has_left_ground(state: VehicleState, ground_m: float) -> bool:
    flies = state.landed in (Landed.IN_AIR, Landed.TAKEOFF)
    return flies and state.alt_rel_m is not None and state.alt_rel_m > ground_m + 0.5
