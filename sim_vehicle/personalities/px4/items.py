"""Mission, fence and rally items of PX4: accepted commands and their frames."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.fence import CIRCLES, POLYGONS
from sim_vehicle.vehicle.mission import Item

# Accepted frame of an item with a position -> frame of this item in a download.
READ_BACK_FRAME = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
}

_WITH_POSITION = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
        mavlink.MAV_CMD_NAV_VTOL_LAND,
        mavlink.MAV_CMD_NAV_ROI,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_CONDITION_GATE,
        mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT,
        *POLYGONS,
        *CIRCLES,
        mavlink.MAV_CMD_NAV_RALLY_POINT,
    }
)
# These commands are accepted with and without a position; param1 is the ROI mode.
_ROI_COMMANDS = frozenset({mavlink.MAV_CMD_NAV_ROI, mavlink.MAV_CMD_DO_SET_ROI})
_ROI_MODES_WITH_POSITION = frozenset({mavlink.MAV_ROI_LOCATION, mavlink.MAV_ROI_NONE})
_ROI_MODES_NO_POSITION = frozenset({mavlink.MAV_ROI_NONE, mavlink.MAV_ROI_WPNEXT, mavlink.MAV_ROI_WPINDEX})

# Commands accepted in frame MISSION.
_WITHOUT_POSITION = frozenset(
    {
        mavlink.MAV_CMD_DO_JUMP,
        mavlink.MAV_CMD_NAV_ROI,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_WINCH,
        mavlink.MAV_CMD_DO_GRIPPER,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_SET_HOME,
        mavlink.MAV_CMD_DO_LAND_START,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
        mavlink.MAV_CMD_DO_CONTROL_VIDEO,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_OBLIQUE_SURVEY,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL,
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
        mavlink.MAV_CMD_SET_CAMERA_ZOOM,
        mavlink.MAV_CMD_SET_CAMERA_FOCUS,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION,
        mavlink.MAV_CMD_NAV_DELAY,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_CONDITION_DELAY,
        mavlink.MAV_CMD_CONDITION_DISTANCE,
        mavlink.MAV_CMD_DO_SET_ACTUATOR,
    }
)


def _as_sent(item: Item) -> Item:
    return item


def _yaw_deg(value_deg: float) -> float:
    """Return a yaw as PX4 sends it back: in single precision, by way of 0 to 2 pi."""
    if not math.isfinite(value_deg):
        return value_deg
    yaw = np.float32(math.radians(np.float32(value_deg))) % np.float32(2 * math.pi)
    return float(np.float32(math.degrees(yaw)))


def _flag(value: float) -> float:
    return float(value > 0)


# Command -> the item as `format_mavlink_mission_item` of PX4 1.15 (mavlink_mission.cpp) sends it back.
_PARAMETERS: dict[int, Callable[[Item], Item]] = {
    mavlink.MAV_CMD_NAV_WAYPOINT: lambda i: replace(i, param3=0.0, param4=_yaw_deg(i.param4)),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda i: replace(i, param1=0.0, param2=0.0, param4=_yaw_deg(i.param4)),
    mavlink.MAV_CMD_NAV_LOITER_TIME: lambda i: replace(i, param2=_flag(i.param2), param4=_flag(i.param4)),
    mavlink.MAV_CMD_NAV_LAND: lambda i: replace(i, param1=0.0, param3=0.0, param4=_yaw_deg(i.param4)),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: lambda i: replace(
        i, param1=_flag(i.param1), param3=0.0, param4=_flag(i.param4)
    ),
    **dict.fromkeys(
        (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_LAND),
        lambda i: replace(i, param1=0.0, param2=0.0, param3=0.0, param4=_yaw_deg(i.param4)),
    ),
}


def store_item(item: Item) -> Item | int:
    """Return PX4's stored form of an item, or the MAV_MISSION_RESULT of a refusal.

    PX4 checks no other value than the ROI mode: a NaN altitude, a latitude of 100 degrees and a jump to a
    missing item are stored and sent back. PX4 drops the parameters that it does not use.
    """
    if item.frame in READ_BACK_FRAME:
        commands, roi_modes, frame = _WITH_POSITION, _ROI_MODES_WITH_POSITION, READ_BACK_FRAME[item.frame]
    elif item.frame == mavlink.MAV_FRAME_MISSION:
        commands, roi_modes, frame = _WITHOUT_POSITION, _ROI_MODES_NO_POSITION, item.frame
    else:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if item.command not in commands:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if item.command in _ROI_COMMANDS and not (math.isfinite(item.param1) and int(item.param1) in roi_modes):
        return int(mavlink.MAV_MISSION_INVALID_PARAM1)
    return _PARAMETERS.get(item.command, _as_sent)(replace(item, frame=frame))
