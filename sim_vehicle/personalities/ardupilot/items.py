"""Stored form of mission items on ArduPilot: commands, frames, and the roundings of the storage.

An item has 15 bytes, so most parameters are stored as small integers or not at all.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot.stores import MAX_LATITUDE_E7, MAX_LONGITUDE_E7, STORED_FRAME
from sim_vehicle.vehicle.command import MAX_ALTITUDE_M
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.params import as_float32

# A mission also accepts frame MISSION, unlike a fence and rally points.
_MISSION_FRAME = STORED_FRAME | {mavlink.MAV_FRAME_MISSION: mavlink.MAV_FRAME_GLOBAL}

ItemParameters = tuple[float, float, float, float]
Rounding = Callable[[float], float]  # value received -> value stored
Roundings = tuple[Rounding, Rounding, Rounding, Rounding]


def _zero(_value: float) -> float:
    return 0.0


def _integer(lowest: int, highest: int) -> Rounding:
    return lambda value: float(min(max(int(value), lowest), highest))


_u8, _u16, _i8, _i16 = _integer(0, 255), _integer(0, 65_535), _integer(-128, 127), _integer(-32_768, 32_767)


def _switch(value: float) -> float:
    return 1.0 if value > 0 else 0.0


def _signed_radius(value: float) -> float:
    return math.copysign(_u16(abs(value)), value) if value else 0.0


def _direction(value: float) -> float:
    """Return -1 (counter-clockwise) or 1 (clockwise)."""
    return -1.0 if value < 0 else 1.0


def _turns(value: float) -> float:
    """Return a number of turns as stored: whole turns up to 255, or 256ths of a turn below 1."""
    return int(value * 256) / 256 if 0 < value < 1 else _u8(value)


def _small_radius(value: float) -> float:
    """Return a radius [m] as stored: one byte in metres, or in tens of metres above 255 m."""
    radius_m = abs(value)
    stored_m = int(radius_m) if radius_m <= 255 else min(255, int(radius_m * 0.1)) * 10
    return math.copysign(stored_m, value) if stored_m else 0.0


# Command -> rounding of parameters 1 to 4, for commands with a position
_WITH_POSITION: dict[int, Roundings] = {
    mavlink.MAV_CMD_NAV_WAYPOINT: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: (_zero, _zero, _signed_radius, _zero),
    mavlink.MAV_CMD_NAV_LOITER_TURNS: (_turns, _zero, _small_radius, _switch),
    mavlink.MAV_CMD_NAV_LOITER_TIME: (_u16, _zero, _direction, _switch),
    mavlink.MAV_CMD_NAV_LAND: (_u16, _zero, _zero, _direction),
    mavlink.MAV_CMD_NAV_TAKEOFF: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: (_zero, _signed_radius, _zero, _switch),
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: (_zero, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_VTOL_LAND: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_SET_HOME: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_RETURN_PATH_START: (_zero, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_LAND_START: (_zero, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_GO_AROUND: (_zero, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_SET_ROI: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: (_u16, _zero, _zero, _zero),
}
# Command -> rounding of parameters 1 to 4, for commands without a position
_WITHOUT_POSITION: dict[int, Roundings] = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: (_zero, _zero, _zero, _zero),
    mavlink.MAV_CMD_NAV_DELAY: (as_float32, _i8, _i8, _i8),
    mavlink.MAV_CMD_CONDITION_DELAY: (as_float32, _zero, _zero, _zero),
    mavlink.MAV_CMD_CONDITION_DISTANCE: (as_float32, _zero, _zero, _zero),
    mavlink.MAV_CMD_CONDITION_YAW: (as_float32, as_float32, _i8, _u8),
    mavlink.MAV_CMD_DO_JUMP: (_u16, _i16, _zero, _zero),
    mavlink.MAV_CMD_DO_CHANGE_SPEED: (_u8, as_float32, as_float32, _zero),
    mavlink.MAV_CMD_DO_SET_RELAY: (_u8, _u8, _zero, _zero),
    mavlink.MAV_CMD_DO_REPEAT_RELAY: (_u8, _i16, as_float32, _zero),
    mavlink.MAV_CMD_DO_SET_SERVO: (_u8, _u16, _zero, _zero),
    mavlink.MAV_CMD_DO_REPEAT_SERVO: (_u8, _u16, _i16, as_float32),
    mavlink.MAV_CMD_DO_SET_ROI_NONE: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE: (_u8, _u16, _u8, _u8),
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: (_u8, _u8, _i8, _u8),
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: (as_float32, as_float32, as_float32, _zero),
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST: (as_float32, _zero, _u8, _zero),
    mavlink.MAV_CMD_DO_FENCE_ENABLE: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_PARACHUTE: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_GRIPPER: (_u8, _u8, _zero, _zero),
    mavlink.MAV_CMD_DO_AUTOTUNE_ENABLE: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_SET_RESUME_REPEAT_DIST: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_SPRAYER: (_u16, _zero, _zero, _zero),
    mavlink.MAV_CMD_DO_AUX_FUNCTION: (_u16, _u8, _zero, _zero),
    mavlink.MAV_CMD_DO_WINCH: (_u8, _u8, as_float32, as_float32),
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: (as_float32, as_float32, as_float32, as_float32),
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: (_u8, as_float32, _u16, _u16),
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: (_u8, _zero, _zero, _zero),
    mavlink.MAV_CMD_SET_CAMERA_ZOOM: (_u8, as_float32, _zero, _zero),
    mavlink.MAV_CMD_SET_CAMERA_FOCUS: (_u8, as_float32, _zero, _zero),
    mavlink.MAV_CMD_VIDEO_START_CAPTURE: (_u8, _zero, _zero, _zero),
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE: (_u8, _zero, _zero, _zero),
}
# Commands that store x, y and z with another meaning than a position.
_WITH_OTHER_XYZ = frozenset(
    {
        mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    }
)
# Numbers of the parameters (1 to 4) that can be NaN; infinity is always refused.
_MAY_BE_NAN = {
    mavlink.MAV_CMD_NAV_WAYPOINT: {4},
    mavlink.MAV_CMD_NAV_LAND: {4},
    mavlink.MAV_CMD_NAV_TAKEOFF: {4},
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: {4},
    mavlink.MAV_CMD_NAV_VTOL_LAND: {3, 4},
}
_PLANE_WITH_POSITION = _WITH_POSITION | {mavlink.MAV_CMD_NAV_WAYPOINT: (_zero, _u8, _u8, _zero)}
del _PLANE_WITH_POSITION[mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT]


def store_item(item: Item) -> Item | int:
    """Return ArduCopter's stored form of an item, or the MAV_MISSION_RESULT of a refusal."""
    return _store(item, _WITH_POSITION)


