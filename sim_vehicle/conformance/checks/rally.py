"""Rally points."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, holds, mission_result_name, near
from sim_vehicle.conformance.plans import RALLY
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.plan_items import PlanItem

CLAIMS = ("MISSION_RALLY",)


def _points(vehicle: VehicleUnderTest, count: int = 3) -> list[PlanItem]:
    place = plans.current_position(vehicle)
    blank = PlanItem(mavlink.MAV_CMD_NAV_RALLY_POINT, frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    places = [plans.offset(place, 40.0 * i, -30.0) for i in range(1, count + 1)]
    return [replace(blank, x=x, y=y, z=20.0 + i) for i, (x, y) in enumerate(places)]


@check("rally.is_empty_at_first", claims=CLAIMS, source="AUTOPILOTS 2: rally ok (count 0)")
def empty(vehicle: VehicleUnderTest) -> str:
    """After MISSION_CLEAR_ALL the count is 0."""
    known_behaviour(vehicle, ardupilot=True, px4=True)
    plans.clear(vehicle, RALLY)
    equal(plans.count(vehicle, RALLY), 0, "count")
    return "0"


@check("rally.upload", claims=CLAIMS)
def upload(vehicle: VehicleUnderTest) -> str:
    """An upload of three points is accepted, and the vehicle requests them in order."""
    done = plans.upload_or_fail(vehicle, _points(vehicle), RALLY)
    equal([seq for _, seq in done.requests], [0, 1, 2], "requested items")
    return "3 points"


@check("rally.read_back", claims=CLAIMS)
def read_back(vehicle: VehicleUnderTest) -> str:
    """Positions are read back exactly, altitudes within 1 m."""
    points = _points(vehicle)
    plans.upload_or_fail(vehicle, points, RALLY)
    back = plans.download(vehicle, RALLY)
    equal([(i.command, i.x, i.y) for i in back], [(i.command, i.x, i.y) for i in points], "points")
    for seen, sent in zip(back, points, strict=True):
        near(seen.z, sent.z, 1.0, "z")
    return f"{len(back)} points"


@check("rally.replaces", claims=CLAIMS)
def replaces(vehicle: VehicleUnderTest) -> str:
    """A shorter list replaces a longer list."""
    plans.upload_or_fail(vehicle, _points(vehicle, 4), RALLY)
    plans.upload_or_fail(vehicle, _points(vehicle, 2), RALLY)
    equal(plans.count(vehicle, RALLY), 2, "count")
    return "2 points left"


@check("rally.wrong_command", claims=CLAIMS, dialects=("ardupilot", "mavlink"))
def wrong_command(vehicle: VehicleUnderTest) -> str:
    """A waypoint in place of a rally point is refused."""
    bad = [replace(point, command=mavlink.MAV_CMD_NAV_WAYPOINT) for point in _points(vehicle, 1)]
    seen = mission_result_name(plans.upload(vehicle, bad, RALLY).result)
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check("rally.is_not_the_mission", claims=CLAIMS)
def is_not_the_mission(vehicle: VehicleUnderTest) -> str:
    """Rally points do not change the mission; clearing the mission does not change the rally points."""
    mission, points = plans.sample_plan(vehicle), _points(vehicle)
    plans.upload_or_fail(vehicle, mission)
    plans.upload_or_fail(vehicle, points, RALLY)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, mission), "mission")
    plans.clear(vehicle)
    equal(plans.count(vehicle, RALLY), len(points), "rally points")
    return "independent"


@check("rally.clear", claims=CLAIMS)
def clear(vehicle: VehicleUnderTest) -> str:
    """Clearing is accepted and removes the rally points."""
    plans.upload_or_fail(vehicle, _points(vehicle), RALLY)
    equal(mission_result_name(plans.clear(vehicle, RALLY)), "ACCEPTED", "MISSION_CLEAR_ALL")
    equal(plans.count(vehicle, RALLY), 0, "items left")
    return "empty"
