"""Stream groups of ArduPilot, default streams, and the messages that ArduPilot does not know."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import CURRENT_EVENT_SEQUENCE, CURRENT_MODE, TIME_ESTIMATE_TO_TARGET

# Messages of each group, without those of hardware that no simulated vehicle has.
_GROUPS: dict[int, tuple[int, ...]] = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU2,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU3,
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
        mavlink.MAVLINK_MSG_ID_AIRSPEED,
    ),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_POWER_STATUS,
        mavlink.MAVLINK_MSG_ID_MEMINFO,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
    ),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_SIMSTATE,
        mavlink.MAVLINK_MSG_ID_AHRS2,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_AHRS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_WIND,
        mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_VIBRATION,
    ),
}


def _with(group: int, *message_ids: int) -> dict[int, tuple[int, ...]]:
    return {**_GROUPS, group: _GROUPS[group] + message_ids}


COPTER_STREAMS = _with(mavlink.MAV_DATA_STREAM_EXTRA3, mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4)
PLANE_STREAMS = _with(
    mavlink.MAV_DATA_STREAM_EXTRA1,
    mavlink.MAVLINK_MSG_ID_AOA_SSA,
    mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
)

# SR0_* is 0 on ArduCopter and 1 Hz on ArduPlane.
COPTER_RATES_HZ = {mavlink.MAVLINK_MSG_ID_TIMESYNC: 0.1}
PLANE_RATES_HZ = COPTER_RATES_HZ | {
    message_id: 1.0 for message_ids in PLANE_STREAMS.values() for message_id in message_ids
}

# Messages of PX4, and messages that ArduPilot sends without a request only.
UNSUPPORTED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS,
        mavlink.MAVLINK_MSG_ID_ALTITUDE,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION,
        mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_WIND_COV,
        CURRENT_EVENT_SEQUENCE.message_id,
        CURRENT_MODE.message_id,
        TIME_ESTIMATE_TO_TARGET.message_id,
    }
)
