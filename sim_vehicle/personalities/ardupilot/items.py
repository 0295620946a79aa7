"""Stored form of mission items on ArduPilot: commands, frames, and the roundings of the storage.

An item has 15 bytes, so most parameters are stored as small integers or not at all.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.params import as_float32

MAX_ALTITUDE_M = 83_000.0  # largest altitude in the storage

_STORED_FRAME = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_MISSION: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}

Parameters = tuple[float, float, float, float]
Keep = Callable[[float], float]


def _no(_value: float) -> float:
    return 0.0


def _real(value: float) -> float:
    return as_float32(value)


def _integer(lowest: int, highest: int) -> Keep:
    return lambda value: float(min(max(int(value), lowest), highest))


_u8, _u16, _i8, _i16 = _integer(0, 255), _integer(0, 65_535), _integer(-128, 127), _integer(-32_768, 32_767)


def _switch(value: float) -> float:
    return 1.0 if value > 0 else 0.0


def _signed_radius(value: float) -> float:
    return math.copysign(_u16(abs(value)), value) if value else 0.0


def _way_round(value: float) -> float:
    return -1.0 if value < 0 else 1.0


def _turns(value: float) -> float:
    """Return turns as stored: whole up to 255; less than one in 256ths."""
    return int(value * 256) / 256 if 0 < value < 1 else _u8(value)


def _small_radius(value: float) -> float:
    """Return a radius as stored: a byte of metres, or of tens of metres."""
    radius_m = abs(value)
    kept_m = int(radius_m) if radius_m <= 255 else min(255, int(radius_m * 0.1)) * 10
    return math.copysign(kept_m, value) if kept_m else 0.0


# Command -> storage of parameters 1 to 4, for commands with a position ...
_PLACED: dict[int, tuple[Keep, Keep, Keep, Keep]] = {
    mavlink.MAV_CMD_NAV_WAYPOINT: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: (_no, _no, _signed_radius, _no),
    mavlink.MAV_CMD_NAV_LOITER_TURNS: (_turns, _no, _small_radius, _switch),
    mavlink.MAV_CMD_NAV_LOITER_TIME: (_u16, _no, _way_round, _switch),
    mavlink.MAV_CMD_NAV_LAND: (_u16, _no, _no, _way_round),
    mavlink.MAV_CMD_NAV_TAKEOFF: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: (_no, _signed_radius, _no, _switch),
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: (_no, _no, _no, _no),
    mavlink.MAV_CMD_NAV_VTOL_LAND: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_SET_HOME: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_RETURN_PATH_START: (_no, _no, _no, _no),
    mavlink.MAV_CMD_DO_LAND_START: (_no, _no, _no, _no),
    mavlink.MAV_CMD_DO_GO_AROUND: (_no, _no, _no, _no),
    mavlink.MAV_CMD_DO_SET_ROI: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: (_u16, _no, _no, _no),
}
# ... and without one.
_PLACELESS: dict[int, tuple[Keep, Keep, Keep, Keep]] = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: (_no, _no, _no, _no),
    mavlink.MAV_CMD_NAV_DELAY: (_real, _i8, _i8, _i8),
    mavlink.MAV_CMD_CONDITION_DELAY: (_real, _no, _no, _no),
    mavlink.MAV_CMD_CONDITION_DISTANCE: (_real, _no, _no, _no),
    mavlink.MAV_CMD_CONDITION_YAW: (_real, _real, _i8, _u8),
    mavlink.MAV_CMD_DO_JUMP: (_u16, _i16, _no, _no),
    mavlink.MAV_CMD_DO_CHANGE_SPEED: (_u8, _real, _real, _no),
    mavlink.MAV_CMD_DO_SET_RELAY: (_u8, _u8, _no, _no),
    mavlink.MAV_CMD_DO_REPEAT_RELAY: (_u8, _i16, _real, _no),
    mavlink.MAV_CMD_DO_SET_SERVO: (_u8, _u16, _no, _no),
    mavlink.MAV_CMD_DO_REPEAT_SERVO: (_u8, _u16, _i16, _real),
    mavlink.MAV_CMD_DO_SET_ROI_NONE: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE: (_u8, _u16, _u8, _u8),
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: (_u8, _u8, _i8, _u8),
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: (_real, _real, _real, _no),
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST: (_real, _no, _u8, _no),
    mavlink.MAV_CMD_DO_FENCE_ENABLE: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_PARACHUTE: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_GRIPPER: (_u8, _u8, _no, _no),
    mavlink.MAV_CMD_DO_AUTOTUNE_ENABLE: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_SET_RESUME_REPEAT_DIST: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_SPRAYER: (_u16, _no, _no, _no),
    mavlink.MAV_CMD_DO_AUX_FUNCTION: (_u16, _u8, _no, _no),
    mavlink.MAV_CMD_DO_WINCH: (_u8, _u8, _real, _real),
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: (_real, _real, _real, _real),
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: (_u8, _real, _u16, _u16),
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: (_u8, _no, _no, _no),
    mavlink.MAV_CMD_SET_CAMERA_ZOOM: (_u8, _real, _no, _no),
    mavlink.MAV_CMD_SET_CAMERA_FOCUS: (_u8, _real, _no, _no),
    mavlink.MAV_CMD_VIDEO_START_CAPTURE: (_u8, _no, _no, _no),
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE: (_u8, _no, _no, _no),
}
# Commands that store x, y and z although they are no position.
_WITH_MORE = frozenset(
    {
        mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    }
)
# Indices of parameters that can be NaN; infinity is always refused.
_MAY_BE_NAN = {
    mavlink.MAV_CMD_NAV_WAYPOINT: {4},
    mavlink.MAV_CMD_NAV_LAND: {4},
    mavlink.MAV_CMD_NAV_TAKEOFF: {4},
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: {4},
    mavlink.MAV_CMD_NAV_VTOL_LAND: {3, 4},
}
_PLANE_PLACED = _PLACED | {mavlink.MAV_CMD_NAV_WAYPOINT: (_no, _u8, _u8, _no)}
del _PLANE_PLACED[mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT]


def store_item(item: Item) -> Item | int:
    """Return ArduCopter's stored form of an item, or the MAV_MISSION_RESULT of a refusal."""
    return _store(item, _PLACED)


