"""Arming, take-off, movement and landing of the vehicle under test."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import fmean
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal
from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station import messages

AIRBORNE_M = 3.0  # an armed vehicle above this height flies
HEIGHT_M, PLANE_HEIGHT_M = 20.0, 50.0  # height of the take-off above home
READY_S, CLIMB_S, LAND_S = 150.0, 90.0, 240.0  # longest times until ready, at height, landed
PREARM_BIT = mavlink.MAV_SYS_STATUS_PREARM_CHECK
HEARTBEAT_LAG_S = 2.5  # longest time until a heartbeat shows a change
REPOSITION_CHANGES_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
FLIGHT_RATES_HZ = {"GLOBAL_POSITION_INT": 5.0, "EXTENDED_SYS_STATE": 5.0, "MISSION_CURRENT": 2.0}


def mode_number(vehicle: VehicleUnderTest, role: str) -> int:
    """Return the custom_mode for a role, such as "hold"; raise Skip for an unknown role."""
    if role not in vehicle.dialect.modes:
        raise Skip(f"this autopilot has no known mode for {role!r}")
    return vehicle.dialect.modes[role]


def mode_name(vehicle: VehicleUnderTest, number: int) -> str:
    names = {value: role for role, value in vehicle.dialect.modes.items()}
    return f"{names[number]} ({number})" if number in names else str(number)


def try_mode(vehicle: VehicleUnderTest, role: str) -> str:
    """Command a mode; return the name of the MAV_RESULT."""
    return vehicle.result(messages.set_mode(vehicle.target, mode_number(vehicle, role)))


def wait_for_mode(vehicle: VehicleUnderTest, role: str, within_s: float = HEARTBEAT_LAG_S) -> float:
    """Wait for a mode in the heartbeat; return the time taken [s]."""
    number = mode_number(vehicle, role)
    return vehicle.wait_until(lambda: vehicle.mode == number, f"the {role} mode in the heartbeat", within_s)


def set_mode(vehicle: VehicleUnderTest, role: str) -> None:
    """Set a mode and wait for the mode in the heartbeat; raise CheckFailed if the vehicle refuses."""
    # PX4 refuses its mission mode for a moment after an upload.
    for _ in range(5):
        result = try_mode(vehicle, role)
        if result == ACCEPTED:
            break
        vehicle.wait(1.0)
    equal(result, ACCEPTED, f"mode {role}")
    wait_for_mode(vehicle, role)


def set_ready_mode(vehicle: VehicleUnderTest) -> None:
    """Set the mode for arming, if the autopilot needs a particular mode."""
    if vehicle.dialect.ready_mode is not None:
        set_mode(vehicle, vehicle.dialect.ready_mode)


def is_ready(vehicle: VehicleUnderTest) -> bool:
    """Return True if the pre-arm checks pass (ArduPilot: with a position estimate) or are not reported."""
    status = vehicle.request("SYS_STATUS")
    # PX4 sets the bit of the health only (SYS_STATUS.hpp).
    if vehicle.dialect.name == "px4" or status.onboard_control_sensors_present & PREARM_BIT:
        if not status.onboard_control_sensors_health & PREARM_BIT:
            return False
        if vehicle.dialect.name == "ardupilot":
            flags = vehicle.request("EKF_STATUS_REPORT").flags
            return bool(flags & mavlink.EKF_POS_HORIZ_ABS)
    return True


def wait_ready(vehicle: VehicleUnderTest) -> float:
    """Set the mode for arming and wait until the vehicle can be armed; return the waiting time [s]."""
    set_ready_mode(vehicle)
    began_s = vehicle.now
    while not is_ready(vehicle):
        if vehicle.now - began_s > READY_S:
            raise CheckFailed(f"expected the vehicle to be ready within {READY_S:g} s; {last_texts(vehicle)}")
        if "In landing sequence" in last_texts(vehicle):  # ArduPlane, after a landing by mission
            set_current(vehicle, 1)
        vehicle.wait(1.0)
    return vehicle.now - began_s


def last_texts(vehicle: VehicleUnderTest) -> str:
    """Return the latest three STATUSTEXTs of the vehicle, for the message of a failure."""
    texts = [message.text for message in vehicle.texts[-3:]]
    return "last texts: " + " | ".join(texts) if texts else "no texts"


def arm(vehicle: VehicleUnderTest) -> None:
    """Wait until the vehicle is ready, arm the vehicle, and wait for the armed state in the heartbeat."""
    wait_ready(vehicle)
    result = vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    if result != ACCEPTED:
        raise CheckFailed(f"arming: expected ACCEPTED, saw {result}; {last_texts(vehicle)}")
    wait_until_armed(vehicle)


def wait_until_armed(vehicle: VehicleUnderTest, within_s: float = HEARTBEAT_LAG_S) -> float:
    return vehicle.wait_until(lambda: vehicle.armed, "armed in the heartbeat", within_s)


def wait_until_disarmed(vehicle: VehicleUnderTest, within_s: float = HEARTBEAT_LAG_S) -> float:
    return vehicle.wait_until(lambda: not vehicle.armed, "disarmed in the heartbeat", within_s)


@contextmanager
def armed(vehicle: VehicleUnderTest) -> Iterator[None]:
    """Arm the vehicle, and disarm it at the end; after a failure the runner disarms it."""
    arm(vehicle)
    yield
    disarm(vehicle)


def disarm(vehicle: VehicleUnderTest) -> None:
    """Disarm the vehicle on the ground, and wait for the disarmed state in the heartbeat."""
    if vehicle.armed:
        vehicle.expect_accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        wait_until_disarmed(vehicle)


def set_current(vehicle: VehicleUnderTest, seq: int) -> None:
    vehicle.send(mavlink.MAVLink_mission_set_current_message(*vehicle.target, seq))


def home(vehicle: VehicleUnderTest) -> tuple[int, int]:
    """Request HOME_POSITION; return latitude and longitude [1e-7 deg]."""
    found = vehicle.request("HOME_POSITION")
    return found.latitude, found.longitude


def height_m(vehicle: VehicleUnderTest) -> float:
    """Return the latest reported height above home [m]; NaN before the first report."""
    return position(vehicle).relative_alt / 1000 if "GLOBAL_POSITION_INT" in vehicle.last else math.nan


def position(vehicle: VehicleUnderTest) -> Any:
    """Return the latest GLOBAL_POSITION_INT."""
    return vehicle.last["GLOBAL_POSITION_INT"]


def speed_m_s(vehicle: VehicleUnderTest) -> float:
    """Return the latest reported ground speed [m/s]."""
    return math.hypot(position(vehicle).vx, position(vehicle).vy) / 100


def mean_speed_m_s(vehicle: VehicleUnderTest, seconds: float) -> float:
    """Return the mean of the reported ground speeds [m/s]."""
    return fmean(math.hypot(m.vx, m.vy) / 100 for m in vehicle.listen("GLOBAL_POSITION_INT", seconds))


def wait_until_still(vehicle: VehicleUnderTest, within_s: float, limit_m_s: float = 0.6) -> float:
    return vehicle.wait_until(lambda: speed_m_s(vehicle) < limit_m_s, "a standstill", within_s)


def last_position(vehicle: VehicleUnderTest) -> tuple[int, int]:
    """Return the latest reported latitude and longitude [1e-7 deg]."""
    return position(vehicle).lat, position(vehicle).lon


def distance_to_m(vehicle: VehicleUnderTest, target: tuple[int, int]) -> float:
    return plans.distance_m(last_position(vehicle), target)


def start_streams(vehicle: VehicleUnderTest) -> None:
    """Start the streams of `FLIGHT_RATES_HZ` and wait for a position."""
    for kind, rate_hz in FLIGHT_RATES_HZ.items():
        vehicle.set_interval(kind, rate_hz)
    vehicle.wait_until(lambda: "GLOBAL_POSITION_INT" in vehicle.last, "GLOBAL_POSITION_INT", 5.0)


def takeoff_command(vehicle: VehicleUnderTest, height: float) -> Any:
    """Return NAV_TAKEOFF to a height above home [m], in the autopilot's altitude frame."""
    if vehicle.dialect.name != "px4":
        return vehicle.command_long(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height)
    amsl_m = vehicle.request("HOME_POSITION").altitude / 1000 + height
    if vehicle.identity.kind == "plane":
        lat, lon = plans.offset(plans.current_position(vehicle), 300, 0)
        return vehicle.command_long(
            mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, lat / 1e7, lon / 1e7, amsl_m
        )
    return vehicle.command_long(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *[math.nan] * 3, amsl_m)


