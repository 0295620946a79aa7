"""Commands of ArduCopter and ArduPlane."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.command import MAX_ALTITUDE_M, Command
from sim_vehicle.vehicle.commands import (
    ACCEPTED,
    DENIED,
    FAILED,
    FORCE,
    IN_PROGRESS,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    get_message_interval,
    send_message,
    set_message_interval,
)
from sim_vehicle.vehicle.interface import CommandHandler, Vehicle
from sim_vehicle.vehicle.mission import MissionState
from sim_vehicle.vehicle.numbers import finite, to_int

FRAMES_WITH_ALTITUDE = frozenset(
    {
        mavlink.MAV_FRAME_GLOBAL,
        mavlink.MAV_FRAME_GLOBAL_INT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    }
)
CALIBRATION_S = 3.0


def arm_disarm(vehicle: Vehicle, command: Command, now: float) -> int:
    force = to_int(command.param2) == FORCE
    if command.param1 == 1:
        return ACCEPTED if vehicle.arming.arm(now, force=force) else FAILED
    if command.param1 == 0:
        return ACCEPTED if vehicle.arming.disarm(force=force) else FAILED
    return UNSUPPORTED


def do_set_mode(vehicle: Vehicle, command: Command, now: float) -> int:
    if not to_int(command.param1) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if vehicle.modes.set(to_int(command.param2), now) else FAILED


def change_to(behaviour: Behaviour) -> CommandHandler:
    """Return a handler that changes to the personality's mode of `behaviour`."""

    def handler(vehicle: Vehicle, _command: Command, now: float) -> int:
        if vehicle.personality.modes.find(behaviour) is None:
            return UNSUPPORTED
        return ACCEPTED if vehicle.modes.set_behaviour(behaviour, now) else FAILED

    return handler


