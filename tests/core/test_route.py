import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.route import ends_and_turns, flight_plan, landing_spot

GRID = Grid(rows=8, cols=8, cell_size_m=50.0, origin_lat_deg=47.4, origin_lon_deg=8.5)
QUICK = settings(max_examples=examples(80), deadline=None, derandomize=True)
STEPS = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
HOME = (47.39, 8.49)


def walk(start: Cell, steps: list[Cell]) -> list[Cell]:
    rows, cols = zip(start, *steps, strict=True)
    return list(zip(itertools.accumulate(rows), itertools.accumulate(cols), strict=True))


def cells_under_track(turns: Sequence[Cell]) -> tuple[Cell, ...]:
    """Return the cells under straight or diagonal legs between the centres of `turns`, in flown order."""
    covered = list(turns[:1])
    for here, there in itertools.pairwise(turns):
        d_row, d_col = there[0] - here[0], there[1] - here[1]
        n_steps = max(abs(d_row), abs(d_col))
        assert 0 in (d_row, d_col) or abs(d_row) == abs(d_col)
        covered += [
            (here[0] + k * d_row // n_steps, here[1] + k * d_col // n_steps) for k in range(1, n_steps + 1)
        ]
    return tuple(covered)


def at(east_m: float, north_m: float) -> LatLon:
    return GRID.frame.to_geodetic(east_m, north_m)


def tracks(plan: FlightPlan) -> list[Cell | None]:
    return [GRID.cell_at(point.lat_deg, point.lon_deg) for point in plan.track]


@QUICK
@given(st.tuples(st.integers(0, 9), st.integers(0, 9)), st.lists(st.sampled_from(STEPS), max_size=40))
def test_thinning_keeps_the_cells_under_the_track(start: Cell, steps: list[Cell]) -> None:
    cells = walk(start, steps)
    turns = ends_and_turns(cells)
    assert cells_under_track(turns) == tuple(cells)
    assert ends_and_turns(turns) == turns or len(turns) < len(cells)


@pytest.mark.parametrize(
    ("cells", "turns"),
    [
        ([(0, 0), (1, 1), (2, 2), (2, 3), (2, 4)], [(0, 0), (2, 2), (2, 4)]),
        ([(0, 0), (0, 1), (0, 0)], [(0, 0), (0, 1), (0, 0)]),
    ],
)
def test_only_ends_and_turns_remain(cells: list[Cell], turns: list[Cell]) -> None:
    assert ends_and_turns(cells) == tuple(turns)


@QUICK
@given(
    start=st.tuples(st.integers(3, 4), st.integers(3, 4)),
    direction=st.sampled_from(STEPS),
    n_steps=st.integers(1, 2),
    turn=st.sampled_from(STEPS),
    inside=st.tuples(st.floats(0.001, 0.999), st.floats(0.001, 0.999)),
)
def test_a_vehicle_under_way_never_leaves_the_cells_of_its_route(
    start: Cell, direction: Cell, n_steps: int, turn: Cell, inside: tuple[float, float]
) -> None:
    cells = walk(start, [direction] * n_steps + [turn])
    position = at((start[1] + inside[0]) * 50.0, (start[0] + inside[1]) * 50.0)
    plan = flight_plan(GRID, cells, altitude_m=30.0, landing_lat_lon=HOME, position=position)
    points = [position, *((p.lat_deg, p.lon_deg) for p in plan.track)]
    local = np.array([GRID.frame.to_local(*point) for point in points]) / 50.0
    for here, there in itertools.pairwise(local):
        for share in np.linspace(0.0, 1.0, 101):
            east, north = here + share * (there - here)
            outside = min(
                max(abs(east - col - 0.5) - 0.5, abs(north - row - 0.5) - 0.5, 0.0) for row, col in cells
            )
            assert outside <= 0.02 + 1e-6  # a corner may be cut by a fiftieth of a cell


@pytest.mark.parametrize(
    ("cells", "east_m", "north_m", "track"),
    [
        ([(2, 2), (2, 3), (2, 4)], 140.0, 120.0, [(2, 4)]),  # straight on: not back to the centre
        ([(2, 2), (3, 3), (4, 4)], 140.0, 110.0, [(2, 2), (4, 4)]),  # would fly over (2, 3)
        ([(2, 2), (3, 3), (4, 4)], 140.0, 140.0, [(4, 4)]),  # on the diagonal already
        ([(2, 2), (3, 3), (4, 4)], 140.3, 139.7, [(4, 4)]),  # as good as on it
        ([(2, 2), (1, 1), (0, 0)], 110.0, 110.0, [(0, 0)]),
        ([(2, 2), (3, 1)], 110.0, 141.0, [(3, 1)]),
        ([(2, 2), (2, 3), (3, 4)], 101.0, 149.0, [(2, 3), (3, 4)]),
        ([(2, 2)], 140.0, 110.0, [(2, 2)]),
        ([(2, 0), (2, 1)], -200.0, 120.0, [(2, 0), (2, 1)]),  # not in the area yet: to the entry cell first
        ([(2, 2), (2, 3)], 190.0, 120.0, [(2, 2), (2, 3)]),  # in another cell than the route begins in
    ],
)
def test_the_first_centre_is_flown_over_or_skipped(
    cells: list[Cell], east_m: float, north_m: float, track: list[Cell]
) -> None:
    plan = flight_plan(GRID, cells, altitude_m=30.0, landing_lat_lon=HOME, position=at(east_m, north_m))
    assert tracks(plan) == track


def test_a_plan_has_the_centres_of_the_turns_and_the_given_landing_spot() -> None:
    plan = flight_plan(GRID, [(0, 0), (0, 1), (0, 2), (1, 3)], altitude_m=30.0, landing_lat_lon=HOME)
    assert tracks(plan) == [(0, 0), (0, 2), (1, 3)]
    assert plan.takeoff_alt_m == 30.0
    assert plan.landing == Waypoint(*HOME, 30.0)
    assert plan.track[0] == Waypoint(*GRID.centre((0, 0)), 30.0)


def test_a_route_without_cells_is_refused() -> None:
    with pytest.raises(ValueError, match="cell"):
        flight_plan(GRID, [], altitude_m=30.0, landing_lat_lon=HOME)


@pytest.mark.parametrize("cell_size_m", [2.0, 50.0])
@pytest.mark.parametrize("count", [1, 4, 5, 100])
def test_vehicles_that_share_a_goal_land_apart_and_inside_it(count: int, cell_size_m: float) -> None:
    grid = Grid(4, 4, cell_size_m, 47.4, 8.5)
    spots = [landing_spot(grid, (1, 2), index, count, 10.0) for index in range(count)]
    assert {grid.cell_at(*spot) for spot in spots} == {(1, 2)}
    apart = [distance_m(a, b) for a, b in itertools.combinations(spots, 2)]
    side = next(n for n in range(1, 20) if n * n >= count)
    assert min(apart, default=12.0) >= min(12.0, cell_size_m / side) - 1e-3
    assert min(apart, default=12.0) <= 12.0 + 1e-3


def test_landing_spots_are_as_far_apart_as_a_wide_separation() -> None:
    spots = [landing_spot(Grid(4, 4, 50.0, 47.4, 8.5), (1, 2), index, 6, 15.0) for index in range(6)]
    assert min(distance_m(a, b) for a, b in itertools.combinations(spots, 2)) >= 15.0


def test_a_single_vehicle_lands_at_the_centre() -> None:
    assert distance_m(landing_spot(GRID, (3, 3), 0, 1, 10.0), GRID.centre((3, 3))) < 1e-3


@pytest.mark.parametrize(("index", "count"), [(1, 1), (-1, 3), (0, 0)])
def test_an_invalid_landing_index_is_refused(index: int, count: int) -> None:
    with pytest.raises(ValueError, match=f"{index} of {count}"):
        landing_spot(GRID, (3, 3), index, count, 10.0)


@given(
    east=st.floats(0.001, 0.999),
    north=st.floats(0.001, 0.999),
    step=st.sampled_from([(1, 1), (1, -1), (-1, 1), (-1, -1)]),
)
@settings(max_examples=examples(100), deadline=None, derandomize=True)
def test_a_cut_corner_enters_only_the_permitted_cell(east: float, north: float, step: Cell) -> None:
    here, there = (3, 3), (3 + step[0], 3 + step[1])
    position = at((3 + east) * GRID.cell_size_m, (3 + north) * GRID.cell_size_m)
    asked: list[Cell] = []

    def allow(cell: Cell) -> bool:
        asked.append(cell)
        return True

    plan = flight_plan(
        GRID, [here, there], altitude_m=30.0, landing_lat_lon=HOME, position=position, may_cross=allow
    )
    assert tracks(plan) == [there]
    target = GRID.centre(there)
    on_the_way = {
        GRID.cell_at(
            position[0] + (target[0] - position[0]) * k / 200,
            position[1] + (target[1] - position[1]) * k / 200,
        )
        for k in range(201)
    }
    if asked:
        assert on_the_way <= {here, there, asked[0]}
