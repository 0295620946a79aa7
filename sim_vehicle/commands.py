"""MAV_CMD commands, as COMMAND_LONG or COMMAND_INT; each handler returns a MAV_RESULT."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight import Place
from sim_vehicle.personalities.base import Behaviour
from sim_vehicle.telemetry import BUILDERS

if TYPE_CHECKING:
    from sim_vehicle.autopilot import Autopilot

MAX_ALTITUDE_M = 83_000.0
FORCE = 21_196  # param2 of arm and disarm: skip the checks
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
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
FAILED = int(mavlink.MAV_RESULT_FAILED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)


@dataclass(frozen=True, slots=True)
class Command:
    """One command, whichever message it came in; place in degrees, z [m] or parameter 7."""

    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_deg: float
    lon_deg: float
    z: float
    frame: int
    as_int: bool

    @classmethod
    def from_message(cls, message: Any) -> "Command":
        as_int = message.get_type() == "COMMAND_INT"
        return cls(
            command=message.command,
            param1=message.param1,
            param2=message.param2,
            param3=message.param3,
            param4=message.param4,
            lat_deg=message.x * 1e-7 if as_int else message.param5,
            lon_deg=message.y * 1e-7 if as_int else message.param6,
            z=message.z if as_int else message.param7,
            frame=message.frame if as_int else mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            as_int=as_int,
        )

    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude [deg] if they name a place on earth."""
        if not (abs(self.lat_deg) <= 90 and abs(self.lon_deg) <= 180 and abs(self.z) < MAX_ALTITUDE_M):
            return None
        return (self.lat_deg, self.lon_deg) if self.lat_deg or self.lon_deg else None


def whole(value: float) -> int:
    """A parameter that is meant to be an integer; -1 where it is no number."""
    return int(value) if math.isfinite(value) else -1


def execute(vehicle: "Autopilot", command: Command, now: float) -> int:
    """Carry out `command`; MAV_RESULT."""
    handler = HANDLERS.get(command.command)
    return UNSUPPORTED if handler is None else handler(vehicle, command, now)


def _arm_disarm(vehicle: "Autopilot", command: Command, now: float) -> int:
    force = whole(command.param2) == FORCE
    if command.param1 == 1:
        return ACCEPTED if vehicle.arm(now, force=force) else FAILED
    if command.param1 == 0:
        return ACCEPTED if vehicle.disarm(force=force) else FAILED
    return UNSUPPORTED


def _do_set_mode(vehicle: "Autopilot", command: Command, now: float) -> int:
    if not whole(command.param1) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if vehicle.set_mode(whole(command.param2), now) else FAILED


def _change_to(behaviour: Behaviour) -> Callable[["Autopilot", Command, float], int]:
    def handler(vehicle: "Autopilot", _command: Command, now: float) -> int:
        return ACCEPTED if vehicle.set_behaviour(behaviour, now) else FAILED

    return handler


def _takeoff(vehicle: "Autopilot", command: Command, _now: float) -> int:
    if vehicle.mode.behaviour is not Behaviour.GUIDED or not abs(command.z) < MAX_ALTITUDE_M:
        return FAILED
    return ACCEPTED if vehicle.flight.guided_takeoff(command.z) else FAILED


def _mission_start(vehicle: "Autopilot", _command: Command, now: float) -> int:
    """Sets AUTO; on an armed vehicle it clears the take-off, on a disarmed one nothing flies."""
    if not vehicle.set_behaviour(Behaviour.MISSION, now):
        return FAILED
    if vehicle.armed:
        vehicle.flight.cleared_for_takeoff = True
    vehicle.start_mission_if_stopped()
    return ACCEPTED


