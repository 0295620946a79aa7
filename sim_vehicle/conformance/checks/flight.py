"""Flight by commands: take-off, holding, repositioning, speed, return, landing."""

import math
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, near, refused, within
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

NORTH_M = 40.0  # distance of a reposition to the north
REPOSITION = mavlink.MAV_CMD_DO_REPOSITION
MAX_STOP_S = 10.0  # longest time to a stop
MAX_TURN_S = 20.0  # longest time for a turn of 90 degrees
_check = partial(check, airborne=True)
_copter_check = partial(check, airborne=True, kind="copter")
_plane_check = partial(check, airborne=True, kind="plane")


@check("flight.takeoff", needs=[ARM], kind="copter")
def leaves_the_ground(vehicle: VehicleUnderTest) -> str:
    """In a take-off landed_state changes from ON_GROUND to IN_AIR, without LANDING in between."""
    flying.ensure_landed(vehicle)
    vehicle.set_interval("EXTENDED_SYS_STATE", 10)
    mark = vehicle.mark()
    flying.ensure_airborne(vehicle)
    states = [m.landed_state for m in vehicle.since(mark, "EXTENDED_SYS_STATE")]
    seen = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    equal(seen[0], mavlink.MAV_LANDED_STATE_ON_GROUND, "first landed_state")
    equal(seen[-1], mavlink.MAV_LANDED_STATE_IN_AIR, "last landed_state")
    holds(mavlink.MAV_LANDED_STATE_LANDING not in seen, f"expected no LANDING, saw {seen}")
    return " ".join(mavlink.enums["MAV_LANDED_STATE"][s].name.removeprefix("MAV_LANDED_STATE_") for s in seen)


@_check("flight")
def status_is_active(vehicle: VehicleUnderTest) -> None:
    """In the air system_status is ACTIVE and the armed flag is set."""
    vehicle.expect("HEARTBEAT", within_s=3)
    vehicle.wait(1.0)
    equal(vehicle.heartbeat.system_status, mavlink.MAV_STATE_ACTIVE, "system_status")
    holds(vehicle.armed, "the vehicle is not armed")


@_check("flight", source="AUTOPILOTS 1.14: Disarm in flight")
def disarm_is_refused(vehicle: VehicleUnderTest) -> str:
    """Disarming in flight without force is refused."""
    if vehicle.dialect.refusal is None:
        raise Skip("the behaviour of this autopilot is unknown")
    result = vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    vehicle.wait(1.5)
    holds(vehicle.armed, "the vehicle disarmed in flight")
    return equal(result, vehicle.dialect.refusal, "disarming")


@_copter_check("flight.hold", source="AUTOPILOTS 1.6: BRAKE, GUIDED hold altitude")
def keeps_its_place(vehicle: VehicleUnderTest) -> str:
    """After 10 s in the hold mode, the position has changed by at most 2.5 m and the height by 1 m."""
    flying.set_mode(vehicle, "hold")
    flying.wait_until_still(vehicle, MAX_STOP_S, 0.5)
    place, height_m = flying.last_position(vehicle), flying.height_m(vehicle)
    vehicle.wait(10.0)
    moved_m = at_most(flying.distance_to_m(vehicle, place), 2.5, "drift [m]")
    near(flying.height_m(vehicle), height_m, 1.0, "height [m]")
    return f"{moved_m:.2f} m"


@_plane_check("flight.hold")
def circles(vehicle: VehicleUnderTest) -> str:
    """In the hold mode a plane moves on, stays within 600 m, and keeps its height within 15 m."""
    flying.set_mode(vehicle, "hold")
    vehicle.wait(5.0)
    place, height_m = flying.last_position(vehicle), flying.height_m(vehicle)
    farthest_m = 0.0
    for _ in range(40):
        vehicle.wait(1.0)
        farthest_m = max(farthest_m, flying.distance_to_m(vehicle, place))
        at_least(flying.speed_m_s(vehicle), 3.0, "speed [m/s]")
    near(flying.height_m(vehicle), height_m, 15.0, "height [m]")
    return f"within {within(farthest_m, 20, 600, 'greatest distance [m]'):.0f} m"


@_copter_check(
    "flight.mode",
    needs=["simulator"],
    dialects=("ardupilot",),
    source="AUTOPILOTS 1.6: LOITER descended into the ground",
)
def loiter_without_rc(vehicle: VehicleUnderTest) -> str:
    """LOITER without an RC throttle descends more than 3 m in 3 s."""
    height_m = flying.height_m(vehicle)
    flying.set_mode(vehicle, "loiter")
    vehicle.wait(3.0)
    sunk_m = height_m - flying.height_m(vehicle)
    flying.set_mode(vehicle, "hold")
    return f"{at_least(sunk_m, 3.0, 'descent [m]'):.1f} m in 3 s"


