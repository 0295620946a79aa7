"""Writer of one vehicle's row in the fleet's `Status`, a source of telemetry."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle

ALWAYS_SET = int(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
GEOFENCE = int(mavlink.MAV_SYS_STATUS_GEOFENCE)
SENSORS = int(
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)


def publish(vehicle: Vehicle, now: float) -> None:
    """Write one vehicle's row, except for its identity, clock faults, threats and strikes."""
    status, i = vehicle.status, vehicle.index
    status.booted[i] = vehicle.booted
    status.boot_s[i] = vehicle.readiness.boot_s
    status.gps_seen[i] = vehicle.readiness.gps_fix_ready(now)
    status.position_known[i] = vehicle.position_known(now)
    status.rc_count[i] = vehicle.remote.count
    channels_us = vehicle.remote.channels_us(now)
    status.rc_us[i, : len(channels_us)] = channels_us
    _heartbeat(vehicle)
    _health(vehicle, now)
    _places(vehicle)
    _mission(vehicle)
    status.has_place[i], status.has_setpoint[i] = vehicle.personality.telemetry.targets(vehicle)
    watch = vehicle.fence_watch
    status.fence_enabled[i] = watch.enabled
    status.fence_status[i] = bool(watch.breached)
    status.fence_breaches[i] = watch.count
    status.fence_type[i] = watch.kind
    status.fence_time_ms[i] = round(max(watch.last_s - vehicle.readiness.boot_s, 0.0) * 1000)
    status.battery_state[i] = vehicle.failsafes.battery_state


def _heartbeat(vehicle: Vehicle) -> None:
    status, i, personality, mode = vehicle.status, vehicle.index, vehicle.personality, vehicle.mode
    armed = int(mavlink.MAV_MODE_FLAG_SAFETY_ARMED) if vehicle.armed else 0
    status.armed_since_s[i] = vehicle.arming.armed_since_s
    status.flying_since_s[i] = vehicle.arming.flying_since_s
    if (counter := personality.arming.flight_counter) is not None:
        status.flights[i] = int(vehicle.params[counter]) & 0xFFFFFFFF
    status.base_mode[i] = ALWAYS_SET | mode.base_mode | armed
    status.custom_mode[i] = mode.number
    status.standard_mode[i] = mode.standard
    active_when_armed = personality.telemetry.active_when_armed
    armed_is_active = active_when_armed and vehicle.armed
    if mode.terminates:
        status.system_status[i] = mavlink.MAV_STATE_FLIGHT_TERMINATION
    elif vehicle.failsafes.any_latched and (armed_is_active or not active_when_armed):
        status.system_status[i] = mavlink.MAV_STATE_CRITICAL
    elif vehicle.body.airborne or armed_is_active:
        status.system_status[i] = mavlink.MAV_STATE_ACTIVE
    else:
        status.system_status[i] = mavlink.MAV_STATE_STANDBY
    status.landed_state[i] = _landed_state(vehicle)


def _landed_state(vehicle: Vehicle) -> int:
    if not vehicle.body.airborne:
        return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
    if vehicle.flight.taking_off:
        return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
    if vehicle.flight.landing_now:
        return int(mavlink.MAV_LANDED_STATE_LANDING)
    return int(mavlink.MAV_LANDED_STATE_IN_AIR)


def _health(vehicle: Vehicle, now: float) -> None:
    present = health = SENSORS
    if not (vehicle.readiness.gps_fix_ready(now) and vehicle.body.gps_fix):
        health &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
        if vehicle.personality.telemetry.gps_present_with_fix:
            present &= ~mavlink.MAV_SYS_STATUS_SENSOR_GPS
    if not vehicle.position_known(now):
        health &= ~mavlink.MAV_SYS_STATUS_AHRS
    if not vehicle.armed and vehicle.personality.arming.refusals(vehicle, now):
        health &= ~mavlink.MAV_SYS_STATUS_PREARM_CHECK
    unhealthy = vehicle.injected_faults.effect.unhealthy_sensors
    enabled = SENSORS | unhealthy
    present |= unhealthy
    watch, i = vehicle.fence_watch, vehicle.index
    if not watch.breached:
        health |= GEOFENCE
    fenced = watch.has_limits
    vehicle.status.sensors[i] = present | (GEOFENCE if fenced else 0)
    vehicle.status.sensors_enabled[i] = enabled | (GEOFENCE if fenced and watch.enabled else 0)
    vehicle.status.health[i] = health & ~unhealthy


def _places(vehicle: Vehicle) -> None:
    status, i = vehicle.status, vehicle.index
    home, origin = vehicle.home_and_rally.home, vehicle.home_and_rally.origin
    status.has_home[i] = home is not None
    if home is not None:
        status.home_e7[i] = round(home.lat_deg * 1e7), round(home.lon_deg * 1e7)
        status.home_amsl_m[i] = home.alt_amsl_m
    status.has_origin[i] = origin is not None
    if origin is not None:
        status.origin_m[i] = vehicle.home_and_rally.origin_m
        status.origin_e7[i] = round(origin.lat_deg * 1e7), round(origin.lon_deg * 1e7)


def _mission(vehicle: Vehicle) -> None:
    status, i, mission, personality = vehicle.status, vehicle.index, vehicle.mission, vehicle.personality
    status.mission_seq[i] = mission.index
    total = mission.count - 1 if personality.mission.home_item else mission.count
    status.mission_total[i] = total if total > 0 else personality.telemetry.empty_mission_total
    status.mission_ids[i] = vehicle.transfer.ids
    status.item_reached[i] = vehicle.flight.pilot.item_reached
    if personality.telemetry.mission_state:
        status.mission_state[i] = mission.reported_state
        status.mission_mode[i] = 1 if vehicle.mode.behaviour is Behaviour.MISSION else 2
