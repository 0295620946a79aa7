"""ArduCopter and ArduPlane 4.6.2 as observed on the wire."""

import math
from dataclasses import replace
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot import flight_parameters, messages, parameters
from sim_vehicle.personalities.ardupilot.commands import COPTER_COMMANDS, PLANE_COMMANDS, start_landing
from sim_vehicle.personalities.ardupilot.items import store_item, store_plane_item
from sim_vehicle.personalities.ardupilot.modes import COPTER_MODES, PLANE_MODES, copter_targets, plane_targets
from sim_vehicle.personalities.ardupilot.receivers import RECEIVERS
from sim_vehicle.personalities.ardupilot.remote import Remote, stick_refusals
from sim_vehicle.personalities.ardupilot.setpoints import read_setpoint
from sim_vehicle.personalities.ardupilot.storage import STORAGE
from sim_vehicle.personalities.ardupilot.transfer import ArduPilotTransfer
from sim_vehicle.personalities.base import (
    ArmingRules,
    CommandRules,
    FailsafeRules,
    Identity,
    MessageRules,
    MissionRules,
    Personality,
    SetpointRules,
    TelemetryRules,
)
from sim_vehicle.vehicle.behaviour import Behaviour, ModeTable
from sim_vehicle.vehicle.flight_parameters import FailsafeAction
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Mission
from sim_vehicle.vehicle.one_shot_messages import ONE_SHOT_MESSAGES
from sim_vehicle.vehicle.params import ParameterTable

_INFO, _NOTICE = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_NOTICE
_WARNING, _CRITICAL = mavlink.MAV_SEVERITY_WARNING, mavlink.MAV_SEVERITY_CRITICAL
_EMERGENCY = mavlink.MAV_SEVERITY_EMERGENCY
_TEXTS = {
    "armed": (_INFO, "Arming motors"),
    "crashed": (_EMERGENCY, "Crash: Disarming"),
    "disarmed": (_INFO, "Disarming motors"),
    "disarmed_landed": (_INFO, "Disarming motors"),
    "disarmed_unflown": (_INFO, "Disarming motors"),
    "arm_refused": (_CRITICAL, "Arm: {reason}"),
    "sticks_refused": (_CRITICAL, "Arm: {reason}"),
    "mode_throttle_high": (_WARNING, "Mode change to {mode} failed: throttle too high"),
    "not_armable": (_CRITICAL, "{mode} mode not armable"),
    "prearm": (_CRITICAL, "PreArm: {reason}"),
    "origin_set": (_INFO, "EKF3 IMU0 origin set"),
    "signing_refused": (_WARNING, "ERROR: Won't setup signing when armed"),
    "no_such_mode": (_WARNING, "No such mode {number}"),
    "mode_needs_position": (_WARNING, "Mode change to {mode} failed: requires position"),
    "mission_without_takeoff": (_CRITICAL, "Auto: Missing Takeoff Cmd"),
    "mission_changed": (_CRITICAL, "Auto mission changed, restarted command"),
    "mission_change_failed": (_CRITICAL, "Auto mission changed but failed to restart command"),
    "landing_sequence": (_INFO, "Landing sequence start"),
    "no_landing_sequence": (_WARNING, "Unable to start landing sequence"),
    "item_started": (_INFO, "Mission: {index} {name}"),
    "item_reached": (_INFO, "Reached command #{index}"),
    "touchdown": (_WARNING, "SIM Hit ground at {speed:.2f} m/s"),
    "gcs_lost": (_WARNING, "GCS Failsafe"),
    "gcs_back": (_WARNING, "GCS Failsafe Cleared"),
    "gcs_ignored": (_WARNING, "GCS Failsafe - Continuing Pilot Control"),
    "gcs_ignored_in_mission": (_WARNING, "GCS Failsafe - Continuing Auto Mode"),
    "rc_lost": (_WARNING, "Radio Failsafe"),
    "rc_back": (_WARNING, "Radio Failsafe Cleared"),
    "rc_ignored": (_WARNING, "Radio Failsafe - Continuing Guided Mode"),
    "rc_ignored_in_mission": (_WARNING, "Radio Failsafe - Continuing Auto"),
    "battery_low": (_WARNING, "Battery 1 is low {volts:.2f}V used {used_mah:.0f} mAh"),
    "battery_critical": (_CRITICAL, "Battery 1 is critical {volts:.2f}V used {used_mah:.0f} mAh"),
    "position_lost": (_WARNING, "EKF Failsafe"),
    "position_back": (_WARNING, "EKF Failsafe Cleared"),
    "fence_breached": (_NOTICE, "{names} breached"),
    "fence_cleared": (_NOTICE, "Fence breach cleared"),
    "fence_recovery": (_INFO, "Manual recovery started"),
    "terminated": (_CRITICAL, "Terminating due to failsafe"),
}


