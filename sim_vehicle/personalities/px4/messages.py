"""Default streams of PX4, and messages that PX4 sends on request."""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import (
    AVAILABLE_MODES,
    CURRENT_EVENT_SEQUENCE,
    CURRENT_MODE,
    PROTOCOL_VERSION,
    TIME_ESTIMATE_TO_TARGET,
    DefinedMessage,
)
from sim_vehicle.personalities.px4 import modes
from sim_vehicle.vehicle import one_shot_messages
from sim_vehicle.vehicle.behaviour import PILOTED, Mode
from sim_vehicle.vehicle.commands import reported_interval_us
from sim_vehicle.vehicle.interface import OneShotMessage, Vehicle
from sim_vehicle.vehicle.numbers import to_int

ADVANCED, NOT_SELECTABLE = 1, 2  # MAV_MODE_PROPERTY
_ADVANCED_MODES = frozenset({modes.ACRO, modes.STABILIZED, modes.OFFBOARD, modes.PRECISION_LAND})

# Message id -> rate on the link to a ground station (MAV_x_MODE 0, "Normal") [Hz].
DEFAULT_RATES_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 15.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    CURRENT_EVENT_SEQUENCE.message_id: 0.33,
    CURRENT_MODE.message_id: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 1.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 1.5,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 5.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    TIME_ESTIMATE_TO_TARGET.message_id: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.1,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 0.5,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT: 1.0,  # strikes; only in a scenario with hostiles
}

# Message id -> interval of the data behind its stream [s]; a request without news since is DENIED.
PUBLISHED_S = {mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0.125, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 0.02}


def targets(vehicle: Vehicle) -> tuple[bool, bool]:
    """Return the reported targets (global, local): both in Auto modes, only local in Offboard and Orbit."""
    mode = vehicle.mode
    has_target = mode.behaviour not in PILOTED
    return has_target and mode.number >> 16 & 0xFF == modes.MAIN_AUTO, has_target


def _available_mode(index: int, total: int, mode: Mode) -> DefinedMessage:
    properties = ADVANCED if mode.number in _ADVANCED_MODES else 0
    if not mode.selectable:
        properties |= NOT_SELECTABLE
    return DefinedMessage(
        AVAILABLE_MODES,
        custom_mode=mode.number,
        properties=properties,
        number_modes=total,
        mode_index=index,
        standard_mode=mode.standard,
        mode_name=mode.name.encode(),
    )


def available_modes(vehicle: Vehicle, parameter: float) -> Sequence[Any]:
    """Return AVAILABLE_MODES of every mode (parameter 0), or of the mode with this index (from 1), if any."""
    all_modes = list(vehicle.personality.modes.by_number.values())
    messages = [_available_mode(index, len(all_modes), mode) for index, mode in enumerate(all_modes, start=1)]
    if parameter == 0:
        return messages
    return messages[int(parameter) - 1 : int(parameter)] if 1 <= parameter <= len(messages) else []


def protocol_version(_vehicle: Vehicle, _parameter: float) -> Sequence[Any]:
    """Return PROTOCOL_VERSION: MAVLink 2.0, compatible with 1.0."""
    return [DefinedMessage(PROTOCOL_VERSION, version=200, min_version=100, max_version=200)]


def message_interval(vehicle: Vehicle, parameter: float) -> Sequence[Any]:
    """Return MESSAGE_INTERVAL of the message with this id."""
    message_id = to_int(parameter)
    interval_us = reported_interval_us(vehicle, message_id)
    return [mavlink.MAVLink_message_interval_message(message_id & 0xFFFF, interval_us)]


ONE_SHOT_MESSAGES: dict[int, OneShotMessage] = one_shot_messages.ONE_SHOT_MESSAGES | {
    mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL: message_interval,
    AVAILABLE_MODES.message_id: available_modes,
    PROTOCOL_VERSION.message_id: protocol_version,
}