def take_off(vehicle: VehicleUnderTest, height: float, enough_m: float) -> float:
    """Send NAV_TAKEOFF and wait until the vehicle is above `enough_m`; return the time taken [s]."""
    equal(vehicle.result(takeoff_command(vehicle, height)), ACCEPTED, "NAV_TAKEOFF")
    return wait_until_above(vehicle, enough_m)


def wait_until_above(vehicle: VehicleUnderTest, enough_m: float, within_s: float = CLIMB_S) -> float:
    return vehicle.wait_until(
        lambda: height_m(vehicle) > enough_m, f"a height above {enough_m:g} m", within_s
    )


def ensure_airborne(vehicle: VehicleUnderTest) -> None:
    """Start the streams, take off unless airborne, and hold the position (a plane circles)."""
    start_streams(vehicle)
    if not (vehicle.armed and height_m(vehicle) > AIRBORNE_M):
        if vehicle.identity.kind == "plane":
            _launch_plane(vehicle)
        else:
            arm(vehicle)
            take_off(vehicle, HEIGHT_M, HEIGHT_M - 1.0)
            vehicle.wait(3.0)
    hold(vehicle)


def _launch_plane(vehicle: VehicleUnderTest) -> None:
    if vehicle.dialect.name == "ardupilot":
        wait_ready(vehicle)
        set_mode(vehicle, "takeoff")
        vehicle.expect_accepted(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        wait_until_above(vehicle, PLANE_HEIGHT_M * 0.8)
    else:
        arm(vehicle)
        take_off(vehicle, PLANE_HEIGHT_M, PLANE_HEIGHT_M * 0.8)
    vehicle.wait(5.0)


def hold(vehicle: VehicleUnderTest) -> None:
    """Set the hold mode, wait until a copter stands still, then set the mode for commands."""
    if vehicle.dialect.hold_mode is not None and vehicle.mode != mode_number(
        vehicle, vehicle.dialect.hold_mode
    ):
        set_mode(vehicle, vehicle.dialect.hold_mode)
        if vehicle.identity.kind == "copter":
            wait_until_still(vehicle, 20.0)
    set_ready_mode(vehicle)


def ensure_landed(vehicle: VehicleUnderTest) -> None:
    """Land an armed vehicle and wait until the vehicle is disarmed."""
    if not vehicle.armed:
        return
    start_streams(vehicle)
    vehicle.wait(0.5)
    if height_m(vehicle) < 0.5 and speed_m_s(vehicle) < 0.5:
        result = vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        if result == ACCEPTED:
            wait_until_disarmed(vehicle)
            return
    if vehicle.identity.kind == "plane" and "land" not in vehicle.dialect.modes:
        _land_by_mission(vehicle)
    else:
        set_mode(vehicle, "land")
    wait_until_disarmed(vehicle, LAND_S)


def _land_by_mission(vehicle: VehicleUnderTest) -> None:
    """Land a plane at home by mission, with an approach from 600 m south."""
    place = home(vehicle)
    approach = plans.waypoint(place, -600, 0, 40), plans.waypoint(place, -350, 0, 25)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, *approach, plans.land(place)))
    set_current(vehicle, 1)
    set_mode(vehicle, "mission")


