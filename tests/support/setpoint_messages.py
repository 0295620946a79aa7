"""Set-points of position, velocity, acceleration and yaw as messages to vehicle 1."""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

LOCAL, OFFSET = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED
BODY, BODY_OFFSET = mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED
BODY_FRD = mavlink.MAV_FRAME_BODY_FRD
Axes = Sequence[float | None]
NONE: Axes = (None, None, None)


def setpoint(
    position: Axes = NONE,
    velocity: Axes = NONE,
    acceleration: Axes = NONE,
    *,
    yaw: float | None = None,
    frame: int = LOCAL,
    force: bool = False,
) -> Any:
    """North, east, down, or a global position of 1e-7 deg and m; None: ignored in the type mask."""
    values = [*position, *velocity, *acceleration, yaw, None]
    bits = [*range(9), 10, 11]
    mask = sum(1 << bit for bit, value in zip(bits, values, strict=True) if value is None)
    fields = frame, mask | (0x200 if force else 0), *(value or 0 for value in values)
    if frame in (LOCAL, OFFSET, BODY, BODY_OFFSET, BODY_FRD):
        return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, *fields)
    return mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, *fields)
