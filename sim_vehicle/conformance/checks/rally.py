"""Rally points."""

from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import ACCEPTED, equal, near, refused
from sim_vehicle.conformance.plans import RALLY
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

_rally_check = partial(check, claims=("MISSION_RALLY",))


def _points(vehicle: VehicleUnderTest, count: int = 3) -> list[PlanItem]:
    place = plans.current_position(vehicle)
    blank = PlanItem(mavlink.MAV_CMD_NAV_RALLY_POINT, frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    places = [plans.offset(place, 40.0 * i, -30.0) for i in range(1, count + 1)]
    return [replace(blank, x=x, y=y, z=20.0 + i) for i, (x, y) in enumerate(places)]


@_rally_check("rally.is_empty_at_first", source="AUTOPILOTS 2: rally ok (count 0)")
def empty(vehicle: VehicleUnderTest) -> str:
    """After MISSION_CLEAR_ALL the count is 0."""
    vehicle.known(ardupilot=True, px4=True)
    plans.clear(vehicle, RALLY)
    return str(equal(plans.count(vehicle, RALLY), 0, "count"))


@_rally_check("rally.upload")
def upload(vehicle: VehicleUnderTest) -> str:
    """An upload of three points is accepted, and the vehicle requests them in order."""
    done = plans.upload_or_fail(vehicle, _points(vehicle), RALLY)
    equal([seq for _, seq in done.requests], [0, 1, 2], "requested items")
    return "3 points"


@_rally_check("rally.read_back")
def read_back(vehicle: VehicleUnderTest) -> str:
    """Positions are read back exactly, altitudes within 1 m."""
    points = _points(vehicle)
    for seen, sent in zip(plans.store(vehicle, points, RALLY), points, strict=True):
        near(seen.z, sent.z, 1.0, "z")
    return f"{len(points)} points"


@_rally_check("rally.replaces")
def replaces(vehicle: VehicleUnderTest) -> str:
    """A shorter list replaces a longer list."""
    plans.upload_or_fail(vehicle, _points(vehicle, 4), RALLY)
    plans.upload_or_fail(vehicle, _points(vehicle, 2), RALLY)
    return f"{equal(plans.count(vehicle, RALLY), 2, 'count')} points left"


@_rally_check("rally.wrong_command", dialects=("ardupilot", "mavlink"))
def wrong_command(vehicle: VehicleUnderTest) -> str:
    """A waypoint in place of a rally point is refused."""
    bad = [replace(point, command=mavlink.MAV_CMD_NAV_WAYPOINT) for point in _points(vehicle, 1)]
    return refused(plans.upload(vehicle, bad, RALLY).result)


@_rally_check("rally.is_not_the_mission")
def is_not_the_mission(vehicle: VehicleUnderTest) -> str:
    """Rally points do not change the mission; clearing the mission does not change the rally points."""
    mission, points = plans.store_sample(vehicle), _points(vehicle)
    plans.upload_or_fail(vehicle, points, RALLY)
    plans.expect_stored(vehicle, mission)
    plans.clear(vehicle)
    equal(plans.count(vehicle, RALLY), len(points), "rally points")
    return "independent"


@_rally_check("rally.clear")
def clear(vehicle: VehicleUnderTest) -> str:
    """Clearing is accepted and removes the rally points."""
    plans.upload_or_fail(vehicle, _points(vehicle), RALLY)
    equal(plans.clear(vehicle, RALLY), ACCEPTED, "MISSION_CLEAR_ALL")
    equal(plans.count(vehicle, RALLY), 0, "items left")
    return "empty"
