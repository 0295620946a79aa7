"""The home position and the origin of the local frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import ACCEPTED, Skip, equal, holds, near, refused
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


def _restore(vehicle: VehicleUnderTest, before: Any) -> None:
    command = vehicle.command_int(
        SET_HOME,
        frame=mavlink.MAV_FRAME_GLOBAL,
        x=before.latitude,
        y=before.longitude,
        z=before.altitude / 1000,
    )
    equal(vehicle.result(command), ACCEPTED, "DO_SET_HOME")


@check("home.by_request_message", limit_s=200)
def by_request_message(vehicle: VehicleUnderTest) -> str:
    """A vehicle with a position estimate sends HOME_POSITION on request."""
    home = _home(vehicle)
    holds(home.latitude != 0 or home.longitude != 0, "home is at 0, 0")
    return f"{home.latitude / 1e7:.5f}, {home.longitude / 1e7:.5f}, {home.altitude / 1000:.1f} m"


@check("home.by_get_home_position")
def by_get_home_position(vehicle: VehicleUnderTest) -> str:
    """GET_HOME_POSITION, where supported, brings HOME_POSITION."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_GET_HOME_POSITION)
    if result != ACCEPTED:
        raise Skip(f"the vehicle answers this deprecated command with {result}")
    vehicle.expect("HOME_POSITION", mark=mark)
    return "HOME_POSITION"


@check("home.is_near_the_vehicle")
def is_near(vehicle: VehicleUnderTest) -> str:
    """Before a flight, home is within 100 m of the vehicle."""
    home, place = _home(vehicle), plans.current_position(vehicle)
    away_m = plans.distance_m((home.latitude, home.longitude), place)
    holds(away_m < 100, f"expected less than 100 m, saw {away_m:.0f} m")
    return f"{away_m:.1f} m"


@check("home.set_to_here")
def set_to_here(vehicle: VehicleUnderTest) -> str:
    """DO_SET_HOME with 1 as parameter 1 sets home to the vehicle's position, within 5 m."""
    with _home_restored(vehicle):
        mark = vehicle.mark()
        vehicle.expect_accepted(SET_HOME, 1)
        home = vehicle.wait_for("HOME_POSITION", mark=mark) or vehicle.request("HOME_POSITION")
        away_m = plans.distance_m((home.latitude, home.longitude), plans.current_position(vehicle))
        holds(away_m < 5, f"expected less than 5 m, saw {away_m:.1f} m")
    return f"{away_m:.2f} m away"


@check("home.set_to_a_place")
def set_to_a_place(vehicle: VehicleUnderTest) -> str:
    """DO_SET_HOME as COMMAND_INT sets home within 5 cm, and HOME_POSITION reports the new home."""
    with _home_restored(vehicle) as before:
        x, y = plans.offset((before.latitude, before.longitude), AWAY_M, AWAY_M)
        z = before.altitude / 1000 + 3.0
        command = vehicle.command_int(SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=x, y=y, z=z)
        equal(vehicle.result(command), ACCEPTED, "DO_SET_HOME")
        vehicle.wait(1.0)
        home = vehicle.request("HOME_POSITION")
        near(plans.distance_m((home.latitude, home.longitude), (x, y)), 0, 0.05, "metres off")
        near(home.altitude / 1000, z, 0.1, "altitude")
    return f"{AWAY_M:g} m north and east"


@check("home.relative_altitude_follows")
def relative_follows(vehicle: VehicleUnderTest) -> str:
    """After DO_SET_HOME, relative_alt is the height above the new home."""
    with _home_restored(vehicle) as before:
        z = before.altitude / 1000 - 5.0
        command = vehicle.command_int(
            SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=before.latitude, y=before.longitude, z=z
        )
        equal(vehicle.result(command), ACCEPTED, "DO_SET_HOME")
        vehicle.wait(1.0)
        message = flying.position(vehicle)
        near(message.relative_alt / 1000, message.alt / 1000 - z, 0.5, "relative_alt")
    return f"{message.relative_alt / 1000:.1f} m"


@check("home.impossible_place", dialects=("ardupilot", "mavlink"))
def impossible_place(vehicle: VehicleUnderTest) -> str:
    """DO_SET_HOME to a latitude of 95 degrees is refused."""
    with _home_restored(vehicle) as before:
        command = vehicle.command_int(
            SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=950_000_000, y=before.longitude
        )
        result = vehicle.result(command)
    return refused(result)


@check("home.global_origin")
def global_origin(vehicle: VehicleUnderTest) -> str:
    """GPS_GLOBAL_ORIGIN, the origin of the local frame, is within 1 km of the vehicle."""
    _home(vehicle)
    origin = vehicle.request("GPS_GLOBAL_ORIGIN")
    away_m = plans.distance_m((origin.latitude, origin.longitude), plans.current_position(vehicle))
    holds(away_m < 1000, f"expected less than 1 km, saw {away_m:.0f} m")
    return f"{away_m:.1f} m away"
