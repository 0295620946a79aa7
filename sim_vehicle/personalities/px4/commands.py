"""Commands of PX4 1.15.

Most commands change the mode. A disarmed vehicle accepts every selectable mode. An armed vehicle rejects a
mode that cannot run, with TEMPORARILY_REJECTED and a text.
"""

import math
from dataclasses import replace
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import PROTOCOL_VERSION
from sim_vehicle.faults import failure_command as failures
from sim_vehicle.personalities.px4 import messages, modes
from sim_vehicle.personalities.px4.manoeuvres import Orbit
from sim_vehicle.personalities.px4.mission_landing import mission_landing
from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle import commands as common
from sim_vehicle.vehicle.command import MAX_ALTITUDE_M, Command
from sim_vehicle.vehicle.commands import ACCEPTED, DENIED, FAILED, TEMPORARILY_REJECTED, UNSUPPORTED
from sim_vehicle.vehicle.interface import CommandHandler, Vehicle
from sim_vehicle.vehicle.numbers import to_int

CUSTOM, AUTO = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mavlink.MAV_MODE_FLAG_AUTO_ENABLED
STICKS, GUIDED = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED, mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
STABILIZED = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
ORBIT_RADIUS_M, ORBIT_SPEED_M_S = 10.0, 3.0
CALIBRATIONS = ("gyro", "mag", "baro", "rc", "accel")  # sensors of param1 to param5
NEED_ROTATION = frozenset({"mag", "accel"})


def _change_mode(vehicle: Vehicle, number: int, now: float) -> int:
    return ACCEPTED if vehicle.modes.set(number, now) else TEMPORARILY_REJECTED


def set_mode(vehicle: Vehicle, command: Command, now: float) -> int:
    """Set the mode: param1 base_mode, param2 main mode, param3 sub mode.

    An unknown main mode is accepted without a change, an unknown sub mode of Auto is rejected.
    """
    base_mode, main, sub = (
        to_int(value) & 0xFF for value in (command.param1, command.param2, command.param3)
    )
    number = _custom_mode(base_mode, main, sub)
    if number is None:
        return ACCEPTED
    return _change_mode(vehicle, number, now)


def _custom_mode(base_mode: int, main: int, sub: int) -> int | None:
    if base_mode & CUSTOM:
        if main == modes.MAIN_AUTO:
            return modes.number(main, sub) if sub else modes.MISSION
        if main == modes.MAIN_POSITION:
            return modes.POSITION_SLOW if sub == modes.SUB_SLOW else modes.POSITION
        number = modes.number(main)
        return number if number in modes.MODES and modes.MODES[number].selectable else None
    if base_mode & AUTO:
        return modes.MISSION
    if base_mode & STICKS:
        if base_mode & GUIDED:
            return modes.POSITION
        return modes.STABILIZED if base_mode & STABILIZED else modes.MANUAL
    return None


def set_standard_mode(vehicle: Vehicle, command: Command, now: float) -> int:
    standard = to_int(command.param1)
    for mode in modes.MODES.values():
        if mode.standard == standard > 0 and mode.selectable:
            return _change_mode(vehicle, mode.number, now)
    return FAILED


def arm_disarm(vehicle: Vehicle, command: Command, now: float) -> int:
    """Arm or disarm; a forced disarming (param2) also stops the motors in the air."""
    action = round(command.param1) if math.isfinite(command.param1) else -1
    if action == 1:
        return ACCEPTED if vehicle.arming.arm(now, force=False) else TEMPORARILY_REJECTED
    if action == 0:
        forced = to_int(command.param2) == common.FORCE
        return ACCEPTED if vehicle.arming.disarm(force=forced) else TEMPORARILY_REJECTED
    vehicle.announce("arm_unknown", value=command.param1)
    return common.NO_ANSWER


def takeoff(vehicle: Vehicle, command: Command, now: float) -> int:
    """Take off to altitude param7 [m above mean sea level], at least to MIS_TAKEOFF_ALT above home."""
    if not vehicle.modes.set(modes.TAKEOFF, now):
        return TEMPORARILY_REJECTED
    target_m = command.z if math.isfinite(command.z) else None
    minimum_m = vehicle.flight.home().alt_amsl_m + vehicle.flight_parameters.takeoff.height_m
    if target_m is not None and target_m < minimum_m - 0.1:
        vehicle.announce("takeoff_raised", height=vehicle.flight_parameters.takeoff.height_m)
    vehicle.flight.takeoff_amsl_m = target_m
    vehicle.flight.begin_takeoff()
    return ACCEPTED


