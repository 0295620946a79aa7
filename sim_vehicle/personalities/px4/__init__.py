"""PX4 1.15.2, multicopter and fixed wing, as observed on the wire."""

from dataclasses import replace
from types import MappingProxyType
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.base import (
    ArmingRules,
    CommandRules,
    FailsafeRules,
    HomeRules,
    Identity,
    MessageRules,
    MissionRules,
    Personality,
    SetpointRules,
    TelemetryRules,
)
from sim_vehicle.personalities.px4 import flight_parameters, parameters, storage
from sim_vehicle.personalities.px4.commands import COMMANDS
from sim_vehicle.personalities.px4.items import store_item
from sim_vehicle.personalities.px4.messages import DEFAULT_RATES_HZ, ONE_SHOT_MESSAGES, targets
from sim_vehicle.personalities.px4.mission import Px4Mission
from sim_vehicle.personalities.px4.mission_landing import return_by_mission
from sim_vehicle.personalities.px4.modes import HOLD, MODES, TERMINATION
from sim_vehicle.personalities.px4.readiness import refusals
from sim_vehicle.personalities.px4.receivers import RECEIVERS
from sim_vehicle.personalities.px4.remote import Remote, stick_refusals
from sim_vehicle.personalities.px4.setpoints import read_setpoint
from sim_vehicle.personalities.px4.transfer import Px4Transfer
from sim_vehicle.vehicle.behaviour import Behaviour, ModeTable
from sim_vehicle.vehicle.flight_parameters import FailsafeAction
from sim_vehicle.vehicle.params import ParameterTable
from sim_vehicle.wire.telemetry import ARDUPILOT_ONLY

READY_S = 37.0  # time from boot to a position estimate


# Rules for the target of a message. The fleet passes only messages to this system or to all systems (0).
_COMPONENTS = frozenset({int(mavlink.MAV_COMP_ID_ALL), int(mavlink.MAV_COMP_ID_AUTOPILOT1)})
# Commands accepted also with system 0 and with any component: programs send them before they know the ids.
_TO_ANY_TARGET = frozenset(
    {mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION}
)
_COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
_ONLY_TO_OWN_SYSTEM = frozenset({"COMMAND_CANCEL", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})
_ALSO_TO_ALL_SYSTEMS = frozenset(
    {
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
        "SET_ATTITUDE_TARGET",
        "FILE_TRANSFER_PROTOCOL",
    }
)


def _is_addressed(sysid: int, message: Any) -> bool:
    """Return True if the vehicle `sysid` processes a message with this target.

    A message without a rule is always processed. `Px4Transfer` checks the targets of the mission protocol.
    """
    kind = message.get_type()
    if kind in _COMMANDS and message.command in _TO_ANY_TARGET:
        return True
    if kind in _ALSO_TO_ALL_SYSTEMS:
        return message.target_component in _COMPONENTS
    if kind in _COMMANDS or kind in _ONLY_TO_OWN_SYSTEM:
        return message.target_system == sysid and message.target_component in _COMPONENTS
    return True


# Texts by event; `{...}` are values of the event.
_INFO, _WARNING = int(mavlink.MAV_SEVERITY_INFO), int(mavlink.MAV_SEVERITY_WARNING)
_CRITICAL, _EMERGENCY = int(mavlink.MAV_SEVERITY_CRITICAL), int(mavlink.MAV_SEVERITY_EMERGENCY)
_UNAVAILABLE = (_CRITICAL, "Switching to {mode} is currently not available")

