"""Texts of PX4 by event; `{...}` are values of the event."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_INFO, _WARNING = int(mavlink.MAV_SEVERITY_INFO), int(mavlink.MAV_SEVERITY_WARNING)
_CRITICAL, _EMERGENCY = int(mavlink.MAV_SEVERITY_CRITICAL), int(mavlink.MAV_SEVERITY_EMERGENCY)
_UNAVAILABLE = (_CRITICAL, "Switching to {mode} is currently not available")

TEXTS: dict[str, tuple[int, str]] = {
    # arming
    "armed": (_INFO, "Armed by external command"),
    "armed_by_mission": (_INFO, "Armed by mission start"),
    "crashed": (_EMERGENCY, "Crash detected: motors stopped"),
    "disarmed": (_INFO, "Disarmed by external command"),
    "disarmed_landed": (_INFO, "Disarmed by landing"),
    "disarmed_unflown": (_INFO, "Disarmed by auto preflight disarming"),
    "arm_refused": (_CRITICAL, "Preflight Fail: {reason}"),
    "prearm_check": (_CRITICAL, "Preflight Fail: {reason}"),
    "arm_denied": (_CRITICAL, "Arming denied: Resolve system health failures first"),
    "disarm_refused": (_CRITICAL, "Disarming denied: not landed"),
    # modes
    "no_such_mode": (_CRITICAL, "Unsupported auto mode"),
    "mode_needs_position": _UNAVAILABLE,
    "mode_needs_setpoints": _UNAVAILABLE,
    "mode_needs_pilot": _UNAVAILABLE,
    "mode_needs_mission": _UNAVAILABLE,
    "mode_terminated": _UNAVAILABLE,
    # flight
    "taken_off": (_INFO, "Takeoff detected"),
    "touched_down": (_INFO, "Landing detected"),
    "takeoff_raised": (_CRITICAL, "Using minimum takeoff altitude: {height:.2f} m"),
    "landing": (_INFO, "Landing at current position"),
    "returning": (_INFO, "Returning to launch"),
    "orbit_refused": (_CRITICAL, "Orbit command rejected"),
    "reposition_outside_fence": (_CRITICAL, "Reposition is outside geofence"),
    "no_high_latency": (_CRITICAL, "Control high latency failed! Telemetry unavailable"),
    # mission
    "no_mission_to_start": (_CRITICAL, "Mission start denied! No valid mission"),
    "mission_ended": (_INFO, "Mission finished, loitering"),
    "mission_ended_landed": (_INFO, "Mission finished, landed"),
    "no_mission": (_CRITICAL, "No valid mission available, loitering"),
    "no_mission_landed": (_CRITICAL, "No valid mission available, refusing takeoff"),
    # failsafes
    "failsafe": (_CRITICAL, "Failsafe activated"),
    "failsafe_waits": (_CRITICAL, "Failsafe activated: entering Hold for {seconds} seconds"),
    "gcs_back": (_INFO, "GCS connection regained"),
    "battery_warning": (_WARNING, "Low battery level"),
    "battery_low": (_CRITICAL, "Critical battery level"),
    "battery_critical": (_EMERGENCY, "Emergency battery level"),
    "fence_altitude_max": (_WARNING, "Geofence exceeded: max altitude"),
    "fence_circle": (_WARNING, "Geofence exceeded: max distance from home"),
    "fence_polygon": (_WARNING, "Geofence violation"),
    "fence_without_home": (_CRITICAL, "Geofence invalid, doesn't contain Home position"),
    "fence_without_vehicle": (_CRITICAL, "Geofence invalid, doesn't contain current vehicle position"),
    "terminated": (_CRITICAL, "Failsafe activated: Terminate"),
}