@_copter_check("flight.reposition", source="AUTOPILOTS 1.17")
def goes_there(vehicle: VehicleUnderTest) -> str:
    """DO_REPOSITION as COMMAND_INT moves the vehicle to a position and height."""
    target = plans.offset(flying.last_position(vehicle), NORTH_M, NORTH_M / 2)
    flying.go_to(vehicle, target, 25.0)
    took_s = flying.wait_until_near(vehicle, target)
    vehicle.wait_until(lambda: abs(flying.height_m(vehicle) - 25.0) < 1.5, "a height of 25 m", 40)
    return f"{took_s:.0f} s for {NORTH_M:g} m"


@_plane_check("flight.reposition")
def circles_there(vehicle: VehicleUnderTest) -> str:
    """After DO_REPOSITION a plane arrives at the new position and stays within 300 m."""
    target = plans.offset(flying.last_position(vehicle), 400.0, 0.0)
    flying.go_to(vehicle, target, 60.0)
    took_s = flying.wait_until_near(vehicle, target, 120.0, 150.0)
    vehicle.wait(20.0)
    at_most(flying.distance_to_m(vehicle, target), 300, "distance 20 s after the arrival [m]")
    return f"arrived after {took_s:.0f} s"


@_check("flight.reposition")
def changes_mode(vehicle: VehicleUnderTest) -> str:
    """DO_REPOSITION takes a returning ArduPilot to GUIDED, and a returning PX4 to Hold."""
    role = vehicle.known(ardupilot="guided", px4="hold")
    flying.set_mode(vehicle, "return")
    target = plans.offset(flying.last_position(vehicle), NORTH_M, 0.0)
    flying.go_to(vehicle, target, flying.height_m(vehicle))
    took_s = flying.wait_for_mode(vehicle, role, 5.0)
    return f"{role} after {took_s:.1f} s"


@_check("flight.reposition", source="AUTOPILOTS 1.17: LONG -> UNSUPPORTED")
def by_command_long(vehicle: VehicleUnderTest) -> str:
    """DO_REPOSITION as COMMAND_LONG is UNSUPPORTED on ArduPilot and accepted by PX4."""
    expected = vehicle.known(ardupilot="UNSUPPORTED", px4=ACCEPTED)
    lat, lon = plans.offset(flying.last_position(vehicle), 10, 0)
    place = lat / 1e7, lon / 1e7, flying.home_amsl_m(vehicle) + flying.height_m(vehicle)
    seen = vehicle.command(REPOSITION, -1, flying.REPOSITION_CHANGES_MODE, 0, math.nan, *place)
    return equal(seen, expected, "COMMAND_LONG")


@_check("flight.reposition", dialects=("ardupilot",))
def impossible_place(vehicle: VehicleUnderTest) -> str:
    """DO_REPOSITION to a latitude of 95 degrees is refused."""
    return refused(flying.reposition(vehicle, (950_000_000, flying.last_position(vehicle)[1]), 20.0))


@_copter_check("flight.speed")
def is_kept(vehicle: VehicleUnderTest) -> str:
    """After DO_CHANGE_SPEED to 4 m/s the vehicle flies at that speed."""
    target = plans.offset(flying.last_position(vehicle), -90.0, 0.0)
    height_m = flying.height_m(vehicle)
    flying.go_to(vehicle, target, height_m)
    vehicle.expect_accepted(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4.0, -1)
    vehicle.wait(12.0)  # PX4's SIH reaches its speed slowly, against drag
    mean_m_s = flying.mean_speed_m_s(vehicle, 4.0)
    vehicle.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 8.0, -1)
    near(mean_m_s, 4.0, 0.8, "mean speed [m/s]")
    return f"{mean_m_s:.2f} m/s"


@_copter_check("flight.yaw", dialects=("ardupilot",))
def turns(vehicle: VehicleUnderTest) -> str:
    """CONDITION_YAW in GUIDED turns the nose to a heading."""
    heading_deg = vehicle.request("VFR_HUD").heading
    target_deg = (heading_deg + 90) % 360
    vehicle.expect_accepted(mavlink.MAV_CMD_CONDITION_YAW, target_deg, 30, 1, 0)
    with vehicle.streaming({"VFR_HUD": 5.0}):
        took_s = vehicle.wait_until(
            lambda: abs((vehicle.last["VFR_HUD"].heading - target_deg + 180) % 360 - 180) < 5,
            f"a heading of {target_deg} deg",
            MAX_TURN_S,
        )
    return f"{heading_deg} to {target_deg} deg in {took_s:.1f} s"


