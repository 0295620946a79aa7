"""What PX4 sends without being asked, and what it answers to a request for a message."""

import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.base import Mode
from sim_vehicle.personalities.px4 import modes

if TYPE_CHECKING:
    from sim_vehicle.autopilot import Autopilot

AVAILABLE_MODES, TIME_ESTIMATE_TO_TARGET, CURRENT_EVENT_SEQUENCE, CURRENT_MODE = 435, 380, 411, 436
ADVANCED, NOT_SELECTABLE = 1, 2  # MAV_MODE_PROPERTY
_ADVANCED_MODES = frozenset({modes.ACRO, modes.STABILIZED, modes.OFFBOARD, modes.PRECISION_LAND})

# The link to a ground station (MAV_x_MODE 0, "Normal") [Hz].
DEFAULT_RATES_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 15.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    CURRENT_EVENT_SEQUENCE: 0.33,
    CURRENT_MODE: 0.5,
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
    TIME_ESTIMATE_TO_TARGET: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.1,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 0.5,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT: 1.0,  # strikes, where there are hostiles
}


class AvailableMode(mavlink.MAVLink_message):  # type: ignore[misc]
    """AVAILABLE_MODES, which pymavlink's ArduPilot dialect does not have."""

    crc_extra = 134

    def __init__(self, index: int, total: int, mode: Mode) -> None:
        super().__init__(AVAILABLE_MODES, "AVAILABLE_MODES")
        properties = ADVANCED if mode.number in _ADVANCED_MODES else 0
        if not mode.selectable:
            properties |= NOT_SELECTABLE
        name = mode.name.encode()
        self._fields = struct.pack("<IIBBB35s", mode.number, properties, total, index, mode.standard, name)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        return bytes(self._pack(mav, self.crc_extra, self._fields, force_mavlink1=force_mavlink1))


def available_modes(vehicle: "Autopilot", parameter: float) -> Sequence[Any]:
    """Every mode (parameter 0), or the one with this index, counted from 1."""
    every = list(vehicle.personality.modes.values())
    made = [AvailableMode(index, len(every), mode) for index, mode in enumerate(every, start=1)]
    if parameter == 0:
        return made
    return made[int(parameter) - 1 : int(parameter)] if 1 <= parameter <= len(made) else []


SINGLES = {
    AVAILABLE_MODES: available_modes,
}