def takeoff(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Take off in a guided mode, to a height above home."""
    if vehicle.mode.behaviour is not Behaviour.GUIDED or not abs(command.z) < MAX_ALTITUDE_M:
        return FAILED
    alt_amsl_m = vehicle.flight.home().alt_amsl_m + command.z
    return ACCEPTED if vehicle.flight.takeoff_to(alt_amsl_m) else FAILED


def mission_start(vehicle: Vehicle, command: Command, now: float) -> int:
    """Enter the mission mode and clear an armed vehicle for take-off; deny a first or last item."""
    if command.param1 != 0 or command.param2 != 0:
        return DENIED
    if not vehicle.modes.set_behaviour(Behaviour.MISSION, now):
        return FAILED
    if vehicle.armed:
        vehicle.flight.cleared_for_takeoff = True
    if vehicle.mission.state is not MissionState.ACTIVE:
        vehicle.mission.start_or_resume()
    return ACCEPTED


def reposition(vehicle: Vehicle, command: Command, now: float) -> int:
    if not command.as_int:
        return UNSUPPORTED
    place = command.place()
    if place is None or command.frame not in FRAMES_WITH_ALTITUDE:
        return DENIED
    guided = vehicle.mode.behaviour is Behaviour.GUIDED
    flags = to_int(command.param2)
    if not guided and (flags < 0 or not flags & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE):
        return DENIED
    alt_amsl_m = vehicle.flight.altitude_amsl_m(command.frame, command.z)
    if command.z == 0 and command.frame not in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT):
        if not vehicle.body.plane:  # ArduCopter takes 0 for a missing altitude
            return DENIED
        alt_amsl_m = vehicle.body.alt_amsl_m
    watch = vehicle.fence_watch
    if watch.enabled and watch.find(*place, alt_amsl_m):
        return FAILED
    if not guided and not vehicle.modes.set_behaviour(Behaviour.GUIDED, now):
        return FAILED
    if vehicle.body.plane:
        sign = -1.0 if command.param4 and math.isfinite(command.param4) else 1.0
        radius_m = finite(command.param3) or vehicle.flight_parameters.limits.loiter_radius_m
        vehicle.flight.limit(loiter_radius_m=math.copysign(radius_m, sign))
        if command.param1 > 0:
            vehicle.flight.change_speed(mavlink.SPEED_TYPE_AIRSPEED, command.param1)
    vehicle.flight.guided_go(*place, alt_amsl_m)
    return ACCEPTED


def change_speed(vehicle: Vehicle, command: Command, _now: float) -> int:
    return ACCEPTED if vehicle.flight.change_speed(to_int(command.param1), command.param2) else FAILED


def set_mission_current(vehicle: Vehicle, command: Command, _now: float) -> int:
    index = to_int(command.param1)
    if index < -1:
        return DENIED
    if command.param2 == 1:
        vehicle.mission.rewind()
    if index == -1:
        index = vehicle.mission.index
    return ACCEPTED if vehicle.mission.set_current(index) else DENIED


def pause_continue(vehicle: Vehicle, command: Command, _now: float) -> int:
    if command.param1 == 0:
        return ACCEPTED if vehicle.flight.pause() else FAILED
    if command.param1 == 1:
        return ACCEPTED if vehicle.flight.resume() else FAILED
    return DENIED


def request_message(vehicle: Vehicle, command: Command, now: float) -> int:
    """Send a message; accept also a request for a known message without data."""
    message_id = to_int(command.param1)
    sent = vehicle.send_now(message_id, now, command.param2)
    return ACCEPTED if sent or vehicle.rates.can_stream(message_id) else FAILED


def set_home(vehicle: Vehicle, command: Command, now: float) -> int:
    if not vehicle.position_known(now):
        return FAILED
    if command.param1 == 1:
        vehicle.home_and_rally.set_home(vehicle.here(), now, locked=True)
        return ACCEPTED
    place = command.place()
    if place is None or command.frame not in FRAMES_WITH_ALTITUDE:
        return DENIED
    # COMMAND_LONG has no frame; ArduPilot reads the altitude as above mean sea level.
    alt_amsl_m = vehicle.flight.altitude_amsl_m(command.frame, command.z) if command.as_int else command.z
    vehicle.home_and_rally.set_home(GeodeticPosition(*place, alt_amsl_m), now, locked=True)
    return ACCEPTED


def reboot(vehicle: Vehicle, command: Command, _now: float) -> int:
    if command.param1 not in (1, 3):
        return UNSUPPORTED
    if vehicle.armed:
        return FAILED
    vehicle.reboot_after_reply = True
    return ACCEPTED


def condition_yaw(vehicle: Vehicle, command: Command, _now: float) -> int:
    if vehicle.mode.behaviour not in (Behaviour.GUIDED, Behaviour.MISSION, Behaviour.HOLD):
        return FAILED
    if not (math.isfinite(command.param1) and abs(command.param1) <= 360):
        return DENIED
    heading_rad = vehicle.flight.turn(
        command.param1,
        command.param2,
        direction=to_int(command.param3),
        relative=command.param4 == 1,
    )
    return FAILED if heading_rad is None else ACCEPTED


def fence_enable(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Override FENCE_ENABLE until this parameter changes or the vehicle reboots."""
    if command.param1 not in (0, 1):
        return FAILED
    vehicle.fence_watch.set_enabled(on=command.param1 == 1)
    return ACCEPTED


def terminate(vehicle: Vehicle, command: Command, _now: float) -> int:
    if command.param1 <= 0.5:
        return DENIED
    vehicle.arming.disarm(force=True)
    return ACCEPTED


def run_prearm_checks(vehicle: Vehicle, _command: Command, now: float) -> int:
    if vehicle.armed:
        return TEMPORARILY_REJECTED
    vehicle.announce_refusals("prearm", now)
    return ACCEPTED


def calibrate(vehicle: Vehicle, command: Command, now: float) -> int:
    """Calibrate any sensor of a disarmed vehicle for CALIBRATION_S; COMMAND_CANCEL ends the calibration."""
    sensors = (command.param1, command.param2, command.param3, command.param4, command.lat_deg)
    if not any(value > 0 for value in sensors if math.isfinite(value)):
        return UNSUPPORTED
    if vehicle.armed:
        return FAILED
    return IN_PROGRESS if vehicle.jobs.begin(command, CALIBRATION_S, now) else TEMPORARILY_REJECTED


def storage(_vehicle: Vehicle, command: Command, _now: float) -> int:
    """Accept loading and saving of parameters without effect; each change is stored at once."""
    return ACCEPTED if command.param1 in (0, 1) else FAILED


# -- ArduPlane -----------------------------------------------------------------------------------------


def start_landing(vehicle: Vehicle, now: float) -> bool:
    """Start AUTO at the nearest landing sequence, regardless of MIS_RESTART; return False if impossible."""
    here_deg = vehicle.body.lat_lon_deg
    index = vehicle.mission.land_start(here_deg) if vehicle.position_known(now) else None
    if index is None or not vehicle.mission.set_current(index):
        vehicle.announce("no_landing_sequence")
        return False
    vehicle.announce("landing_sequence")
    landing_index = vehicle.mission.index
    if not vehicle.modes.set_behaviour(Behaviour.MISSION, now):
        return False
    if vehicle.mission.index != landing_index:
        vehicle.mission.set_current(index)
    return True


def land_start(vehicle: Vehicle, _command: Command, now: float) -> int:
    return ACCEPTED if start_landing(vehicle, now) else FAILED


def no_takeoff(_vehicle: Vehicle, _command: Command, _now: float) -> int:
    """Refuse NAV_TAKEOFF, a command for quadplanes. Other planes take off in TAKEOFF or AUTO."""
    return FAILED


COPTER_COMMANDS: dict[int, CommandHandler] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: do_set_mode,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: change_to(Behaviour.RETURN),
    mavlink.MAV_CMD_NAV_LAND: change_to(Behaviour.LAND),
    mavlink.MAV_CMD_NAV_TAKEOFF: takeoff,
    mavlink.MAV_CMD_MISSION_START: mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: change_speed,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: set_mission_current,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: pause_continue,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: set_message_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: get_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: send_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    mavlink.MAV_CMD_GET_HOME_POSITION: send_message(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    mavlink.MAV_CMD_DO_SET_HOME: set_home,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: reboot,
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: calibrate,
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: storage,
    mavlink.MAV_CMD_CONDITION_YAW: condition_yaw,
    mavlink.MAV_CMD_DO_FENCE_ENABLE: fence_enable,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: run_prearm_checks,
}
PLANE_COMMANDS = COPTER_COMMANDS | {
    mavlink.MAV_CMD_DO_LAND_START: land_start,
    mavlink.MAV_CMD_NAV_TAKEOFF: no_takeoff,
}
