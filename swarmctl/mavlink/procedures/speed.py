"""How fast a vehicle flies its mission: MAV_CMD_DO_CHANGE_SPEED, which lasts until the mode changes."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures.guarded import NotInControl, command, in_modes, send_acknowledged
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure

NO_CHANGE = -1.0
"""of the throttle"""


def set_speed(ctx: Context, speed_m_s: float) -> Procedure[Done]:
    """Give it another speed, over ground or through the air, for the rest of its mission; nothing where it
    does not fly one."""
    flies = in_modes({ctx.dialect.mission_mode}, armed=True)
    params = float(ctx.dialect.speed_type), speed_m_s, NO_CHANGE
    order = command(ctx, mavlink.MAV_CMD_DO_CHANGE_SPEED, params)
    try:
        return Done((yield from send_acknowledged(ctx, order, flies)))
    except NotInControl as why:
        return Done(str(why))
