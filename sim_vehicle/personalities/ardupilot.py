"""ArduCopter 4.6.2 as it shows itself on the wire."""

import math
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.mission import Item
from sim_vehicle.params import as_float32
from sim_vehicle.personalities.base import Behaviour, Mode, Personality

MAX_ALTITUDE_M = 83_000.0  # what fits into the storage of an altitude

_MODES = (
    Mode(0, "STABILIZE", Behaviour.DROP, armable=True, needs_position=False),
    Mode(2, "ALT_HOLD", Behaviour.SINK, armable=True, needs_position=False),
    Mode(3, "AUTO", Behaviour.MISSION),
    Mode(4, "GUIDED", Behaviour.GUIDED, armable=True),
    Mode(5, "LOITER", Behaviour.SINK, armable=True),
    Mode(6, "RTL", Behaviour.RETURN),
    Mode(7, "CIRCLE", Behaviour.SINK),
    Mode(9, "LAND", Behaviour.LAND, needs_position=False),
    Mode(16, "POSHOLD", Behaviour.SINK, armable=True),
    Mode(17, "BRAKE", Behaviour.BRAKE),
)

_PARAMETERS = {
    "ARMING_CHECK": 1,  # 0: only what cannot be waived is checked
    "AUTO_OPTIONS": 0,  # bit 0: AUTO can be armed; bit 1: take-off without raising the throttle
    "BATT_CAPACITY": 3300,  # mAh
    "DISARM_DELAY": 10,  # s, 0 never
    "FS_GCS_ENABLE": 0,  # 0 nothing, 1 RTL, 5 LAND
    "FS_GCS_TIMEOUT": 5,  # s
    "LAND_ALT_LOW": 1000,  # cm above home, below which LAND_SPEED applies
    "LAND_SPEED": 50,  # cm/s
    "LAND_SPEED_HIGH": 0,  # cm/s, 0: WPNAV_SPEED_DN
    "MIS_RESTART": 0,  # 1: AUTO starts at the beginning
    "PILOT_SPEED_DN": 0,  # cm/s, 0: PILOT_SPEED_UP
    "PILOT_SPEED_UP": 250,  # cm/s
    "RTL_ALT": 1500,  # cm above home
    "RTL_LOIT_TIME": 5000,  # ms
    "RTL_SPEED": 0,  # cm/s, 0: WPNAV_SPEED
    "SIM_BATT_VOLTAGE": 12.6,  # V, full and at rest
    "SYSID_MYGCS": 255,
    "SYSID_THISMAV": 1,
    "WPNAV_ACCEL": 250,  # cm/s/s
    "WPNAV_ACCEL_Z": 100,  # cm/s/s
    "WPNAV_RADIUS": 200,  # cm
    "WPNAV_SPEED": 1000,  # cm/s
    "WPNAV_SPEED_DN": 150,  # cm/s
    "WPNAV_SPEED_UP": 250,  # cm/s
}

_STREAMS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}

_BOOT_TEXT = (
    b"\n\nInit ArduCopter V4.6.2 (sim_vehicle)",
    b"\n\nFree RAM: 131072\n",
    b"load_all took 48us\n",
)

_STORED_FRAME = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_MISSION: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}

_WITH_PLACE = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
    }
)
_WITHOUT_PLACE = frozenset(
    {
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_JUMP,
        mavlink.MAV_CMD_CONDITION_DELAY,
    }
)


def store_item(item: Item) -> Item | int:
    """What ArduCopter keeps of an item, with its roundings; or the MAV_MISSION_RESULT it refuses it with."""
    if item.command not in _WITH_PLACE | _WITHOUT_PLACE:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    refusal = _refused_parameter(item)
    if refusal is not None:
        return refusal
    if item.command in _WITHOUT_PLACE:
        return _without_place(item)
    if item.frame not in _STORED_FRAME:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    return _with_place(item)


def _refused_parameter(item: Item) -> int | None:
    # param4 (yaw) of a command with a place may be NaN.
    checked = (item.param1, item.param2, item.param3)
    for code, value in enumerate(checked, start=mavlink.MAV_MISSION_INVALID_PARAM1):
        if not math.isfinite(value):
            return code
    if math.isinf(item.param4) or (math.isnan(item.param4) and item.command in _WITHOUT_PLACE):
        return int(mavlink.MAV_MISSION_INVALID_PARAM4)
    if item.command in _WITH_PLACE:
        if abs(item.x) > 900_000_000:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.y) > 1_800_000_000:
            return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    if not math.isfinite(item.z) or abs(item.z) >= MAX_ALTITUDE_M:
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return None


def _without_place(item: Item) -> Item:
    if item.command == mavlink.MAV_CMD_DO_JUMP:
        return Item(item.command, param1=_unsigned(item.param1, 65_535), param2=float(int(item.param2)))
    if item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
        return Item(item.command, param1=_unsigned(item.param1), param2=item.param2, param3=item.param3)
    if item.command == mavlink.MAV_CMD_CONDITION_DELAY:
        return Item(item.command, param1=item.param1)
    return Item(item.command)


def _with_place(item: Item) -> Item:
    whole_param1 = _unsigned(item.param1, 65_535)
    param3 = param4 = 0.0
    if item.command in (mavlink.MAV_CMD_NAV_LOITER_TIME, mavlink.MAV_CMD_NAV_LOITER_UNLIM):
        param3 = -1.0 if item.param3 < 0 else 1.0  # only the direction is kept
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TIME:
        param4 = 1.0 if item.param4 > 0 else 0.0
    if item.command == mavlink.MAV_CMD_NAV_LAND:
        param4 = -1.0 if item.param4 < 0 else 1.0
    if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
        whole_param1 = 0.0
    return Item(
        item.command,
        frame=_STORED_FRAME[item.frame],
        param1=whole_param1,
        param3=param3,
        param4=param4,
        x=item.x,
        y=item.y,
        z=as_float32(whole_centimetres(item.z) / 100.0),
    )


def whole_centimetres(z_m: float) -> int:
    """Altitude [m] -> [cm], cut toward zero in single precision as the autopilot computes it."""
    return int(as_float32(as_float32(z_m) * 100.0))


def _unsigned(value: float, maximum: int = 255) -> float:
    return float(min(max(int(value), 0), maximum))


ARDUPILOT = Personality(
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
    modes=MappingProxyType({mode.number: mode for mode in _MODES}),
    boot_mode=0,
    boot_text=_BOOT_TEXT,
    flight_sw_version=0x040602FF,  # 4.6.2, official release
    capabilities=mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2,
    parameters=MappingProxyType({name: float(value) for name, value in _PARAMETERS.items()}),
    read_only_parameters=frozenset({"SYSID_THISMAV"}),
    streams=MappingProxyType(_STREAMS),
    store_item=store_item,
    max_mission_items=650,
)
