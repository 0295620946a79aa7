"""The whole front, compared with all routes, and on larger maps with an exchange between cells."""

import functools
import itertools
import math

import numpy as np
import pytest
from brute_force import Point, all_points, found_by_some_w, front_of, small_problems, three_arms
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples, full_only

from swarmctl.core.records import replace
from swarmctl.planners import (
    BoundTooTight,
    Front,
    Problem,
    Unreachable,
    constrained,
    dijkstra,
    pareto_front,
    time_bound,
)
from swarmctl.planners.kernels import LENGTH_TIE


def points_of(front: Front) -> list[Point]:
    return [(route.length_cells, route.exposure_sum) for route in front.routes]


def same(found: list[Point], expected: list[Point]) -> bool:
    return len(found) == len(expected) and all(
        a == pytest.approx(b, abs=1e-8) for a, b in zip(found, expected, strict=True)
    )


@settings(max_examples=examples(250), deadline=None, derandomize=True)
@given(small_problems())
def test_the_front_has_the_routes_that_no_other_route_dominates(problem: Problem) -> None:
    points = all_points(problem)
    if not points:
        with pytest.raises(Unreachable):
            pareto_front(problem)
        return
    front = pareto_front(problem)
    assert front.complete
    assert same(points_of(front), front_of(points))
    supported = [point for point, by_w in zip(points_of(front), front.supported, strict=True) if by_w]
    assert same(supported, found_by_some_w(points))


def rough(seed: int) -> Problem:
    field = np.random.default_rng(seed).random((40, 40)) * 0.3
    return Problem(field, (20, 0), ((20, 39),), 0.5, 0.15)


@functools.cache
def rough_front(seed: int) -> Front:
    return pareto_front(rough(seed))


@pytest.mark.parametrize("seed", [0, 1, *full_only(2, 3)])
def test_dijkstra_finds_each_point_for_every_w_of_its_range(seed: int) -> None:
    front = rough_front(seed)
    ranges = [
        (route, between) for route, between in zip(front.routes, front.w_ranges, strict=True) if between
    ]
    assert ranges[0][1][0] == 0.0
    assert ranges[-1][1][1] == 1.0
    for (_, left), (_, right) in itertools.pairwise(ranges):
        assert left[1] == right[0]
    for route, (low, high) in ranges:
        for w in (0.999 * low + 0.001 * high, 0.5 * (low + high), 0.001 * low + 0.999 * high):
            found = dijkstra.plan(replace(rough(seed), w=w), dijkstra.Params())
            assert (found.length_cells, found.exposure_sum) == pytest.approx(
                (route.length_cells, route.exposure_sum), abs=1e-9
            )
    assert [between is not None for between in front.w_ranges] == list(front.supported)


@pytest.mark.parametrize("seed", [0, *full_only(1, 2)])
def test_no_planner_is_better_than_the_front_and_routes_within_a_bound_lie_on_it(seed: int) -> None:
    points = points_of(rough_front(seed))
    for w in np.linspace(0.0, 1.0, 21).tolist():
        found = dijkstra.plan(replace(rough(seed), w=w), dijkstra.Params())
        assert any(
            length <= found.length_cells + 1e-9 and total <= found.exposure_sum + 1e-9
            for length, total in points
        )
    for bound in np.linspace(39.0, points[-1][0] + 1.0, 15).tolist():
        bounded = replace(rough(seed), max_length_cells=bound)
        for found in (
            constrained.plan(bounded, constrained.Params()),
            time_bound.plan(bounded, time_bound.Params("exposure")),
            time_bound.plan(bounded, time_bound.Params("distance")),
        ):
            here = (found.length_cells, found.exposure_sum)
            assert any(here == pytest.approx(point, abs=1e-9) for point in points)


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(seed=st.integers(0, 3), ends=st.tuples(st.floats(35.0, 70.0), st.floats(39.0, 70.0)))
def test_the_front_within_bounds_is_the_part_between_them(seed: int, ends: tuple[float, float]) -> None:
    least, greatest = min(ends), max(ends)
    whole = rough_front(seed)
    inside = [
        (route, by_w, between)
        for route, by_w, between in zip(whole.routes, whole.supported, whole.w_ranges, strict=True)
        if least - LENGTH_TIE <= route.length_cells <= greatest + LENGTH_TIE
    ]
    bounded = replace(rough(seed), min_length_cells=least, max_length_cells=greatest)
    if not inside:
        with pytest.raises(BoundTooTight):
            pareto_front(bounded)
        return
    part = pareto_front(bounded)
    assert same(points_of(part), [(route.length_cells, route.exposure_sum) for route, _, _ in inside])
    assert part.supported == tuple(by_w for _, by_w, _ in inside)
    assert part.w_ranges == tuple(between for _, _, between in inside)


def test_a_route_on_an_edge_of_the_hull_has_no_range_of_w() -> None:
    front = pareto_front(three_arms())
    assert points_of(front) == [(2.0, 2.0), (3.0, 1.0), (4.0, 0.0)]
    assert front.supported == (True, False, True)
    assert front.w_ranges == ((0.0, 0.5), None, (0.5, 1.0))


def test_a_front_without_weight_of_length_has_ranges_of_w_only_at_its_ends() -> None:
    front = pareto_front(replace(rough(0), psi_per_cell=0.0))
    assert points_of(front) == points_of(pareto_front(rough(0)))
    assert front.w_ranges[0] == (0.0, 0.0)
    assert front.w_ranges[-1] == (0.0, 1.0)
    assert not any(front.w_ranges[1:-1])


def test_a_spent_label_budget_keeps_all_supported_points_and_only_points_of_the_front() -> None:
    field = np.random.default_rng(5).random((80, 80)) * 0.3
    problem = Problem(field, (0, 0), ((79, 79),), 0.5, 0.15)
    whole = pareto_front(problem, max_labels=0)
    sizes = set()
    for max_labels in (1, 13_000, 16_000):
        part = pareto_front(problem, max_labels=max_labels)
        assert not part.complete
        assert set(points_of(part)) <= set(points_of(whole))
        assert sum(part.supported) == sum(whole.supported)
        sizes.add(len(part.routes))
    assert len(sizes) == 3
    assert whole.complete


@pytest.mark.parametrize(
    ("window", "nearest"), [((0.0, 38.0), 39.0), ((39.1, 39.2), 39.0), ((900.0, math.inf), None)]
)
def test_bounds_without_a_point_are_an_error_with_the_nearest_route(
    window: tuple[float, float], nearest: float | None
) -> None:
    bounded = replace(rough(0), min_length_cells=window[0], max_length_cells=window[1])
    with pytest.raises(BoundTooTight) as caught:
        pareto_front(bounded)
    longest = rough_front(0).routes[-1].length_cells
    assert caught.value.nearest.length_cells == (nearest or longest)


def test_the_front_of_a_start_at_the_goal_is_one_point() -> None:
    front = pareto_front(Problem(np.ones((2, 2)), (1, 1), ((1, 1),), 0.5, 0.1))
    assert points_of(front) == [(0.0, 0.0)]
    assert (front.supported, front.w_ranges, front.complete) == ((True,), ((0.0, 1.0),), True)
