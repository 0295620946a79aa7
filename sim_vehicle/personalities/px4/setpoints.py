"""Set-points of PX4 1.15 (`mavlink_receiver.cpp`, `PositionControl.cpp`).

Each axis counts by itself; a value that is not finite is ignored. A message that PX4 receives keeps OFFBOARD
alive, also one that its position control cannot fly: then the vehicle stops.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle import setpoint_target as st
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.setpoint_target import STOP, Target

ABSOLUTE_FRAME = mavlink.MAV_FRAME_GLOBAL_INT
RELATIVE_FRAME = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
TERRAIN_FRAME = mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT


def read_setpoint(vehicle: Vehicle, message: Any) -> Target | None:
    """Return the target of a message; None: the message changes nothing."""
    local = message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    frame, body = message.coordinate_frame, False
    if local:
        body = frame == mavlink.MAV_FRAME_BODY_NED
        if not body and frame != mavlink.MAV_FRAME_LOCAL_NED:
            vehicle.announce("setpoint_frame", kind=message.get_type(), frame=frame)
            return None
        position_m = st.NOTHING if body else _local_m(vehicle, message)
    else:
        if not message.type_mask & st.IGNORE_POSITION and frame not in (
            ABSOLUTE_FRAME,
            RELATIVE_FRAME,
            TERRAIN_FRAME,
        ):
            vehicle.announce("setpoint_global_frame", frame=frame)
            return None
        position_m = _global_m(vehicle, message)
    velocity = _vector(vehicle, message, ("vx", "vy", "vz"), st.IGNORE_VELOCITY, body=body)
    push = _vector(vehicle, message, ("afx", "afy", "afz"), st.IGNORE_ACCELERATION, body=body)
    if any(map(math.isfinite, push)) and message.type_mask & st.FORCE:
        vehicle.announce("setpoint_force", kind=message.get_type())
        return None
    parts = position_m, velocity, push
    if not any(math.isfinite(value) for part in parts for value in part):
        if local:
            vehicle.announce("setpoint_empty")
        return None
    if not _flyable(*parts):
        return STOP
    yaw_rad, yaw_rate_rad_s = st.yaw(message)
    return Target(*parts, yaw_rad=yaw_rad, yaw_rate_rad_s=yaw_rate_rad_s)


def _flyable(*parts: st.Vector) -> bool:
    """Return True if each axis has a value, and north always comes with east."""
    complete = all(any(math.isfinite(part[axis]) for part in parts) for axis in range(3))
    return complete and all(math.isfinite(part[0]) == math.isfinite(part[1]) for part in parts)


def _values(message: Any, names: tuple[str, str, str], ignored: int) -> list[float]:
    """Return the values of three axes; nan for each ignored axis."""
    lowest_bit = ignored & -ignored
    bits = (lowest_bit << axis for axis in range(3))
    values = (
        math.nan if message.type_mask & bit else float(getattr(message, name))
        for name, bit in zip(names, bits, strict=True)
    )
    return [value if math.isfinite(value) else math.nan for value in values]


def _vector(
    vehicle: Vehicle, message: Any, names: tuple[str, str, str], ignored: int, *, body: bool
) -> st.Vector:
    """Return a vector; in the frame of the body one ignored axis ignores the vector."""
    north, east, down = _values(message, names, ignored)
    if body:
        if message.type_mask & ignored:
            return st.NOTHING
        north, east = st.rotated(vehicle, north, east)
    return st.east_north_up(north, east, down)


def _local_m(vehicle: Vehicle, message: Any) -> st.Vector:
    north_m, east_m, down_m = _values(message, ("x", "y", "z"), st.IGNORE_POSITION)
    offset = st.east_north_up(
        *(v if abs(v) < st.MAX_COORDINATE_M else math.nan for v in (north_m, east_m, down_m))
    )
    origin_m = vehicle.home_and_rally.origin_m
    return origin_m[0] + offset[0], origin_m[1] + offset[1], origin_m[2] + offset[2]


def _global_m(vehicle: Vehicle, message: Any) -> st.Vector:
    """Return a global position; one ignored axis ignores the position."""
    lat_deg, lon_deg, alt_m = message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt
    possible = abs(lat_deg) <= 90 and abs(lon_deg) <= 180 and abs(alt_m) < st.MAX_COORDINATE_M
    if message.type_mask & st.IGNORE_POSITION or not possible:
        return st.NOTHING
    up_m = vehicle.flight.altitude_amsl_m(message.coordinate_frame, alt_m)
    if message.coordinate_frame == RELATIVE_FRAME:  # PX4 1.15 takes the origin's height above home twice
        up_m += 2 * (vehicle.home_and_rally.origin_m[2] - vehicle.flight.home().alt_amsl_m)
    return (*vehicle.body.locate(lat_deg, lon_deg), up_m)
