"""Set current item: confirm and change the mission item that a vehicle flies."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.procedures.guarded import (
    UNTIL_REPLACED_S,
    GuardedCommand,
    StateCondition,
    send_guarded,
)
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import RequestUntil

CURRENT_WAIT_S = 3.0
"""longest wait for a MISSION_CURRENT, requested every second: several may be lost"""


def await_current_item(ctx: Context, is_right: Callable[[int], bool]) -> Procedure[bool]:
    """Request MISSION_CURRENT; return whether the last known item fulfils `is_right`."""

    def is_known() -> bool:
        return ctx.state.mission_seq is not None

    yield RequestUntil(
        ctx.peer,
        is_known,
        CURRENT_WAIT_S,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        counts=ctx.has_recent_telemetry,
    )
    return ctx.state.mission_seq is not None and is_right(ctx.state.mission_seq)


def ensure_current_item(ctx: Context, seq: int, before: StateCondition) -> Procedure[str | None]:
    """Make an item current on a vehicle on the ground, unless it already is; return the failure.

    `before`: as for `send_guarded`. Raises NotInControl.
    """
    if (yield from await_current_item(ctx, lambda current: current == seq)):
        return None
    return (yield from set_current_item(ctx, seq, before, lasts_s=UNTIL_REPLACED_S))


def set_current_item(
    ctx: Context, seq: int, before: StateCondition, *, lasts_s: float, skip_first_check: bool = False
) -> Procedure[str | None]:
    """Make an item current; return the failure. Raises NotInControl.

    lasts_s: time from now for which this item is the right one [s]; a vehicle that flies on passes it.
    skip_first_check: as for `send_guarded`
    """
    order = GuardedCommand(lambda attempt: ctx.dialect.set_current(ctx.peer, seq, attempt), ctx.now + lasts_s)

    def is_current(state: VehicleState) -> bool:
        return before(state) and state.mission_seq == seq

    return (yield from send_guarded(ctx, order, before, is_current, skip_first_check=skip_first_check))
