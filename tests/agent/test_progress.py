"""The progress on a planned flight, for a vehicle that has flown a known distance."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmctl.agent.progress import PlannedFlight, Progress, progress_on
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import Waypoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.route import flight_plan
from swarmctl.core.vehicle import VehicleState

GRID = Grid(12, 12, 50.0, 46.0, 14.0)
HOME = GRID.frame.to_geodetic(-80.0, 25.0)
STEPS = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]


def plan_over(cells: tuple[Cell, ...], begins: Waypoint | None = None) -> PlannedMission:
    plan = flight_plan(GRID, cells, altitude_m=30.0, landing_lat_lon=GRID.centre(cells[-1]))
    return PlannedMission(1, replace(plan, begins=begins), cells, (), 0.0, 0.0, 1.0, 0.0)


def at(east_m: float, north_m: float, velocity_m_s: tuple[float, float] = (0.0, 0.0)) -> VehicleState:
    lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, north_m)
    return VehicleState(
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_rel_m=30.0,
        alt_amsl_m=330.0,
        east_m_s=velocity_m_s[0],
        north_m_s=velocity_m_s[1],
        ground_speed_m_s=math.hypot(*velocity_m_s),
        armed=True,
        home_lat_deg=HOME[0],
        home_lon_deg=HOME[1],
    )


@st.composite
def routes(draw: st.DrawFn) -> tuple[Cell, ...]:
    """Return a route over neighbouring cells, which may come back over its own cells."""
    cells = [(0, 0)]
    for step in draw(st.lists(st.sampled_from(STEPS), min_size=2, max_size=12)):
        cell = (cells[-1][0] + step[0], cells[-1][1] + step[1])
        if min(cell) >= 0 and max(cell) < 12:
            cells.append(cell)
    return tuple(cells) if len(cells) > 1 else ((0, 0), (0, 1))


def flown(plan: PlannedMission, step_m: float, beside_m: float = 0.0) -> list[tuple[float, Progress]]:
    """Return the true distance along the flight and the progress, as the vehicle flies its plan."""
    legs = PlannedFlight.of(plan, GRID, at(0.0, 0.0)).legs
    rows: list[tuple[float, Progress]] = []
    along_m = 0.0
    while along_m <= legs.at_m[-2]:
        (east_m, north_m), ahead_m = legs.point_at(along_m), legs.point_at(along_m + 0.01)
        velocity_m_s = 500.0 * (ahead_m[0] - east_m), 500.0 * (ahead_m[1] - north_m)
        before = rows[-1][1] if rows else None
        progress = progress_on(plan, before, GRID, at(east_m + beside_m, north_m - beside_m, velocity_m_s))
        assert progress is not None
        rows.append((along_m, progress))
        along_m += step_m
    return rows


@given(cells=routes(), step_m=st.floats(0.5, 8.0), beside_m=st.floats(-2.0, 2.0))
@settings(max_examples=150, deadline=None)
def test_the_progress_is_the_distance_flown_also_where_a_route_comes_back(
    cells: tuple[Cell, ...], step_m: float, beside_m: float
) -> None:
    rows = flown(plan_over(cells), step_m, beside_m)
    # A vehicle beside a sharp corner may be nearer to the leg after it.
    off_m = 2.0 * step_m + 8.0 * abs(beside_m) + 1.0
    assert all(math.isclose(row.along_m, true_m, abs_tol=off_m) for true_m, row in rows)
    indices = [row.cell_index for _, row in rows]
    assert max((a - b for a, b in pairwise(indices)), default=0) <= 1
    assert indices[-1] >= len(cells) - 2
    assert all(row.is_on_route for _, row in rows)
    centre = GRID.centre_m(cells[rows[-1][1].cell_index])
    assert math.dist(rows[-1][1].here, centre) <= 50.0 * math.sqrt(2.0)


def test_the_leg_from_the_take_off_to_the_first_centre_belongs_to_the_flight() -> None:
    first = flown(plan_over(((0, 0), (0, 1), (0, 2))), 5.0)[0][1]
    assert (first.cell_index, first.waypoint, first.is_centre_passed) == (0, 0, False)
    assert first.to_centre_m(0) == pytest.approx(105.0, abs=0.1)
    assert first.to_last_waypoint_m == pytest.approx(205.0, abs=0.1)


def test_a_plan_begun_past_a_centre_has_passed_that_centre() -> None:
    begins = Waypoint(*GRID.frame.to_geodetic(40.0, 25.0), 30.0)
    plan = plan_over(((0, 0), (0, 1), (0, 2)), begins)
    plan = PlannedMission(
        2, replace(plan.plan, track=plan.plan.track[1:]), plan.cells, (), 0.0, 0.0, 1.0, 0.0
    )
    progress = progress_on(plan, None, GRID, at(40.0, 25.0))
    assert progress is not None
    assert (progress.cell_index, progress.is_centre_passed) == (0, True)


def test_a_position_beside_the_flight_is_off_the_route_from_three_quarters_of_a_cell_on() -> None:
    plan = plan_over(((2, 0), (2, 1), (2, 2), (2, 3)))
    near, far = (progress_on(plan, None, GRID, at(100.0, 125.0 + away_m)) for away_m in (36.0, 39.0))
    assert near is not None
    assert far is not None
    assert (near.is_on_route, far.is_on_route) == (True, False)


def test_a_corner_stays_ahead_until_it_is_passed() -> None:
    plan = plan_over(((0, 0), (0, 1), (0, 2), (1, 2), (2, 2)))
    legs = PlannedFlight.of(plan, GRID, at(0.0, 0.0)).legs
    corner_m = legs.at_m[2]
    waypoints = []
    for away_m in (-1.0, 0.0, 1.0):
        progress = progress_on(plan, None, GRID, at(*legs.point_at(corner_m + away_m)))
        assert progress is not None
        waypoints.append(progress.waypoint)
    assert waypoints == [1, 1, 2]


def test_a_vehicle_that_moves_back_before_a_corner_stays_before_it() -> None:
    plan = plan_over(((0, 0), (0, 3), (0, 0)))
    rows = flown(plan, 1.0)
    turns_m = PlannedFlight.of(plan, GRID, at(0.0, 0.0)).legs.at_m[2]
    progress = next(row for true_m, row in rows if true_m >= turns_m - 10.0)
    for back_m in (1.0, 2.0, 3.0):
        place = rows[int(turns_m - 10.0 - back_m)][1].here
        after = progress_on(plan, progress, GRID, at(*place, (-2.0, 0.0)))
        assert after is not None
        progress = after
        assert progress.along_m < turns_m
