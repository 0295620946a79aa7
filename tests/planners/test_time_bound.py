"""Figure 7, compared with all routes, and with `dijkstra` at the searched values of w."""

import math

import numpy as np
import pytest
from brute_force import all_points, found_by_some_w, small_problems
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

from swarmctl.core.exposure import exposure
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import BoundTooTight, Problem, dijkstra, time_bound
from swarmctl.planners.time_bound import Params

LEAST_EXPOSED, LEAST_DISTANT = Params("exposure"), Params("distance")


def misses_by(problem: Problem, length: float) -> float:
    return max(problem.min_length_cells - length, length - problem.max_length_cells, 0.0)


@settings(max_examples=examples(250), deadline=None, derandomize=True)
@given(
    problem=small_problems(),
    ends=st.tuples(st.floats(-0.2, 1.3), st.floats(-0.2, 1.3)),
    on_a_route=st.booleans(),
    params=st.sampled_from([LEAST_EXPOSED, LEAST_DISTANT]),
)
def test_the_route_is_the_best_of_all_w_that_keep_the_window(
    problem: Problem, ends: tuple[float, float], on_a_route: bool, params: Params
) -> None:
    points = all_points(problem)
    if not points:
        return
    routes = found_by_some_w(points)
    shortest, longest = routes[0][0], routes[-1][0]
    window = [max(shortest + share * (longest - shortest), 0.0) for share in ends]
    if on_a_route:
        window = [min((length for length, _ in routes), key=lambda x: abs(x - end)) for end in window]
    problem = replace(problem, min_length_cells=min(window), max_length_cells=max(window))
    keep = [(length, total) for length, total in routes if misses_by(problem, length) <= 1e-8]
    if not keep:
        with pytest.raises(BoundTooTight) as caught:
            time_bound.plan(problem, params)
        nearest = misses_by(problem, caught.value.nearest.length_cells)
        assert nearest == pytest.approx(min(misses_by(problem, length) for length, _ in routes), abs=1e-8)
        return
    best = keep[-1] if params is LEAST_EXPOSED else keep[0]
    found = time_bound.plan(problem, params)
    assert (found.length_cells, found.exposure_sum) == pytest.approx(best, abs=1e-9)
    assert found.cost == (found.exposure_sum if params is LEAST_EXPOSED else found.length_cells)


def terrain(seed: int, side: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    if seed % 2:
        return rng.random((side, side)) * 0.3
    seen = rng.random((side, side)) < 0.7
    occupied = np.where(seen, rng.random((side, side)) < 0.06, 0.06)
    return exposure(occupied, FiringStrength(0.6, 0.3, 0.1))


@pytest.mark.parametrize("seed", range(6))
def test_every_search_is_a_route_of_dijkstras_and_few_are_needed(seed: int) -> None:
    field = terrain(seed, 200)
    free = Problem(field, (100, 0), ((100, 199),), 0.5, 0.132)
    safest = dijkstra.plan(replace(free, w=1.0), dijkstra.Params())
    for share in (0.05, 0.5, 0.95):
        bound = 199.0 + share * (safest.length_cells - 199.0)
        found = time_bound.plan(replace(free, max_length_cells=bound), LEAST_EXPOSED)
        assert found.length_cells <= bound
        assert len(found.searched) <= 15
        best = min(s.exposure_sum for s in found.searched if s.length_cells <= bound)
        assert found.exposure_sum == best
        for searched in found.searched[1:4]:
            route = dijkstra.plan(replace(free, w=searched.w), dijkstra.Params())
            assert route.length_cells == pytest.approx(searched.length_cells)
            assert route.exposure_sum == pytest.approx(searched.exposure_sum)


@pytest.mark.parametrize(("window", "nearest"), [((2.2, 2.5), 2.0), ((2.2, 2.8), 2.83)])
@pytest.mark.parametrize("params", [LEAST_EXPOSED, LEAST_DISTANT])
def test_bounds_without_a_route_are_an_error_with_the_nearest_route(
    window: tuple[float, float], nearest: float, params: Params
) -> None:
    """There are two routes: of 2 cells, and of 2√2 cells."""
    field = np.array([[9.0, 0.0, 9.0], [0.0, 1.0, 0.0]])
    least, most = window
    problem = Problem(field, (1, 0), ((1, 2),), 0.5, 1.0, min_length_cells=least, max_length_cells=most)
    with pytest.raises(BoundTooTight) as caught:
        time_bound.plan(problem, params)
    assert caught.value.nearest.length_cells == pytest.approx(nearest, abs=0.005)
    assert caught.value.nearest.searched
    assert time_bound.measure(problem, caught.value.nearest.cells, params) == math.inf


def test_a_least_length_is_refused_for_a_start_at_the_goal() -> None:
    problem = Problem(np.zeros((2, 2)), (0, 0), ((0, 0),), 0.5, 1.0, min_length_cells=3.0)
    with pytest.raises(BoundTooTight) as caught:
        time_bound.plan(problem, LEAST_EXPOSED)
    assert caught.value.nearest.cells == ((0, 0),)