def _reposition(vehicle: "Autopilot", command: Command, now: float) -> int:
    if not command.as_int:
        return UNSUPPORTED
    place = command.place()
    if place is None or command.frame not in FRAMES_WITH_ALTITUDE:
        return DENIED
    if vehicle.mode.behaviour is not Behaviour.GUIDED:
        change = whole(command.param2) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if whole(command.param2) < 0 or not change:
            return DENIED
        if not vehicle.set_behaviour(Behaviour.GUIDED, now):
            return FAILED
    if command.param1 > 0:
        vehicle.flight.change_speed(mavlink.SPEED_TYPE_GROUNDSPEED, command.param1)
    vehicle.flight.guided_go(*place, vehicle.flight.altitude_amsl_m(command.frame, command.z))
    return ACCEPTED


def _change_speed(vehicle: "Autopilot", command: Command, _now: float) -> int:
    return ACCEPTED if vehicle.flight.change_speed(whole(command.param1), command.param2) else FAILED


def _set_mission_current(vehicle: "Autopilot", command: Command, _now: float) -> int:
    index = whole(command.param1)
    if index < -1:
        return DENIED
    if command.param2 == 1:
        vehicle.mission.rewind()
    if index == -1:
        index = vehicle.mission.index
    return ACCEPTED if vehicle.set_current(index) else DENIED


def _pause_continue(vehicle: "Autopilot", command: Command, _now: float) -> int:
    if command.param1 == 0:
        return ACCEPTED if vehicle.flight.pause() else FAILED
    if command.param1 == 1:
        return ACCEPTED if vehicle.flight.resume() else FAILED
    return DENIED


def _set_message_interval(vehicle: "Autopilot", command: Command, now: float) -> int:
    message_id = whole(command.param1)
    if message_id not in BUILDERS:
        return DENIED
    # 0 asks for the default rate, and the default is not to send.
    interval_us = command.param2 if math.isfinite(command.param2) else -1
    vehicle.set_message_interval(message_id, interval_us / 1e6, now)
    return ACCEPTED


def _request_message(vehicle: "Autopilot", command: Command, now: float) -> int:
    return ACCEPTED if vehicle.send_built(whole(command.param1), now) else FAILED


def _request_capabilities(vehicle: "Autopilot", _command: Command, now: float) -> int:
    return ACCEPTED if vehicle.send_built(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, now) else FAILED


def _get_home(vehicle: "Autopilot", _command: Command, now: float) -> int:
    return ACCEPTED if vehicle.send_built(mavlink.MAVLINK_MSG_ID_HOME_POSITION, now) else FAILED


def _set_home(vehicle: "Autopilot", command: Command, now: float) -> int:
    if not vehicle.readiness.position(now):
        return FAILED
    if command.param1 == 1:
        vehicle.set_home(vehicle.here(), now, locked=True)
        return ACCEPTED
    place = command.place()
    if place is None or command.frame not in FRAMES_WITH_ALTITUDE:
        return DENIED
    # COMMAND_LONG carries no frame: its altitude is above mean sea level here.
    up_m = vehicle.flight.altitude_amsl_m(command.frame, command.z) if command.as_int else command.z
    vehicle.set_home(Place(*place, up_m), now, locked=True)
    return ACCEPTED


def _reboot(vehicle: "Autopilot", command: Command, _now: float) -> int:
    if command.param1 not in (1, 3):
        return UNSUPPORTED
    if vehicle.armed:
        return FAILED
    vehicle.reboot_after_reply = True
    return ACCEPTED


HANDLERS: dict[int, Callable[["Autopilot", Command, float], int]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    mavlink.MAV_CMD_DO_SET_MODE: _do_set_mode,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _change_to(Behaviour.RETURN),
    mavlink.MAV_CMD_NAV_LAND: _change_to(Behaviour.LAND),
    mavlink.MAV_CMD_NAV_TAKEOFF: _takeoff,
    mavlink.MAV_CMD_MISSION_START: _mission_start,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_current,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _pause_continue,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_capabilities,
    mavlink.MAV_CMD_GET_HOME_POSITION: _get_home,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
}
