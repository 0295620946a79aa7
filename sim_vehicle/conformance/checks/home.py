"""The home position and the origin of the local frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import at_most, equal, holds, near, refused
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

AWAY_M = 40.0  # offset of a new home, both to the north and to the east
SET_HOME = mavlink.MAV_CMD_DO_SET_HOME


def _home(vehicle: VehicleUnderTest) -> Any:
    flying.wait_ready(vehicle)
    return vehicle.request("HOME_POSITION")


@contextmanager
def _home_restored(vehicle: VehicleUnderTest) -> Iterator[Any]:
    before = _home(vehicle)
    with vehicle.restoring("home", lambda: _restore(vehicle, before)):
        yield before


def _set_home(vehicle: VehicleUnderTest, x: int, y: int, z: float) -> str:
    return vehicle.result(vehicle.command_int(SET_HOME, x=x, y=y, z=z))


def _restore(vehicle: VehicleUnderTest, before: Any) -> None:
    result = _set_home(vehicle, before.latitude, before.longitude, before.altitude / 1000)
    equal(result, ACCEPTED, "DO_SET_HOME")


def _away_m(vehicle: VehicleUnderTest, place: Any, limit_m: float) -> float:
    """Return the distance between a home or origin and the vehicle; raise CheckFailed beyond the limit."""
    away_m = plans.distance_m((place.latitude, place.longitude), plans.current_position(vehicle))
    return at_most(away_m, limit_m, "distance from the vehicle [m]")


@check("home")
def by_request_message(vehicle: VehicleUnderTest) -> str:
    """A vehicle with a position estimate sends HOME_POSITION on request."""
    home = _home(vehicle)
    holds(home.latitude != 0 or home.longitude != 0, "home is at 0, 0")
    return f"{home.latitude / 1e7:.5f}, {home.longitude / 1e7:.5f}, {home.altitude / 1000:.1f} m"


@check("home")
def by_get_home_position(vehicle: VehicleUnderTest) -> None:
    """GET_HOME_POSITION, where supported, brings HOME_POSITION."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_GET_HOME_POSITION)
    if result != ACCEPTED:
        raise Skip(f"the vehicle answers this deprecated command with {result}")
    vehicle.expect("HOME_POSITION", mark=mark)


@check("home")
def is_near_the_vehicle(vehicle: VehicleUnderTest) -> str:
    """Before a flight, home is within 100 m of the vehicle."""
    return f"{_away_m(vehicle, _home(vehicle), 100):.1f} m"


@check("home")
def set_to_here(vehicle: VehicleUnderTest) -> str:
    """DO_SET_HOME with 1 as parameter 1 sets home to the vehicle's position, within 5 m."""
    with _home_restored(vehicle):
        mark = vehicle.mark()
        vehicle.expect_accepted(SET_HOME, 1)
        home = vehicle.wait_for("HOME_POSITION", mark=mark) or vehicle.request("HOME_POSITION")
        return f"{_away_m(vehicle, home, 5):.2f} m away"


@check("home")
def set_to_a_place(vehicle: VehicleUnderTest) -> None:
    """DO_SET_HOME as COMMAND_INT sets home within 5 cm, and HOME_POSITION reports the new home."""
    with _home_restored(vehicle) as before:
        x, y = plans.offset((before.latitude, before.longitude), AWAY_M, AWAY_M)
        z = before.altitude / 1000 + 3.0
        equal(_set_home(vehicle, x, y, z), ACCEPTED, "DO_SET_HOME")
        vehicle.wait(1.0)
        home = vehicle.request("HOME_POSITION")
        near(plans.distance_m((home.latitude, home.longitude), (x, y)), 0, 0.05, "metres off")
        near(home.altitude / 1000, z, 0.1, "altitude")


@check("home")
def relative_altitude_follows(vehicle: VehicleUnderTest) -> str:
    """After DO_SET_HOME, relative_alt is the height above the new home."""
    with _home_restored(vehicle) as before:
        z = before.altitude / 1000 - 5.0
        equal(_set_home(vehicle, before.latitude, before.longitude, z), ACCEPTED, "DO_SET_HOME")
        vehicle.wait(1.0)
        message = vehicle.request("GLOBAL_POSITION_INT")
        near(message.relative_alt / 1000, message.alt / 1000 - z, 0.5, "relative_alt")
    return f"{message.relative_alt / 1000:.1f} m"


@check("home", dialects=("ardupilot", "mavlink"))
def impossible_place(vehicle: VehicleUnderTest) -> str:
    """DO_SET_HOME to a latitude of 95 degrees is refused."""
    with _home_restored(vehicle) as before:
        return refused(_set_home(vehicle, 950_000_000, before.longitude, 0.0))


@check("home")
def global_origin(vehicle: VehicleUnderTest) -> str:
    """GPS_GLOBAL_ORIGIN, the origin of the local frame, is within 1 km of the vehicle."""
    _home(vehicle)
    return f"{_away_m(vehicle, vehicle.request('GPS_GLOBAL_ORIGIN'), 1000):.1f} m away"
