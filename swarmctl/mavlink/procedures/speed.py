"""Speed of a vehicle on its mission: MAV_CMD_DO_CHANGE_SPEED, which lasts until the mode changes."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures.guarded import NotInControl, command, in_modes, send_acknowledged
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure

NO_CHANGE = -1.0
"""value of the throttle parameter that leaves the throttle as it is"""


def set_speed(ctx: Context, speed_m_s: float) -> Procedure[Done]:
    """Set the ground speed or airspeed for the rest of the mission; sends nothing outside mission mode."""
    flies = in_modes({ctx.dialect.mission_mode}, armed=True)
    params = float(ctx.dialect.speed_type), speed_m_s, NO_CHANGE
    order = command(ctx, mavlink.MAV_CMD_DO_CHANGE_SPEED, params)
    try:
        return Done((yield from send_acknowledged(ctx, order, flies)))
    except NotInControl as why:
        return Done(str(why))