def change_to(number: int, event: str) -> CommandHandler:
    """Return a handler that changes to a mode and announces `event`."""

    def handler(vehicle: Vehicle, _command: Command, now: float) -> int:
        if not vehicle.modes.set(number, now):
            return TEMPORARILY_REJECTED
        vehicle.announce(event)
        return ACCEPTED

    return handler


def mission_start(vehicle: Vehicle, command: Command, now: float) -> int:
    """Arm and start the mission at item param1; -1: at the current item."""
    if not vehicle.modes.mission_ready(now):
        vehicle.announce("no_mission_to_start")
        return DENIED
    if not (math.isfinite(command.param1) and -1 <= command.param1 < vehicle.mission.count):
        return DENIED
    if not vehicle.modes.set(modes.MISSION, now):
        return TEMPORARILY_REJECTED
    if not vehicle.arming.arm(now, force=False, text="armed_by_mission"):
        vehicle.announce("mode_needs_mission", mode=modes.MODES[modes.MISSION].name)
        return TEMPORARILY_REJECTED
    if command.param1 >= 0:
        vehicle.mission.set_current(to_int(command.param1))
    return ACCEPTED


def land_start(vehicle: Vehicle, command: Command, now: float) -> int:
    """Arm and start the mission at its landing sequence; always return ACCEPTED."""
    landing = mission_landing(vehicle.mission.items)
    if landing is not None:
        mission_start(vehicle, replace(command, param1=float(landing[0])), now)
    return ACCEPTED


def reposition(vehicle: Vehicle, command: Command, now: float) -> int:
    """Fly to a position in mode Hold. The altitude is always above mean sea level; NaN: present value."""
    if to_int(command.param2) != mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
        return UNSUPPORTED
    if not vehicle.modes.set(modes.HOLD, now):
        return TEMPORARILY_REJECTED
    place = _place(vehicle, command)
    if abs(place.lat_deg) > 90 or abs(place.lon_deg) > 180 or abs(command.z) >= MAX_ALTITUDE_M:
        return ACCEPTED  # the commander answers before the navigator checks the numbers
    _fly_within_fence(vehicle, place)
    if command.param1 > 0:
        vehicle.flight.change_speed(mavlink.SPEED_TYPE_GROUNDSPEED, command.param1)
    if math.isfinite(command.param4) and vehicle.flight.flying and not vehicle.body.plane:
        vehicle.body.face(command.param4 % (2 * math.pi))
    return ACCEPTED


def _place(vehicle: Vehicle, command: Command) -> GeodeticPosition:
    """Return the position of a command; the present place and altitude replace missing numbers."""
    here = vehicle.here()
    has_place = math.isfinite(command.lat_deg) and math.isfinite(command.lon_deg)
    place_deg = (command.lat_deg, command.lon_deg) if has_place else here.lat_lon_deg
    return GeodeticPosition(*place_deg, command.z if math.isfinite(command.z) else here.alt_amsl_m)


def _fly_within_fence(vehicle: Vehicle, place: GeodeticPosition) -> None:
    if vehicle.fence_watch.enabled and vehicle.fence_watch.find(*place):
        vehicle.announce("reposition_outside_fence")
        return
    vehicle.flight.guided_go(*place)


def change_altitude(vehicle: Vehicle, command: Command, now: float) -> int:
    """Change the altitude at the present position to param1 [m above mean sea level]."""
    if not vehicle.modes.set(modes.HOLD, now):
        return TEMPORARILY_REJECTED
    if math.isfinite(command.param1):
        _fly_within_fence(vehicle, vehicle.here()._replace(alt_amsl_m=command.param1))
    return ACCEPTED


