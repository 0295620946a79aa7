"""Telemetry: the fields of each message, for any set of vehicles at once.

A builder receives the fleet's columns and the selected vehicles, and returns the columns of its message.
Fields without a column are 0. Units are those of the message definitions.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle import definitions
from sim_vehicle.definitions import Layout, layout_of
from sim_vehicle.wire.encode import Payloads, pack_payloads
from sim_vehicle.wire.telemetry import ardupilot, motion, px4, sensors, vehicle
from sim_vehicle.wire.telemetry.view import Columns, View

Builder = Callable[[View], Columns]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Stream:
    """One streamable message: `has_data` masks the vehicles with data for the message; None: all have."""

    layout: Layout
    columns: Builder
    has_data: Callable[[View], Mask] | None

    def payloads(self, view: View) -> Payloads:
        return pack_payloads(self.layout, len(view.i), self.columns(view))


def _no_vehicle(v: View) -> Mask:
    return np.zeros(len(v.i), dtype=bool)


def _nothing(_v: View) -> Columns:
    return {}


_BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: vehicle.heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: vehicle.sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: sensors.system_time,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: sensors.gps_raw_int,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: motion.global_position_int,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: motion.local_position_ned,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: motion.attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: motion.attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: motion.vfr_hud,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: sensors.battery_status,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: vehicle.extended_sys_state,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: motion.ekf_status_report,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: motion.estimator_status,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: vehicle.mission_current,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: vehicle.home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: vehicle.gps_global_origin,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: motion.nav_controller_output,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: motion.position_target_global_int,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: motion.position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: motion.altitude,
    mavlink.MAVLINK_MSG_ID_WIND: sensors.wind,
    mavlink.MAVLINK_MSG_ID_WIND_COV: sensors.wind_cov,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: sensors.scaled_pressure,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: sensors.raw_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: sensors.scaled_imu_since_boot,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: sensors.scaled_imu_since_boot,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: sensors.highres_imu,
    mavlink.MAVLINK_MSG_ID_VIBRATION: sensors.vibration,
    mavlink.MAVLINK_MSG_ID_POWER_STATUS: sensors.power_status,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: vehicle.fence_status,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: sensors.rc_channels,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: sensors.servo_output_raw,
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT: vehicle.strikes,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: sensors.timesync,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: _nothing,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS: px4.actuator_output_status,
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION: px4.flight_information,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: px4.hil_state_quaternion,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: px4.odometry,
    definitions.TIME_ESTIMATE_TO_TARGET.message_id: px4.time_estimate_to_target,
    definitions.CURRENT_EVENT_SEQUENCE.message_id: px4.current_event_sequence,
    definitions.CURRENT_MODE.message_id: px4.current_mode,
}
_ABSENT = dict.fromkeys(ardupilot.ABSENT, _nothing)
ARDUPILOT_ONLY = frozenset(_ABSENT | ardupilot.BUILDERS)
# Message id -> mask of the vehicles with data for the message; absent: all vehicles.
_HAS_DATA: dict[int, Callable[[View], Mask]] = ardupilot.HAS_DATA | {
    **dict.fromkeys((*_ABSENT, mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR), _no_vehicle),
    **dict.fromkeys(
        (
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
            mavlink.MAVLINK_MSG_ID_ODOMETRY,
            definitions.TIME_ESTIMATE_TO_TARGET.message_id,
        ),
        lambda v: v.status.has_origin[v.i],
    ),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: lambda v: v.status.has_home[v.i],
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: motion.is_steered,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: motion.has_global_target,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: motion.has_local_target,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: lambda v: v.status.fence_enabled[v.i],
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: lambda v: np.asarray(v.status.rc_count[v.i] > 0),
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT: lambda v: v.status.threatened[v.i],
}

STREAMS: dict[int, Stream] = {
    message_id: Stream(layout_of(message_id), columns, _HAS_DATA.get(message_id))
    for message_id, columns in (_ABSENT | ardupilot.BUILDERS | _BUILDERS).items()
}

__all__ = ["ARDUPILOT_ONLY", "STREAMS", "Stream", "View"]
