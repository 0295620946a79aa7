"""Telemetry: the fields of each message, for any set of vehicles at once.

A builder receives the fleet's columns and the selected vehicles, and returns the columns of its message.
Fields without a column are 0. Units are those of the message definitions.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.wire.encode import Layout, Payloads, layout_of, pack_payloads
from sim_vehicle.wire.telemetry import ardupilot, motion, px4, sensors, vehicle
from sim_vehicle.wire.telemetry.view import Columns, View

Builder = Callable[[View], Columns]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Stream:
    """One streamable message: `has_data` masks the vehicles with data for the message."""

    layout: Layout
    columns: Builder
    has_data: Callable[[View], Mask]

    def payloads(self, view: View) -> Payloads:
        return pack_payloads(self.layout, len(view.i), self.columns(view))


def _all_vehicles(v: View) -> Mask:
    return np.ones(len(v.i), dtype=bool)


def _no_vehicle(v: View) -> Mask:
    return np.zeros(len(v.i), dtype=bool)


def _nothing(_v: View) -> Columns:
    return {}


def _has_home(v: View) -> Mask:
    return v.status.has_home[v.i]


def _has_channels(v: View) -> Mask:
    return np.asarray(v.status.rc_count[v.i] > 0)


def _threatened(v: View) -> Mask:
    return v.status.threatened[v.i]


def _fenced(v: View) -> Mask:
    return v.status.fence_enabled[v.i]


def _has_origin(v: View) -> Mask:
    return v.status.has_origin[v.i]


_TABLE: dict[int, tuple[Builder, Callable[[View], Mask]]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (vehicle.heartbeat, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (vehicle.sys_status, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (sensors.system_time, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (sensors.gps_raw_int, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (motion.global_position_int, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (motion.local_position_ned, _has_origin),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (motion.attitude, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (motion.attitude_quaternion, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (motion.vfr_hud, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (sensors.battery_status, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (vehicle.extended_sys_state, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: (motion.ekf_status_report, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (motion.estimator_status, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: (vehicle.mission_current, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (vehicle.home_position, _has_home),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (vehicle.gps_global_origin, _has_origin),
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: (motion.nav_controller_output, motion.is_steered),
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: (
        motion.position_target_global_int,
        motion.has_global_target,
    ),
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: (
        motion.position_target_local_ned,
        motion.has_local_target,
    ),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (motion.altitude, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_WIND: (sensors.wind, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_WIND_COV: (sensors.wind_cov, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: (sensors.scaled_pressure, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_RAW_IMU: (sensors.raw_imu, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: (sensors.scaled_imu_since_boot, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: (sensors.scaled_imu_since_boot, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: (sensors.highres_imu, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_VIBRATION: (sensors.vibration, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_POWER_STATUS: (sensors.power_status, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: (vehicle.fence_status, _fenced),
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: (sensors.rc_channels, _has_channels),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: (sensors.servo_output_raw, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT: (vehicle.strikes, _threatened),
    mavlink.MAVLINK_MSG_ID_TIMESYNC: (sensors.timesync, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: (_nothing, _no_vehicle),
    mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS: (px4.actuator_output_status, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION: (px4.flight_information, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: (px4.hil_state_quaternion, _all_vehicles),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (px4.odometry, _has_origin),
}
_ARDUPILOT_TABLE = dict.fromkeys(ardupilot.ABSENT, (_nothing, _no_vehicle)) | ardupilot.ROWS
ARDUPILOT_ONLY = frozenset(_ARDUPILOT_TABLE)
_MISSING_IN_DIALECT: tuple[tuple[Layout, Builder, Callable[[View], Mask]], ...] = (
    (px4.TIME_ESTIMATE_TO_TARGET, px4.time_estimate_to_target, _has_origin),
    (px4.CURRENT_EVENT_SEQUENCE, px4.current_event_sequence, _all_vehicles),
    (px4.CURRENT_MODE, px4.current_mode, _all_vehicles),
)
# Extension fields missing in the dialect; CRC_EXTRA does not cover extension fields.
_EXTENSIONS = {
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: ("mission_id", "fence_id", "rally_points_id"),
}


def _layout(message_id: int) -> Layout:
    layout = layout_of(message_id)
    known = layout.dtype.names or ()
    fields = [(name, "<u4") for name in _EXTENSIONS.get(message_id, ()) if name not in known]
    return replace(layout, dtype=np.dtype(layout.dtype.descr + fields)) if fields else layout


STREAMS: dict[int, Stream] = {
    message_id: Stream(_layout(message_id), columns, mask)
    for message_id, (columns, mask) in (_ARDUPILOT_TABLE | _TABLE).items()
} | {layout.message_id: Stream(layout, columns, mask) for layout, columns, mask in _MISSING_IN_DIALECT}

__all__ = ["ARDUPILOT_ONLY", "STREAMS", "Stream", "View"]