def store_plane_item(item: Item) -> Item | int:
    """Return ArduPlane's stored form of an item, or the MAV_MISSION_RESULT of a refusal.

    A waypoint keeps the acceptance radius and the pass-by distance, but no delay.
    """
    return _store(item, _PLANE_WITH_POSITION)


def _store(item: Item, with_position: dict[int, Roundings]) -> Item | int:
    refusal = _refused_parameter(item)
    if refusal is not None:
        return refusal
    if item.command in _WITHOUT_POSITION:
        return _item_without_position(item, _rounded(item, _WITHOUT_POSITION[item.command]))
    if item.command not in with_position:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    refusal = _refused_position(item)
    if refusal is not None:
        return refusal
    param1, param2, param3, param4 = _rounded(item, with_position[item.command])
    return Item(
        item.command,
        frame=_MISSION_FRAME[item.frame],
        param1=param1,
        param2=param2,
        param3=param3,
        param4=param4,
        x=item.x,
        y=item.y,
        z=as_float32(int(as_float32(as_float32(item.z) * 100.0)) / 100.0),  # whole centimetres
    )


def _refused_parameter(item: Item) -> int | None:
    if item.command in (0, 1):  # reserved by the storage
        return int(mavlink.MAV_MISSION_INVALID)
    may_be_nan = _MAY_BE_NAN.get(item.command, set())
    for number, value in enumerate((item.param1, item.param2, item.param3, item.param4), start=1):
        if math.isinf(value) or (math.isnan(value) and number not in may_be_nan):
            return int(mavlink.MAV_MISSION_INVALID_PARAM1) + number - 1
    return None


def _refused_position(item: Item) -> int | None:
    if abs(item.x) > MAX_LATITUDE_E7:
        return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    if abs(item.y) > MAX_LONGITUDE_E7:
        return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    if not abs(item.z) < MAX_ALTITUDE_M:
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return None if item.frame in _MISSION_FRAME else int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)


def _rounded(item: Item, roundings: Roundings) -> ItemParameters:
    values = (item.param1, item.param2, item.param3, item.param4)
    first, second, third, fourth = (
        rounding(0.0 if math.isnan(value) else value)
        for rounding, value in zip(roundings, values, strict=True)
    )
    return first, second, third, fourth


def _item_without_position(item: Item, parameters: ItemParameters) -> Item:
    if item.command not in _WITH_OTHER_XYZ:
        return Item(item.command, 0, *parameters)
    z = as_float32(item.z) if math.isfinite(item.z) else 0.0
    return Item(item.command, 0, *parameters, x=item.x, y=item.y, z=z)