# -- movement to a position ------------------------------------------------------------------------------


def home_amsl_m(vehicle: VehicleUnderTest) -> float:
    """Return the altitude of home above sea level [m], from the latest position."""
    return float(position(vehicle).alt - position(vehicle).relative_alt) / 1000


def reposition(vehicle: VehicleUnderTest, target: tuple[int, int], height: float) -> str:
    """Send DO_REPOSITION with a height above home [m]; return the name of the MAV_RESULT."""
    x, y = target
    amsl_m = home_amsl_m(vehicle) + height  # z is above sea level in MAV_FRAME_GLOBAL
    command = vehicle.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, -1, REPOSITION_CHANGES_MODE, 0, math.nan, x=x, y=y, z=amsl_m
    )
    return vehicle.result(command)


def go_to(vehicle: VehicleUnderTest, target: tuple[int, int], height: float) -> None:
    """Send DO_REPOSITION; raise CheckFailed unless the vehicle accepts it."""
    equal(reposition(vehicle, target, height), ACCEPTED, "DO_REPOSITION")


def wait_until_near(
    vehicle: VehicleUnderTest, target: tuple[int, int], within_s: float = 60.0, near_m: float = 3.0
) -> float:
    """Wait until the vehicle is near a position; return the time taken [s]."""
    return vehicle.wait_until(
        lambda: distance_to_m(vehicle, target) < near_m, f"less than {near_m:g} m to the target", within_s
    )
