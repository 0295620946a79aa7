"""Set-points of ArduCopter 4.6 (`GCS_Mavlink.cpp`, `mode_guided.cpp`).

One ignored axis ignores the whole position, velocity or acceleration. A message that ArduCopter cannot use
stops the vehicle, except a force, which it does not read.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot.commands import FRAMES_WITH_ALTITUDE
from sim_vehicle.vehicle import setpoint_target as st
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.setpoint_target import STOP, Target

BODY_FRAMES = frozenset({mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED})
LOCAL_FRAMES = BODY_FRAMES | {mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED}
TERRAIN_FRAMES = frozenset({mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT})
MAX_VELOCITY_M_S = 1000.0


def read_setpoint(vehicle: Vehicle, message: Any) -> Target | None:
    """Return the target of a message; None: the message changes nothing."""
    mask, frame = message.type_mask, message.coordinate_frame
    local = message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    if local and frame not in LOCAL_FRAMES:
        return STOP
    has_position = not mask & st.IGNORE_POSITION
    has_velocity = not mask & st.IGNORE_VELOCITY
    has_acceleration = not mask & st.IGNORE_ACCELERATION
    if mask & st.FORCE and has_acceleration:
        return None
    # a position with an acceleration needs a velocity
    if not (has_velocity or has_position != has_acceleration):
        return STOP
    velocity = (message.vx, message.vy, message.vz)
    if has_velocity and not all(abs(v) <= MAX_VELOCITY_M_S for v in velocity):  # nan too
        return STOP
    position_m = st.NOTHING
    if has_position:
        place_m = _local_m(vehicle, message) if local else _global_m(vehicle, message, alone=not has_velocity)
        if place_m is None:
            return STOP
        position_m = place_m
        if not all(map(math.isfinite, position_m)) or _outside_fence(vehicle, position_m):
            return None
    body = local and frame in BODY_FRAMES
    # SET_POSITION_TARGET_GLOBAL_INT loses the acceleration beside a position
    pushes = has_acceleration and (local or not has_position)
    push = _vector(vehicle, message.afx, message.afy, message.afz, body=body) if pushes else st.NOTHING
    if pushes and not all(map(math.isfinite, push)):
        return None
    yaw_rad, yaw_rate_rad_s = st.yaw(message)
    if body and yaw_rad is not None:
        yaw_rad, yaw_rate_rad_s = vehicle.body.heading_rad + yaw_rad, None
    return Target(
        position_m=position_m,
        velocity_m_s=_vector(vehicle, *velocity, body=body) if has_velocity else st.NOTHING,
        acceleration_m_s2=push,
        yaw_rad=yaw_rad,
        yaw_rate_rad_s=yaw_rate_rad_s,
    )


def _vector(vehicle: Vehicle, x: float, y: float, z: float, *, body: bool) -> st.Vector:
    north, east = st.rotated(vehicle, x, y) if body else (x, y)
    return st.east_north_up(north, east, z)


def _local_m(vehicle: Vehicle, message: Any) -> st.Vector:
    """Return a position in a local frame; nan beyond MAX_COORDINATE_M."""
    if not all(abs(v) < st.MAX_COORDINATE_M for v in (message.x, message.y, message.z)):
        return st.NOTHING
    frame = message.coordinate_frame
    offset = _vector(vehicle, message.x, message.y, message.z, body=frame in BODY_FRAMES)
    at_origin = frame == mavlink.MAV_FRAME_LOCAL_NED
    east_m, north_m, up_m = vehicle.home_and_rally.origin_m if at_origin else vehicle.body.position_m
    return east_m + offset[0], north_m + offset[1], up_m + offset[2]


def _global_m(vehicle: Vehicle, message: Any, *, alone: bool) -> st.Vector | None:
    """Return a global position; None: not usable. A height above terrain needs a position `alone`."""
    lat_deg, lon_deg, frame = message.lat_int * 1e-7, message.lon_int * 1e-7, message.coordinate_frame
    if abs(lat_deg) > 90 or abs(lon_deg) > 180 or frame not in FRAMES_WITH_ALTITUDE:
        return None
    if frame in TERRAIN_FRAMES and not alone:
        return None
    if not abs(message.alt) < st.MAX_COORDINATE_M:  # nan too
        return st.NOTHING
    return (*vehicle.body.locate(lat_deg, lon_deg), vehicle.flight.altitude_amsl_m(frame, message.alt))


def _outside_fence(vehicle: Vehicle, position_m: st.Vector) -> bool:
    watch = vehicle.fence_watch
    return watch.enabled and bool(watch.find(*vehicle.body.place_deg(*position_m[:2]), position_m[2]))
