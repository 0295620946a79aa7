"""What a vehicle tells, and how often it was asked to: message intervals, data streams, message builders.

Streams run on the simulation's tick, so nothing is sent more often than 20 times a (simulated) second.
"""

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.dynamics import GRAVITY_M_S2
from sim_vehicle.personalities.base import Behaviour

if TYPE_CHECKING:
    from sim_vehicle.autopilot import Autopilot

UNKNOWN_U16 = 65_535
EKF_NO_POSITION = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS | mavlink.EKF_CONST_POS_MODE
)
EKF_POSITION = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)
SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
STRIKES_INTERVAL_S = 1.0


class Streams:
    """Which message is due when; nothing until asked."""

    def __init__(self) -> None:
        self._interval_s: dict[int, float] = {}
        self._due_s: dict[int, float] = {}
        self._next_s = math.inf

    @property
    def wanted(self) -> bool:
        return bool(self._interval_s)

    def set_interval(self, message_id: int, interval_s: float, now: float) -> None:
        """Send `message_id` every `interval_s` [s] from `now` on; 0 or less stops it."""
        if interval_s <= 0:
            self._interval_s.pop(message_id, None)
            self._due_s.pop(message_id, None)
        else:
            self._interval_s[message_id] = interval_s
            self._due_s[message_id] = now + interval_s
        self._next_s = min(self._due_s.values(), default=math.inf)

    def due(self, now: float) -> Iterable[int]:
        """Message ids due by `now`, each counted as sent."""
        if now + 1e-9 < self._next_s:
            return ()
        due = [message_id for message_id, due_s in self._due_s.items() if due_s <= now + 1e-9]
        for message_id in due:
            later = self._due_s[message_id] + self._interval_s[message_id]
            self._due_s[message_id] = max(later, now)
        self._next_s = min(self._due_s.values(), default=math.inf)
        return due


def _boot_ms(vehicle: "Autopilot", now: float) -> int:
    return round((now - vehicle.readiness.boot_s) * 1000)


def _e7(vehicle: "Autopilot", now: float) -> tuple[int, int]:
    if not vehicle.readiness.gps_fix(now):
        return 0, 0
    lat_deg, lon_deg = vehicle.body.lat_lon_deg
    return round(lat_deg * 1e7), round(lon_deg * 1e7)


def _heading_cdeg(vehicle: "Autopilot") -> int:
    return round(math.degrees(vehicle.body.heading_rad) * 100) % 36_000


def _millivolts(vehicle: "Autopilot") -> int:
    return min(max(round(vehicle.body.voltage_v * 1000), 0), UNKNOWN_U16 - 1)


def heartbeat(vehicle: "Autopilot", _now: float) -> Any:
    base_mode = (
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    )
    if vehicle.mode.behaviour not in (Behaviour.DROP, Behaviour.LAND) and vehicle.mode.needs_position:
        base_mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    if vehicle.armed:
        base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    status = mavlink.MAV_STATE_ACTIVE if vehicle.body.airborne else mavlink.MAV_STATE_STANDBY
    if vehicle.failsafe:
        status = mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(
        vehicle.personality.vehicle_type,
        vehicle.personality.autopilot,
        base_mode,
        vehicle.mode.number,
        status,
        3,
    )


def sys_status(vehicle: "Autopilot", now: float) -> Any:
    health = SENSORS
    if not vehicle.readiness.gps_fix(now):
        health &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
    if not vehicle.readiness.position(now):
        health &= ~mavlink.MAV_SYS_STATUS_AHRS
    if vehicle.arming_refusals(now) and not vehicle.armed:
        health &= ~mavlink.MAV_SYS_STATUS_PREARM_CHECK
    body = vehicle.body
    return mavlink.MAVLink_sys_status_message(
        SENSORS,
        SENSORS,
        health,
        100,
        _millivolts(vehicle),
        round(body.current_a * 100),
        round(body.battery_remaining * 100),
        0,
        0,
        0,
        0,
        0,
        0,
    )


def gps_raw_int(vehicle: "Autopilot", now: float) -> Any:
    fix = vehicle.readiness.gps_fix(now)
    lat, lon = _e7(vehicle, now)
    east, north, _ = vehicle.body.velocity_m_s
    course = math.degrees(math.atan2(east, north)) % 360
    return mavlink.MAVLink_gps_raw_int_message(
        _boot_ms(vehicle, now) * 1000,
        mavlink.GPS_FIX_TYPE_RTK_FIXED if fix else mavlink.GPS_FIX_TYPE_NO_FIX,
        lat,
        lon,
        round(vehicle.body.alt_amsl_m * 1000) if fix else 0,
        121 if fix else UNKNOWN_U16,
        200 if fix else UNKNOWN_U16,
        round(math.hypot(east, north) * 100),
        round(course * 100) % 36_000,
        10 if fix else 0,
    )


def global_position_int(vehicle: "Autopilot", now: float) -> Any:
    lat, lon = _e7(vehicle, now)
    east, north, up = vehicle.body.velocity_m_s
    return mavlink.MAVLink_global_position_int_message(
        _boot_ms(vehicle, now),
        lat,
        lon,
        round(vehicle.body.alt_amsl_m * 1000),
        round(vehicle.height_above_home_m * 1000),
        round(north * 100),
        round(east * 100),
        round(-up * 100),
        _heading_cdeg(vehicle),
    )