def store_plane_item(item: Item) -> Item | int:
    """Return ArduPlane's stored form; a waypoint keeps its radii and loses its delay."""
    return _store(item, _PLANE_PLACED)


def _store(item: Item, placed: dict[int, tuple[Keep, Keep, Keep, Keep]]) -> Item | int:
    refusal = _refused_parameter(item)
    if refusal is not None:
        return refusal
    if item.command in _PLACELESS:
        return _without_place(item, _kept(item, _PLACELESS[item.command]))
    if item.command not in placed:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    refusal = _refused_place(item)
    if refusal is not None:
        return refusal
    param1, param2, param3, param4 = _kept(item, placed[item.command])
    return Item(
        item.command,
        frame=_STORED_FRAME[item.frame],
        param1=param1,
        param2=param2,
        param3=param3,
        param4=param4,
        x=item.x,
        y=item.y,
        z=as_float32(whole_centimetres(item.z) / 100.0),
    )


def _refused_parameter(item: Item) -> int | None:
    if item.command in (0, 1):  # reserved by the storage
        return int(mavlink.MAV_MISSION_INVALID)
    may_be_nan = _MAY_BE_NAN.get(item.command, set())
    for index, value in enumerate((item.param1, item.param2, item.param3, item.param4), start=1):
        if math.isinf(value) or (math.isnan(value) and index not in may_be_nan):
            return int(mavlink.MAV_MISSION_INVALID_PARAM1) + index - 1
    return None


def _refused_place(item: Item) -> int | None:
    if abs(item.x) > 900_000_000:
        return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    if abs(item.y) > 1_800_000_000:
        return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    if not abs(item.z) < MAX_ALTITUDE_M:
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return None if item.frame in _STORED_FRAME else int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)


def _kept(item: Item, how: tuple[Keep, Keep, Keep, Keep]) -> Parameters:
    values = (item.param1, item.param2, item.param3, item.param4)
    first, second, third, fourth = (
        keep(0.0 if math.isnan(value) else value) for keep, value in zip(how, values, strict=True)
    )
    return first, second, third, fourth


def _without_place(item: Item, parameters: Parameters) -> Item:
    if item.command not in _WITH_MORE:
        return Item(item.command, 0, *parameters)
    z = as_float32(item.z) if math.isfinite(item.z) else 0.0
    return Item(item.command, 0, *parameters, x=item.x, y=item.y, z=z)


def whole_centimetres(z_m: float) -> int:
    """Convert altitude [m] to [cm], truncated in single precision as on the autopilot."""
    return int(as_float32(as_float32(z_m) * 100.0))
