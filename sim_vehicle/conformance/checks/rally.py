"""Rally points."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.plans import RALLY, Item
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, mission_result_name, near

CLAIMS = ("MISSION_RALLY",)


def _points(peer: Peer, count: int = 3) -> list[Item]:
    place = plans.here(peer)
    blank = Item(mavlink.MAV_CMD_NAV_RALLY_POINT, frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    places = [plans.moved(place, 40.0 * i, -30.0) for i in range(1, count + 1)]
    return [replace(blank, x=x, y=y, z=20.0 + i) for i, (x, y) in enumerate(places)]


@check("rally.is_empty_at_first", claims=CLAIMS, pins="AUTOPILOTS 2: rally ok (count 0)")
def empty(peer: Peer) -> str:
    """A list without points has count 0."""
    known(peer, ardupilot=True, px4=True)
    plans.clear(peer, RALLY)
    equal(plans.count(peer, RALLY), 0, "count")
    return "0"


@check("rally.upload", claims=CLAIMS)
def upload(peer: Peer) -> str:
    """Three points are accepted, asked for in order."""
    done = plans.put(peer, _points(peer), RALLY)
    equal([seq for _, seq in done.requests], [0, 1, 2], "asked for")
    return "3 points"


@check("rally.read_back", claims=CLAIMS)
def read_back(peer: Peer) -> str:
    """Places come back to the last digit, altitudes to the metre."""
    points = _points(peer)
    plans.put(peer, points, RALLY)
    back = plans.download(peer, RALLY)
    equal([(i.command, i.x, i.y) for i in back], [(i.command, i.x, i.y) for i in points], "points")
    for seen, sent in zip(back, points, strict=True):
        near(seen.z, sent.z, 1.0, "z")
    return f"{len(back)} points"


@check("rally.replaces", claims=CLAIMS)
def replaces(peer: Peer) -> str:
    """A shorter list takes the place of a longer one."""
    plans.put(peer, _points(peer, 4), RALLY)
    plans.put(peer, _points(peer, 2), RALLY)
    equal(plans.count(peer, RALLY), 2, "count")
    return "2 points left"


@check("rally.wrong_command", claims=CLAIMS, dialects=("ardupilot", "mavlink"))
def wrong_command(peer: Peer) -> str:
    """A waypoint among the rally points is refused."""
    bad = [replace(point, command=mavlink.MAV_CMD_NAV_WAYPOINT) for point in _points(peer, 1)]
    seen = mission_result_name(plans.upload(peer, bad, RALLY).result)
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check("rally.is_not_the_mission", claims=CLAIMS)
def is_not_the_mission(peer: Peer) -> str:
    """Rally points and mission do not touch each other."""
    mission, points = plans.sample_plan(peer), _points(peer)
    plans.put(peer, mission)
    plans.put(peer, points, RALLY)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, mission), "mission")
    plans.clear(peer)
    equal(plans.count(peer, RALLY), len(points), "rally points")
    return "independent"


@check("rally.clear", claims=CLAIMS)
def clear(peer: Peer) -> str:
    """Clearing removes them."""
    plans.put(peer, _points(peer), RALLY)
    equal(mission_result_name(plans.clear(peer, RALLY)), "ACCEPTED", "MISSION_CLEAR_ALL")
    equal(plans.count(peer, RALLY), 0, "items left")
    return "empty"
