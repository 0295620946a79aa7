"""The start and the end of a flight: take-off, return, landing."""

from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import equal, holds, near
from sim_vehicle.conformance.guard import ARM
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

_copter_check = partial(check, airborne=True, kind="copter", limit_s=300)


@_copter_check("flight.land.can_be_broken_off")
def land_broken_off(vehicle: VehicleUnderTest) -> str:
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


@_copter_check("flight.return.comes_home", limit_s=400)
def return_home(vehicle: VehicleUnderTest) -> str:
    """After RETURN_TO_LAUNCH the vehicle lands within 5 m of home and disarms."""
    target = flying.home(vehicle)
    away = plans.offset(target, 30.0, 0.0)
    flying.reposition(vehicle, away, 20.0)
    flying.wait_until_near(vehicle, away, 60, 5)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    flying.wait_for_mode(vehicle, "return")
    took_s = flying.wait_until_landed(vehicle, 240)
    off_m = flying.distance_to_m(vehicle, target)
    holds(off_m < 5, f"expected a landing within 5 m of home, saw {off_m:.1f} m")
    return f"{off_m:.2f} m from home after {took_s:.0f} s"


@check("flight.return.circles_home", airborne=True, kind="plane", limit_s=400)
def return_plane(vehicle: VehicleUnderTest) -> str:
    """After RETURN_TO_LAUNCH a plane flies home, and is within 400 m of home 10 s later."""
    target = flying.home(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    took_s = flying.wait_until_near(vehicle, target, 200.0, 250.0)
    vehicle.wait(10.0)
    away_m = flying.distance_to_m(vehicle, target)
    holds(away_m < 400, f"expected less than 400 m from home, saw {away_m:.0f} m")
    return f"near home after {took_s:.0f} s"


@check("flight.takeoff.reaches_the_height", needs=[ARM], kind="copter", limit_s=300)
def takeoff_height(vehicle: VehicleUnderTest) -> str:
    """After NAV_TAKEOFF the vehicle climbs to the given height and stays there."""
    flying.start_streams(vehicle)
    flying.arm(vehicle)
    took_s = flying.take_off(vehicle, 15.0, 14.0)
    vehicle.wait(5.0)
    near(flying.height_m(vehicle), 15.0, 1.5, "height [m]")
    return f"{flying.height_m(vehicle):.1f} m after {took_s:.0f} s"


@_copter_check("flight.land.comes_down")
def land_comes_down(vehicle: VehicleUnderTest) -> str:
    """After NAV_LAND the vehicle lands within 4 m and disarms, and landed_state is ON_GROUND."""
    place = flying.last_position(vehicle)
    vehicle.expect_accepted(mavlink.MAV_CMD_NAV_LAND)
    took_s = flying.wait_until_landed(vehicle, 120)
    off_m = flying.distance_to_m(vehicle, place)
    holds(off_m < 4, f"expected a landing within 4 m, saw {off_m:.1f} m")
    near(flying.height_m(vehicle), 0.0, 2.0, "height [m]")
    vehicle.wait(1.0)
    state = vehicle.request("EXTENDED_SYS_STATE").landed_state
    equal(state, mavlink.MAV_LANDED_STATE_ON_GROUND, "landed_state")
    return f"after {took_s:.0f} s, {off_m:.2f} m away"