@_copter_check("flight", source="AUTOPILOTS 2: pause/continue (193)")
def pause(vehicle: VehicleUnderTest) -> str:
    """After an accepted DO_PAUSE_CONTINUE ArduPilot stands still; PX4 answers UNSUPPORTED."""
    expected = vehicle.known(ardupilot=None, px4="UNSUPPORTED")
    seen = vehicle.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0)
    if expected is not None:
        return equal(seen, expected, "DO_PAUSE_CONTINUE")
    if seen == ACCEPTED:
        flying.wait_until_still(vehicle, MAX_STOP_S)
    return seen


@_check("flight", dialects=("ardupilot",), source="AUTOPILOTS 1.9; ArduPlane mode_auto.cpp, ModeAuto::update")
def mission_mode_when_empty(vehicle: VehicleUnderTest) -> str:
    """AUTO with an empty mission is refused in the air; a plane accepts it and returns."""
    plans.upload_or_fail(vehicle, [])
    expected = ACCEPTED if vehicle.identity.kind == "plane" else "FAILED"
    seen = flying.try_mode(vehicle, "mission")
    equal(seen, expected, "AUTO")
    if seen == ACCEPTED:
        flying.wait_for_mode(vehicle, "return")
    return seen


@_copter_check("flight.land")
def can_be_broken_off(vehicle: VehicleUnderTest) -> str:
    """A change to the hold mode ends a landing in the air, and the vehicle keeps its height."""
    flying.set_mode(vehicle, "land")
    vehicle.wait(3.0)
    flying.set_mode(vehicle, "hold")
    vehicle.wait(3.0)
    height_m = flying.height_m(vehicle)
    vehicle.wait(4.0)
    near(flying.height_m(vehicle), height_m, 1.0, "height [m]")
    holds(vehicle.armed, "the vehicle disarmed")
    return f"at {height_m:.1f} m"


@_copter_check("flight.return")
def comes_home(vehicle: VehicleUnderTest) -> str:
    """After RETURN_TO_LAUNCH the vehicle lands within 5 m of home and disarms."""
    target = flying.home(vehicle)
    away = plans.offset(target, 30.0, 0.0)
    flying.reposition(vehicle, away, 20.0)
    flying.wait_until_near(vehicle, away, 60, 5)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    flying.wait_for_mode(vehicle, "return")
    took_s = flying.wait_until_disarmed(vehicle, 240)
    off_m = at_most(flying.distance_to_m(vehicle, target), 5, "distance of the landing from home [m]")
    return f"{off_m:.2f} m from home after {took_s:.0f} s"


@check("flight.return", airborne=True, kind="plane")
def circles_home(vehicle: VehicleUnderTest) -> str:
    """After RETURN_TO_LAUNCH a plane flies home, and is within 400 m of home 10 s later."""
    target = flying.home(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    took_s = flying.wait_until_near(vehicle, target, 200.0, 250.0)
    vehicle.wait(10.0)
    at_most(flying.distance_to_m(vehicle, target), 400, "distance from home [m]")
    return f"near home after {took_s:.0f} s"


@check("flight.takeoff", needs=[ARM], kind="copter")
def reaches_the_height(vehicle: VehicleUnderTest) -> str:
    """After NAV_TAKEOFF the vehicle climbs to the given height and stays there."""
    flying.start_streams(vehicle)
    flying.arm(vehicle)
    took_s = flying.take_off(vehicle, 15.0, 14.0)
    vehicle.wait(5.0)
    near(flying.height_m(vehicle), 15.0, 1.5, "height [m]")
    return f"{flying.height_m(vehicle):.1f} m after {took_s:.0f} s"


@_copter_check("flight.land")
def comes_down(vehicle: VehicleUnderTest) -> str:
    """After NAV_LAND the vehicle lands within 4 m and disarms, and landed_state is ON_GROUND."""
    place = flying.last_position(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_LAND)
    took_s = flying.wait_until_disarmed(vehicle, 120)
    off_m = at_most(flying.distance_to_m(vehicle, place), 4, "distance of the landing [m]")
    near(flying.height_m(vehicle), 0.0, 2.0, "height [m]")
    vehicle.wait(1.0)
    state = vehicle.request("EXTENDED_SYS_STATE").landed_state
    equal(state, mavlink.MAV_LANDED_STATE_ON_GROUND, "landed_state")
    return f"after {took_s:.0f} s, {off_m:.2f} m away"
