"""The home position and the origin of the local frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, near, result_name

AWAY_M = 40.0
SET_HOME = mavlink.MAV_CMD_DO_SET_HOME


def _home(peer: Peer) -> Any:
    flying.wait_ready(peer)
    return peer.request("HOME_POSITION")


@contextmanager
def _home_put_back(peer: Peer) -> Iterator[Any]:
    before = _home(peer)
    with peer.owing("home", lambda: _put_back(peer, before)):
        yield before


def _put_back(peer: Peer, before: Any) -> None:
    command = peer.command_int(
        SET_HOME,
        frame=mavlink.MAV_FRAME_GLOBAL,
        x=before.latitude,
        y=before.longitude,
        z=before.altitude / 1000,
    )
    equal(result_name(peer.result(command)), "ACCEPTED", "DO_SET_HOME")


@check("home.by_request_message", limit_s=200)
def by_request_message(peer: Peer) -> str:
    """HOME_POSITION comes on request once there is a position."""
    home = _home(peer)
    holds(home.latitude != 0 or home.longitude != 0, "home is at 0, 0")
    return f"{home.latitude / 1e7:.5f}, {home.longitude / 1e7:.5f}, {home.altitude / 1000:.1f} m"


@check("home.by_get_home_position")
def by_get_home_position(peer: Peer) -> str:
    """GET_HOME_POSITION, where it is still served, brings HOME_POSITION."""
    mark = peer.mark()
    result = peer.command(mavlink.MAV_CMD_GET_HOME_POSITION)
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise Skip(f"deprecated, answered {result_name(result)}")
    peer.expect("HOME_POSITION", mark=mark)
    return "HOME_POSITION"


@check("home.is_near_the_vehicle")
def is_near(peer: Peer) -> str:
    """Before a flight home is where the vehicle stands."""
    home, place = _home(peer), plans.here(peer)
    away_m = plans.distance_m((home.latitude, home.longitude), place)
    holds(away_m < 100, f"expected less than 100 m, saw {away_m:.0f} m")
    return f"{away_m:.1f} m"


@check("home.set_to_here")
def set_to_here(peer: Peer) -> str:
    """DO_SET_HOME with parameter 1 puts home where the vehicle is."""
    with _home_put_back(peer):
        mark = peer.mark()
        peer.accepted(SET_HOME, 1)
        home = peer.maybe("HOME_POSITION", mark=mark) or peer.request("HOME_POSITION")
        away_m = plans.distance_m((home.latitude, home.longitude), plans.here(peer))
        holds(away_m < 5, f"expected less than 5 m, saw {away_m:.1f} m")
    return f"{away_m:.2f} m away"


@check("home.set_to_a_place")
def set_to_a_place(peer: Peer) -> str:
    """DO_SET_HOME as COMMAND_INT puts home at a place to the centimetre, and HOME_POSITION tells it."""
    with _home_put_back(peer) as before:
        x, y = plans.moved((before.latitude, before.longitude), AWAY_M, AWAY_M)
        z = before.altitude / 1000 + 3.0
        command = peer.command_int(SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=x, y=y, z=z)
        equal(result_name(peer.result(command)), "ACCEPTED", "DO_SET_HOME")
        peer.wait(1.0)
        home = peer.request("HOME_POSITION")
        near(plans.distance_m((home.latitude, home.longitude), (x, y)), 0, 0.05, "metres off")
        near(home.altitude / 1000, z, 0.1, "altitude")
    return f"{AWAY_M:g} m north and east"


@check("home.relative_altitude_follows")
def relative_follows(peer: Peer) -> str:
    """relative_alt is counted from the home that was set."""
    with _home_put_back(peer) as before:
        z = before.altitude / 1000 - 5.0
        command = peer.command_int(
            SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=before.latitude, y=before.longitude, z=z
        )
        equal(result_name(peer.result(command)), "ACCEPTED", "DO_SET_HOME")
        peer.wait(1.0)
        message = flying.position(peer)
        near(message.relative_alt / 1000, message.alt / 1000 - z, 0.5, "relative_alt")
    return f"{message.relative_alt / 1000:.1f} m"


@check("home.impossible_place", dialects=("ardupilot", "mavlink"))
def impossible_place(peer: Peer) -> str:
    """A latitude of 95 degrees is refused."""
    with _home_put_back(peer) as before:
        command = peer.command_int(
            SET_HOME, frame=mavlink.MAV_FRAME_GLOBAL, x=950_000_000, y=before.longitude
        )
        result = peer.result(command)
    holds(result != mavlink.MAV_RESULT_ACCEPTED, "expected a refusal, saw ACCEPTED")
    return result_name(result)


@check("home.global_origin")
def global_origin(peer: Peer) -> str:
    """GPS_GLOBAL_ORIGIN, the place of the local frame, is near the vehicle."""
    _home(peer)
    origin = peer.request("GPS_GLOBAL_ORIGIN")
    away_m = plans.distance_m((origin.latitude, origin.longitude), plans.here(peer))
    holds(away_m < 1000, f"expected less than 1 km, saw {away_m:.0f} m")
    return f"{away_m:.1f} m away"