def change_speed(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Set the cruising speed for any speed type; an invalid speed restores the default."""
    if not vehicle.flight.change_speed(mavlink.SPEED_TYPE_GROUNDSPEED, command.param2):
        vehicle.flight.restore_speed()
    return ACCEPTED


def orbit(vehicle: Vehicle, command: Command, now: float) -> int:
    """Circle around a point: a multicopter in mode Orbit, a plane in mode Hold.

    param1: radius [m], counter-clockwise if negative; param2: speed [m/s], multicopter only.
    """
    if not vehicle.flight.flying or not vehicle.position_known(now):
        vehicle.announce("orbit_refused")
        return TEMPORARILY_REJECTED
    place = _place(vehicle, command)
    centre_m, up_m = vehicle.body.locate(*place.lat_lon_deg), place.alt_amsl_m
    radius_m = command.param1 if math.isfinite(command.param1) and command.param1 else ORBIT_RADIUS_M
    if vehicle.body.plane:
        vehicle.modes.enter(modes.HOLD)
        vehicle.body.loiter(*centre_m, up_m, radius_m)
        return ACCEPTED
    vehicle.modes.enter(modes.ORBIT)
    speed_m_s = abs(command.param2) if math.isfinite(command.param2) and command.param2 else ORBIT_SPEED_M_S
    vehicle.flight.manoeuvre = Orbit(vehicle.body, centre_m, up_m, radius_m, speed_m_s)
    return ACCEPTED


def set_home(vehicle: Vehicle, command: Command, now: float) -> int:
    if vehicle.params["COM_HOME_EN"] != 1:
        return DENIED
    here = command.param1 > 0.5
    numbers = (command.lat_deg, command.lon_deg, command.z)
    if not here and not all(math.isfinite(number) for number in numbers):
        return DENIED
    if not vehicle.position_known(now):
        return TEMPORARILY_REJECTED
    if here:
        vehicle.home_and_rally.set_home(vehicle.here(), now, locked=True)
        return ACCEPTED
    place = command.place()
    if place is None:
        return DENIED
    vehicle.home_and_rally.set_home(GeodeticPosition(*place, command.z), now, locked=True)
    return ACCEPTED


def terminate(vehicle: Vehicle, command: Command, _now: float) -> int:
    if not (command.param1 > 0.5 and vehicle.armed):
        return DENIED
    vehicle.modes.enter(modes.TERMINATION)
    vehicle.arming.disarm(force=True)
    return ACCEPTED


def reboot(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Reboot for param1 1 or 3 (bootloader) unless armed; 0 has no effect."""
    if command.param1 == 0:
        return ACCEPTED
    if command.param1 not in (1, 3) or vehicle.armed:
        return DENIED
    vehicle.reboot_after_reply = True
    return ACCEPTED


def calibrate(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Report the first requested calibration in texts; a calibration that requires turning by hand fails."""
    if vehicle.armed:
        return TEMPORARILY_REJECTED
    params = (command.param1, command.param2, command.param3, command.param4, command.lat_deg)
    requested = [name for name, value in zip(CALIBRATIONS, params, strict=True) if to_int(value) == 1]
    if to_int(command.lat_deg) == 2:
        requested.append("level")
    for name in requested[:1]:
        vehicle.send_text(mavlink.MAV_SEVERITY_INFO, f"[cal] calibration started: 2 {name}")
        outcome = "failed: timeout" if name in NEED_ROTATION else f"done: {name}"
        vehicle.send_text(mavlink.MAV_SEVERITY_INFO, f"[cal] calibration {outcome}")
    return ACCEPTED


def storage(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Restore the default parameters for param1 2 or 4; 0, 1 and 3 have no effect."""
    if vehicle.armed:
        return TEMPORARILY_REJECTED
    action = to_int(command.param1)
    if action not in range(5):
        return DENIED
    if action in (2, 4):
        for name, value in vehicle.params.defaults.items():
            vehicle.params.set(name, value)
        vehicle.update_flight_parameters()
    return ACCEPTED


def run_prearm_checks(vehicle: Vehicle, _command: Command, now: float) -> int:
    vehicle.announce_refusals("prearm_check", now)
    return ACCEPTED


def set_message_interval(vehicle: Vehicle, command: Command, now: float) -> int:
    return ACCEPTED if common.set_message_interval(vehicle, command, now) == ACCEPTED else FAILED


def get_message_interval(vehicle: Vehicle, command: Command, now: float) -> int:
    result = common.get_message_interval(vehicle, command, now)
    return ACCEPTED if result == FAILED else result


def request_message(vehicle: Vehicle, command: Command, now: float) -> int:
    """Send a message, unless its stream has just sent it and PX4 has no news since."""
    message_id = to_int(command.param1)
    latest_s = vehicle.rates.latest_s(message_id)
    published_s = messages.PUBLISHED_S.get(message_id)
    without_news = published_s is not None and latest_s is not None and now - latest_s < published_s
    if without_news or message_id == mavlink.MAVLINK_MSG_ID_MISSION_CURRENT:
        return DENIED
    return ACCEPTED if vehicle.send_now(message_id, now, command.param2) else DENIED


def inject_failure(vehicle: Vehicle, command: Command, now: float) -> int:
    """Inject a failure if SYS_FAILURE_EN is 1."""
    if vehicle.params["SYS_FAILURE_EN"] != 1:
        return DENIED
    return failures.inject_failure(
        command.param1, command.param2, command.param3, vehicle.replace_faults, now
    )


def actuator_test(vehicle: Vehicle, command: Command, _now: float) -> int:
    """Accept a test of a known output, without effect; require COM_MOT_TEST_EN 1 and a disarmed vehicle."""
    if vehicle.armed or vehicle.params["COM_MOT_TEST_EN"] != 1:
        return DENIED
    output = to_int(command.lat_deg)
    return ACCEPTED if 1 <= output <= 12 or 33 <= output <= 40 or output >= 1000 else UNSUPPORTED


def _accept(_vehicle: Vehicle, _command: Command, _now: float) -> int:
    return ACCEPTED


def _high_latency(vehicle: Vehicle, _command: Command, _now: float) -> int:
    vehicle.announce("no_high_latency")
    return FAILED


_WITHOUT_EFFECT = (
    mavlink.MAV_CMD_NAV_ROI,
    mavlink.MAV_CMD_DO_SET_ROI,
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
    mavlink.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET,
    mavlink.MAV_CMD_DO_SET_ROI_NONE,
    mavlink.MAV_CMD_DO_SET_ACTUATOR,
)


COMMANDS: MappingProxyType[int, CommandHandler] = MappingProxyType(
    dict.fromkeys(_WITHOUT_EFFECT, _accept)
    | {
        mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: common.send_message(
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        ),
        mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: common.send_message(
            PROTOCOL_VERSION.message_id, otherwise=DENIED
        ),
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM: arm_disarm,
        mavlink.MAV_CMD_DO_SET_MODE: set_mode,
        mavlink.MAV_CMD_DO_SET_STANDARD_MODE: set_standard_mode,
        mavlink.MAV_CMD_NAV_TAKEOFF: takeoff,
        mavlink.MAV_CMD_NAV_LAND: change_to(modes.LAND, "landing"),
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: change_to(modes.RETURN, "returning"),
        mavlink.MAV_CMD_MISSION_START: mission_start,
        mavlink.MAV_CMD_DO_LAND_START: land_start,
        mavlink.MAV_CMD_DO_REPOSITION: reposition,
        mavlink.MAV_CMD_DO_CHANGE_ALTITUDE: change_altitude,
        mavlink.MAV_CMD_DO_CHANGE_SPEED: change_speed,
        mavlink.MAV_CMD_DO_ORBIT: orbit,
        mavlink.MAV_CMD_DO_SET_HOME: set_home,
        mavlink.MAV_CMD_DO_FLIGHTTERMINATION: terminate,
        mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: reboot,
        mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: calibrate,
        mavlink.MAV_CMD_PREFLIGHT_STORAGE: storage,
        mavlink.MAV_CMD_RUN_PREARM_CHECKS: run_prearm_checks,
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: set_message_interval,
        mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: get_message_interval,
        mavlink.MAV_CMD_REQUEST_MESSAGE: request_message,
        mavlink.MAV_CMD_GET_HOME_POSITION: common.send_message(
            mavlink.MAVLINK_MSG_ID_HOME_POSITION, otherwise=DENIED
        ),
        mavlink.MAV_CMD_REQUEST_FLIGHT_INFORMATION: common.send_message(
            mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION, otherwise=DENIED
        ),
        mavlink.MAV_CMD_INJECT_FAILURE: inject_failure,
        mavlink.MAV_CMD_ACTUATOR_TEST: actuator_test,
        mavlink.MAV_CMD_CONTROL_HIGH_LATENCY: _high_latency,
    }
)
