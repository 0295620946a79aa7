"""Set-points on the wire: SET_POSITION_TARGET_GLOBAL_INT with a height above the sea.

One message serves ArduPilot and PX4. Both convert its position by the origin of their estimator, as they do
for GLOBAL_POSITION_INT. A height above home is not usable: PX4 1.15 subtracts the origin's height twice
(`MavlinkReceiver::handle_message_set_position_target_global_int`). A local frame needs the origin, which
changes after a reboot or a command.

Yaw and acceleration are ignored: ArduPilot faces its course, PX4 keeps its heading.
"""

from __future__ import annotations

from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.setpoint import SetPoint
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import MavlinkPeer

_NO_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_NO_ACCELERATION_NO_YAW = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)


def setpoint_message(peer: MavlinkPeer, setpoint: SetPoint) -> Message:
    """Return the message of a set-point.

    Raises ValueError for a number that is not finite, and for a position without a height or the reverse.
    """
    at, alt_m = setpoint.at, setpoint.alt_amsl_m
    position = (0.0, 0.0, 0.0) if at is None or alt_m is None else (*at, alt_m)
    if (at is None) != (alt_m is None) or not all(map(isfinite, (*setpoint.velocity_m_s, *position))):
        raise ValueError(
            f"set-point: expected finite numbers, and a position with its height, found {setpoint}"
        )
    lat_deg, lon_deg, alt_amsl_m = position
    east_m_s, north_m_s, up_m_s = setpoint.velocity_m_s
    return mavlink.MAVLink_set_position_target_global_int_message(
        0,  # time since boot, read by neither firmware
        peer.sysid,
        peer.compid,
        mavlink.MAV_FRAME_GLOBAL_INT,
        _NO_ACCELERATION_NO_YAW | (_NO_POSITION if at is None else 0),
        round(lat_deg * 1e7),
        round(lon_deg * 1e7),
        alt_amsl_m,
        north_m_s,
        east_m_s,
        -up_m_s,
        *(0.0, 0.0, 0.0),  # acceleration
        *(0.0, 0.0),  # yaw and its rate
    )
