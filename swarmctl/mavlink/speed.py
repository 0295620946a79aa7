"""How fast a vehicle flies its mission: MAV_CMD_DO_CHANGE_SPEED, which lasts until the mode changes."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.command import Command, CommandOutcome, CommandResult
from swarmctl.mavlink.guarded import TRIES, HandsOff, in_modes, look
from swarmctl.mavlink.outcome import Done
from swarmctl.mavlink.procedure import Context, Procedure

NO_CHANGE = -1.0
"""of the throttle"""


def set_speed(ctx: Context, speed_m_s: float) -> Procedure[Done]:
    """Give it another speed, over ground or through the air, for the rest of its mission; nothing where it
    does not fly one."""
    flies = in_modes({ctx.dialect.mission_mode}, armed=True)
    params = float(ctx.dialect.speed_type), speed_m_s, NO_CHANGE
    failure: str | None = None
    for attempt in range(TRIES):
        try:
            yield from look(ctx, flies)
        except HandsOff as why:
            return Done(str(why))
        command = Command(ctx.peer, mavlink.MAV_CMD_DO_CHANGE_SPEED, *params, confirmation=attempt)
        result: CommandResult = yield command
        failure = None if result.outcome is CommandOutcome.ACCEPTED else result.text
        if result.final:
            break
    return Done(failure)