_TEXTS: dict[str, tuple[int, str]] = {
    # arming
    "armed": (_INFO, "Armed by external command"),
    "armed_by_mission": (_INFO, "Armed by mission start"),
    "crashed": (_EMERGENCY, "Crash detected: motors stopped"),
    "disarmed": (_INFO, "Disarmed by external command"),
    "disarmed_landed": (_INFO, "Disarmed by landing"),
    "disarmed_unflown": (_INFO, "Disarmed by auto preflight disarming"),
    "arm_unknown": (_CRITICAL, "Unsupported ARM_DISARM param: {value:.3f}\t"),
    "arm_refused": (_CRITICAL, "Preflight Fail: {reason}"),
    "prearm_check": (_CRITICAL, "Preflight Fail: {reason}"),
    "sticks_refused": (_CRITICAL, "Arming denied: {reason}"),
    "pilot_took_over": (_INFO, "Pilot took over using sticks"),
    "arm_denied": (_CRITICAL, "Arming denied: Resolve system health failures first"),
    "disarm_refused": (_CRITICAL, "Disarming denied: not landed"),
    # modes
    "no_such_mode": (_CRITICAL, "Unsupported auto mode"),
    "mode_needs_position": _UNAVAILABLE,
    "mode_needs_setpoints": _UNAVAILABLE,
    "mode_needs_pilot": _UNAVAILABLE,
    "mode_needs_mission": _UNAVAILABLE,
    "mode_terminated": _UNAVAILABLE,
    # set-points
    "setpoint_frame": (_CRITICAL, "{kind} coordinate frame {frame} unsupported\t"),
    "setpoint_global_frame": (_CRITICAL, "SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {frame}\t"),
    "setpoint_force": (_CRITICAL, "{kind} force not supported\t"),
    "setpoint_empty": (_CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid\t"),
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
# Messages of ArduPilot that PX4 does not stream.
_UNSUPPORTED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS,
        mavlink.MAVLINK_MSG_ID_POWER_STATUS,
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU2,
        mavlink.MAVLINK_MSG_ID_WIND,
        *ARDUPILOT_ONLY,
    }
)

_COPTER = Personality(
    identity=Identity(
        autopilot=mavlink.MAV_AUTOPILOT_PX4,
        vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
        plane=False,
        flight_sw_version=0x010F02FF,  # 1.15.2, official release
        capabilities=mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        banner=("PX4 1.15.2 (sim_vehicle)",),
    ),
    parameters=ParameterTable(
        parameters.COPTER, "MAV_SYS_ID", byte_wise=True, read_only=frozenset({"MAV_SYS_ID"})
    ),
    flight_parameters=flight_parameters.copter_flight_parameters,
    modes=ModeTable(MODES, boot=HOLD, rereads_switch=False, restored_by_disarming=True),
    arming=ArmingRules(
        refusals=refusals,
        stick_refusals=stick_refusals,
        landing_disarms=False,
        flight_counter="COM_FLIGHT_UUID",
    ),
    commands=CommandRules(COMMANDS, is_addressed=_is_addressed, refuses_foreign=True),
    messages=MessageRules(RECEIVERS, ONE_SHOT_MESSAGES | storage.ONE_SHOT_MESSAGES),
    telemetry=TelemetryRules(
        texts=_TEXTS,
        streams={},
        default_rates_hz=DEFAULT_RATES_HZ,
        unsupported=_UNSUPPORTED,
        targets=targets,
        mission_state=False,
        empty_mission_total=65_535,
        active_when_armed=True,
        gps_fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
        gps_present_with_fix=True,
    ),
    mission=MissionRules(
        make=Px4Mission,
        transfer=Px4Transfer,
        store_item=store_item,
        home_item=False,
        ends_in=Behaviour.HOLD,
    ),
    home=HomeRules(with_position=True, is_local=True),
    failsafes=FailsafeRules(modes={FailsafeAction.TERMINATE: TERMINATION}),
    remote=Remote,
    storage=storage.STORAGE,
    setpoints=SetpointRules(read_setpoint, resumes=True),
    ready_s=READY_S,
)

_PLANE = replace(
    _COPTER,
    identity=replace(_COPTER.identity, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, plane=True),
    parameters=replace(_COPTER.parameters, defaults=parameters.PLANE),
    flight_parameters=flight_parameters.plane_flight_parameters,
    mission=replace(_COPTER.mission, return_by_mission=return_by_mission),
)

PX4 = MappingProxyType({"copter": _COPTER, "plane": _PLANE})
