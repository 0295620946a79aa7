"""Progress of a vehicle on its new route."""

from __future__ import annotations

import math

import pytest
from flying_bench import HOME

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import MissionItem, Waypoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.dialects.plan import LAND, WAYPOINT, item_at
from swarmctl.mavlink.procedures.swap.route_progress import RouteProgress

FRAME = LocalFrame(*HOME)


def state(east_m: float, north_m: float, east_m_s: float = 0.0, north_m_s: float = 0.0) -> VehicleState:
    lat_deg, lon_deg = FRAME.to_geodetic(east_m, north_m)
    speed_m_s = math.hypot(east_m_s, north_m_s)
    return VehicleState(
        lat_deg=lat_deg, lon_deg=lon_deg, ground_speed_m_s=speed_m_s, east_m_s=east_m_s, north_m_s=north_m_s
    )


def item(east_m: float, north_m: float, command: int = WAYPOINT) -> MissionItem:
    return item_at(command, 3, Waypoint(*FRAME.to_geodetic(east_m, north_m), 20.0), 20.0)


ROUTE = RouteProgress(state(0.0, 0.0), (item(0.0, 100.0), item(100.0, 100.0), item(200.0, 100.0)))

POSITIONS = [
    ("at the position of the order", state(0.0, 0.0), 0, 0.0),
    ("before the first corner", state(1.0, 60.0), 0, 1.0),
    ("at a corner ahead", state(0.0, 100.0), 0, 0.0),
    ("behind the first corner", state(30.0, 102.0), 1, 2.0),
    ("behind the second corner, straight on", state(130.0, 100.0), 2, 0.0),
    ("past the last item", state(205.0, 100.0), 2, 5.0),
]


@pytest.mark.parametrize(
    ("at", "item_ahead", "cross_track_m"), [p[1:] for p in POSITIONS], ids=[p[0] for p in POSITIONS]
)
def test_the_item_ahead_is_the_end_of_the_present_leg(
    at: VehicleState, item_ahead: int, cross_track_m: float
) -> None:
    found = ROUTE.at(at)
    assert found.item == item_ahead
    assert found.cross_track_m == pytest.approx(cross_track_m, abs=0.1)
    assert not found.is_late


def test_a_later_command_finds_the_vehicle_farther_along() -> None:
    before = state(0.0, 90.0, north_m_s=10.0)
    assert ROUTE.at(before).item == 0
    assert ROUTE.at(before).corner_s == pytest.approx(1.0, abs=0.05)
    assert ROUTE.at(before, later_s=3.0).item == 1
    on = state(10.0, 100.0, east_m_s=10.0)
    assert ROUTE.at(on, later_s=10.0).item == 2


@pytest.mark.parametrize(("later_s", "is_late"), [(0.0, False), (0.9, False), (1.1, True), (3.0, True)])
def test_a_vehicle_past_the_splice_point_is_late(later_s: float, is_late: bool) -> None:
    """Before the splice point, corners common to both routes may be passed."""
    flown = (item(0.0, 0.0), item(0.0, 50.0), item(40.0, 50.0), item(40.0, 400.0))
    new = (item(0.0, 50.0), item(40.0, 50.0), item(40.0, 100.0), item(300.0, 100.0))
    progress = RouteProgress(state(0.0, 0.0), new, flown)
    assert progress.at(state(40.0, 90.0, north_m_s=10.0), later_s).is_late is is_late
    assert not progress.at(state(0.0, 45.0, north_m_s=10.0), later_s).is_late
    assert progress.at(state(40.0, 104.0, north_m_s=10.0)).is_late, "straight on"


@pytest.mark.parametrize(("north_m", "past_splice_m"), [(50.0, -50.0), (100.0, 0.0), (130.0, 30.0)])
def test_a_corner_of_the_flown_route_is_the_splice_point_of_a_route_straight_on(
    north_m: float, past_splice_m: float
) -> None:
    flown = (item(0.0, 0.0), item(0.0, 100.0), item(200.0, 100.0))
    beside_m = 5.0
    progress = RouteProgress(state(beside_m, 0.0), (item(0.0, 400.0), item(200.0, 400.0)), flown)
    at = progress.at(state(beside_m, north_m, north_m_s=10.0))
    assert at.past_splice_m == pytest.approx(past_splice_m, abs=0.2)
    assert at.item == 0


def test_a_corner_ahead_is_common_to_both_routes_if_the_vehicle_is_beside_them() -> None:
    flown = (item(0.0, 0.0), item(0.0, 400.0))
    progress = RouteProgress(state(5.0, 0.0), (item(0.0, 100.0), item(200.0, 100.0)), flown)
    assert progress.at(state(5.0, 110.0, north_m_s=10.0)).is_late


def test_a_plan_stored_after_the_landing_is_not_flown() -> None:
    """A plan that was appended too late stays in the vehicle's list."""
    turn = item(0.0, 100.0)
    flown = (item(0.0, 0.0), item(0.0, 400.0), item(0.0, 400.0, LAND), turn, item(300.0, 100.0))
    progress = RouteProgress(state(0.0, 0.0), (turn, item(200.0, 100.0)), flown)
    assert progress.at(state(0.0, 110.0, north_m_s=10.0)).is_late


def test_a_route_without_a_start_begins_at_its_first_item() -> None:
    unknown = VehicleState()
    assert RouteProgress(unknown, (item(0.0, 100.0),)).at(state(0.0, 0.0)).item == 0
    assert ROUTE.at(unknown).item == 0


def test_the_route_ends_at_the_first_item_without_a_position() -> None:
    """A fixed wing's landing begins with such an item."""
    progress = RouteProgress(
        state(0.0, 0.0), (item(0.0, 100.0), MissionItem(189, 3, 0, 0, 0.0), item(500.0, 500.0))
    )
    assert progress.at(state(0.0, 300.0)).item == 0