_UNHEALTHY_TEXTS = {
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO: "Gyros not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "Accels not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG: "Compass not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "Barometer not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE: "Airspeed not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_GPS: "GPS 1: not healthy",
    mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER: "RC not found",
    mavlink.MAV_SYS_STATUS_AHRS: "AHRS: not healthy",
    mavlink.MAV_SYS_STATUS_LOGGING: "Logging failed",
    mavlink.MAV_SYS_STATUS_SENSOR_BATTERY: "Battery 1 unhealthy",
}


def _mandatory_refusals(vehicle: Vehicle, now: float) -> list[str]:
    """Return the reasons that prevent even a forced arming of a copter."""
    flight_parameters = vehicle.flight_parameters
    if vehicle.position_known(now):
        return []
    if vehicle.mode.needs_position:
        return ["Need Position Estimate"]
    horizontal = math.isfinite(flight_parameters.fence.radius_m) or flight_parameters.fence.polygons
    return ["Fence enabled, need position estimate"] if vehicle.fence_watch.enabled and horizontal else []


def _refusals(vehicle: Vehicle, now: float) -> list[str]:
    """Return the reasons against arming now. The caller checks that the mode is armable."""
    mandatory_refusals = vehicle.personality.arming.mandatory_refusals(vehicle, now)
    if mandatory_refusals:
        return mandatory_refusals
    if vehicle.mode.needs_position and not vehicle.position_known(now):
        return ["Need Position Estimate"]
    if vehicle.flight_parameters.arming.checks and not vehicle.readiness.home_ready(now):
        return ["AHRS: waiting for home"]
    breach = vehicle.fence_watch.refusal()
    if breach is not None:
        return [breach]
    if not vehicle.flight_parameters.arming.checks:
        return []
    unhealthy = vehicle.injected_faults.effect.unhealthy_sensors
    reasons = [text for bit, text in _UNHEALTHY_TEXTS.items() if unhealthy & bit]
    if vehicle.failsafes.rc_lost:
        reasons.append("Radio failsafe on")
    if not vehicle.body.plane and vehicle.failsafes.gcs_late(now):
        reasons.append("GCS failsafe on")
    if vehicle.body.plane and vehicle.mission.in_landing and not vehicle.mission.starts_with_takeoff():
        reasons.append("In landing sequence")
    return reasons + _battery_refusals(vehicle)


def _battery_refusals(vehicle: Vehicle) -> list[str]:
    """Return the text of the first violated limit, or of the latched failsafe; an empty list if none."""
    body = vehicle.body
    for level, name in zip(vehicle.flight_parameters.battery.levels, ("low", "critical"), strict=True):
        if body.voltage_v < level.below_v:
            return [f"Battery 1 {name} voltage failsafe"]
        if body.battery_remaining < level.below_share:
            return [f"Battery 1 {name} capacity failsafe"]
    return ["Battery failsafe"] if vehicle.failsafes.battery_level > 0 else []


# Texts of a plane; most failsafe texts have the name of the mode.
_PLANE_TEXTS = {
    "no_mission_returns": (_INFO, "Aircraft in auto without a running mission"),
    "rc_short_acted": (_WARNING, "RC Short Failsafe: switched to {mode}"),
    "rc_short_stays": (_WARNING, "RC Short Failsafe On"),
    "rc_short_back": (_WARNING, "Short Failsafe Cleared"),
    "rc_acted": (_WARNING, "RC Long Failsafe On: {mode}"),
    "rc_stays": (_WARNING, "RC Long Failsafe On: {mode}"),
    "rc_back": (_WARNING, "RC Long Failsafe Cleared"),
    "gcs_acted": (_WARNING, "GCS Failsafe On: {mode}"),
    "gcs_stays": (_WARNING, "GCS Failsafe On: {mode}"),
    "gcs_back": (_WARNING, "GCS Failsafe Off"),
    "mission_ended": (_INFO, "Mission complete, changing mode to RTL"),
    "mission_reset": (_INFO, "In landing sequence: mission reset"),
}
_COPTER_EVENTS = frozenset(
    {"gcs_lost", "gcs_ignored", "gcs_ignored_in_mission", "rc_lost", "rc_ignored", "rc_ignored_in_mission"}
)