def local_position_ned(vehicle: "Autopilot", now: float) -> Any:
    """Relative to the origin (where the vehicle stood when it got its first position); none before that."""
    if vehicle.origin is None:
        return None
    east_m, north_m, up_m = vehicle.body.position_m
    origin_east_m, origin_north_m = vehicle.body.locate(vehicle.origin.lat_deg, vehicle.origin.lon_deg)
    east, north, up = vehicle.body.velocity_m_s
    return mavlink.MAVLink_local_position_ned_message(
        _boot_ms(vehicle, now),
        north_m - origin_north_m,
        east_m - origin_east_m,
        vehicle.origin.alt_amsl_m - up_m,
        north,
        east,
        -up,
    )


def _attitude_rad(vehicle: "Autopilot") -> tuple[float, float, float]:
    east, north = vehicle.body.horizontal_acceleration_m_s2
    heading = vehicle.body.heading_rad
    forward = east * math.sin(heading) + north * math.cos(heading)
    right = east * math.cos(heading) - north * math.sin(heading)
    yaw = math.remainder(heading, 2 * math.pi)
    return math.atan2(right, GRAVITY_M_S2), -math.atan2(forward, GRAVITY_M_S2), yaw


def attitude(vehicle: "Autopilot", now: float) -> Any:
    return mavlink.MAVLink_attitude_message(_boot_ms(vehicle, now), *_attitude_rad(vehicle), 0, 0, 0)


def vfr_hud(vehicle: "Autopilot", _now: float) -> Any:
    east, north, up = vehicle.body.velocity_m_s
    speed = math.hypot(east, north)
    throttle = 35 if vehicle.body.airborne else 0
    heading_deg = round(math.degrees(vehicle.body.heading_rad)) % 360
    return mavlink.MAVLink_vfr_hud_message(speed, speed, heading_deg, throttle, vehicle.body.alt_amsl_m, up)


def battery_status(vehicle: "Autopilot", _now: float) -> Any:
    body = vehicle.body
    voltages = [_millivolts(vehicle)] + [UNKNOWN_U16] * 9
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_UNKNOWN,
        mavlink.MAV_BATTERY_TYPE_UNKNOWN,
        32_767,
        voltages,
        round(body.current_a * 100),
        round(body.used_mah),
        -1,
        round(body.battery_remaining * 100),
    )


def extended_sys_state(vehicle: "Autopilot", _now: float) -> Any:
    if not vehicle.body.airborne:
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND
    elif vehicle.flight.taking_off:
        landed = mavlink.MAV_LANDED_STATE_TAKEOFF
    elif vehicle.flight.landing_now:
        landed = mavlink.MAV_LANDED_STATE_LANDING
    else:
        landed = mavlink.MAV_LANDED_STATE_IN_AIR
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, landed)


def ekf_status_report(vehicle: "Autopilot", now: float) -> Any:
    flags = EKF_POSITION if vehicle.readiness.position(now) else EKF_NO_POSITION
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.02, 0.03, 0.03, 0.02, 0.0)


def mission_current(vehicle: "Autopilot", _now: float) -> Any:
    mission = vehicle.mission
    in_mission_mode = vehicle.mode.behaviour is Behaviour.MISSION
    return mavlink.MAVLink_mission_current_message(
        mission.index, max(mission.count - 1, 0), mission.reported_state, 1 if in_mission_mode else 2
    )


def home_position(vehicle: "Autopilot", now: float) -> Any:
    home = vehicle.home
    if home is None:
        return None
    return mavlink.MAVLink_home_position_message(
        round(home.lat_deg * 1e7),
        round(home.lon_deg * 1e7),
        round(home.alt_amsl_m * 1000),
        0,
        0,
        0,
        [1, 0, 0, 0],
        0,
        0,
        0,
        _boot_ms(vehicle, now) * 1000,
    )


def gps_global_origin(vehicle: "Autopilot", now: float) -> Any:
    origin = vehicle.origin
    if origin is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(
        round(origin.lat_deg * 1e7),
        round(origin.lon_deg * 1e7),
        round(origin.alt_amsl_m * 1000),
        _boot_ms(vehicle, now) * 1000,
    )


def autopilot_version(vehicle: "Autopilot", _now: float) -> Any:
    """uid2 begins with `sim_vehicle` and ends with the system id: no real aircraft is behind this vehicle."""
    uid2 = list(b"sim_vehicle".ljust(17, b"\0") + bytes([vehicle.sysid]))
    nothing = [0] * 8
    personality = vehicle.personality
    return mavlink.MAVLink_autopilot_version_message(
        personality.capabilities,
        personality.flight_sw_version,
        0,
        0,
        0,
        nothing,
        nothing,
        nothing,
        0,
        0,
        vehicle.sysid,
        uid2,
    )


def nav_controller_output(vehicle: "Autopilot", _now: float) -> Any:
    east_m, north_m, up_m = vehicle.body.position_m
    target_east_m, target_north_m, target_up_m = vehicle.body.target_m
    east, north = target_east_m - east_m, target_north_m - north_m
    bearing_deg = round(math.degrees(math.atan2(east, north)))
    roll_rad, pitch_rad, yaw_rad = _attitude_rad(vehicle)
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(roll_rad),
        math.degrees(pitch_rad),
        round(math.degrees(yaw_rad)),
        bearing_deg,
        min(round(math.hypot(east, north)), UNKNOWN_U16),
        target_up_m - up_m,
        0,
        0,
    )


def system_time(vehicle: "Autopilot", now: float) -> Any:
    return mavlink.MAVLink_system_time_message(0, _boot_ms(vehicle, now))


def strikes(vehicle: "Autopilot", now: float) -> Any:
    return mavlink.MAVLink_named_value_int_message(_boot_ms(vehicle, now), b"strikes", vehicle.strikes)


BUILDERS: dict[int, Callable[["Autopilot", float], Any]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: nav_controller_output,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
}