_COPTER = Personality(
    identity=Identity(
        autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
        plane=False,
        flight_sw_version=0x040602FF,  # 4.6.2, official release
        capabilities=mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        banner=("ArduCopter V4.6.2 (sim_vehicle)", "Frame: QUAD/PLUS"),
        boot_text=(
            b"\n\nInit ArduCopter V4.6.2 (sim_vehicle)",
            b"\n\nFree RAM: 131072\n",
            b"load_all took 48us\n",
            b"Init Gyro",
            *[b"*"] * 4,
            b"\n",
        ),
    ),
    parameters=ParameterTable(
        parameters.COPTER,
        "SYSID_THISMAV",
        byte_wise=False,
        read_only=parameters.READ_ONLY,
        bits=parameters.BITS,
    ),
    flight_parameters=flight_parameters.copter_flight_parameters,
    modes=ModeTable(COPTER_MODES, boot=0, refuses_leap=True),
    arming=ArmingRules(
        refusals=_refusals,
        stick_refusals=stick_refusals,
        mandatory_refusals=_mandatory_refusals,
    ),
    commands=CommandRules(COPTER_COMMANDS, is_addressed=lambda _sysid, _message: True),
    messages=MessageRules(RECEIVERS, ONE_SHOT_MESSAGES),
    telemetry=TelemetryRules(
        texts=_TEXTS,
        streams=messages.COPTER_STREAMS,
        default_rates_hz=messages.COPTER_RATES_HZ,
        unsupported=messages.UNSUPPORTED,
        targets=copter_targets,
    ),
    mission=MissionRules(make=Mission, transfer=ArduPilotTransfer, store_item=store_item, home_item=True),
    failsafes=FailsafeRules(disarms=True, battery_latches=True, fence_limits_latch=True),
    remote=Remote,
    storage=STORAGE,
    setpoints=SetpointRules(read_setpoint),
    ready_s=41.0,
)

_PLANE = replace(
    _COPTER,
    identity=replace(
        _COPTER.identity,
        vehicle_type=mavlink.MAV_TYPE_FIXED_WING,
        plane=True,
        banner=("ArduPlane V4.6.2 (sim_vehicle)",),
        boot_text=(b"\n\nInit ArduPlane V4.6.2 (sim_vehicle)", *_COPTER.identity.boot_text[1:]),
    ),
    parameters=replace(_COPTER.parameters, defaults=parameters.PLANE),
    flight_parameters=flight_parameters.plane_flight_parameters,
    modes=ModeTable(PLANE_MODES, boot=0),
    arming=replace(_COPTER.arming, mandatory_refusals=lambda _vehicle, _now: []),
    commands=replace(_COPTER.commands, handlers=PLANE_COMMANDS),
    telemetry=replace(
        _COPTER.telemetry,
        texts={event: text for event, text in _TEXTS.items() if event not in _COPTER_EVENTS} | _PLANE_TEXTS,
        streams=messages.PLANE_STREAMS,
        default_rates_hz=messages.PLANE_RATES_HZ,
        targets=plane_targets,
    ),
    mission=replace(
        _COPTER.mission,
        store_item=store_plane_item,
        stays_landed=True,
        ends_in=Behaviour.RETURN,
        start_landing=start_landing,
    ),
    failsafes=replace(
        _COPTER.failsafes,
        disarms=False,
        modes={
            FailsafeAction.GLIDE: flight_parameters.FBWA,
            FailsafeAction.LEVEL: flight_parameters.FBWB,
        },
    ),
)

ARDUPILOT = MappingProxyType({"copter": _COPTER, "plane": _PLANE})
