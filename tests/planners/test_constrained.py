"""The least exposed route within a bound, compared with all routes."""

from itertools import pairwise

import numpy as np
import pytest
from brute_force import all_points, front_of, small_problems, three_arms
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples, full_only

from swarmctl.core.records import replace
from swarmctl.planners import BadProblem, Problem, constrained, time_bound
from swarmctl.planners.constrained import Params

EXACT = Params(max_labels=0)


@settings(max_examples=examples(300), deadline=None, derandomize=True)
@given(problem=small_problems(), share=st.floats(0.0, 1.1), on_a_route=st.booleans())
def test_a_route_has_the_least_exposure_within_the_bound_and_then_the_least_length(
    problem: Problem, share: float, on_a_route: bool
) -> None:
    points = all_points(problem)
    if not points:
        return
    front = front_of(points)
    bound = front[0][0] + share * (front[-1][0] - front[0][0])
    if on_a_route:
        bound = min((length for length, _ in front), key=lambda length: abs(length - bound))
    problem = replace(problem, max_length_cells=bound)
    best = [point for point in front if point[0] <= bound + 1e-9][-1]
    found = constrained.plan(problem, EXACT)
    assert (found.length_cells, found.exposure_sum) == pytest.approx(best, abs=1e-9)
    assert found.lower_bound == found.cost == found.exposure_sum


def test_a_route_that_no_w_finds() -> None:
    bounded = replace(three_arms(), max_length_cells=3.5)
    found = constrained.plan(bounded, EXACT)
    assert (found.length_cells, found.exposure_sum) == (3.0, 1.0)
    assert time_bound.plan(bounded, time_bound.Params()).exposure_sum == 2.0


def rough(seed: int) -> Problem:
    field = np.random.default_rng(seed).random((60, 60)) * 0.3
    return Problem(field, (30, 0), ((30, 59),), 0.5, 0.15)


@pytest.mark.parametrize("bound", [65.0, *full_only(63.0, 68.0)])
def test_the_lower_bound_grows_with_the_budget_up_to_the_cost(bound: float) -> None:
    gains = []
    for seed in range(8):
        bounded = replace(rough(seed), max_length_cells=bound)
        steps = [constrained.plan(bounded, Params(n)) for n in (1, 30, 100, 300, 0)]
        best = steps[-1].cost
        for less, more in pairwise(steps):
            assert less.lower_bound is not None
            assert more.lower_bound is not None
            assert less.lower_bound <= more.lower_bound + 1e-12
            assert less.lower_bound <= best + 1e-12
            assert less.cost >= more.cost
        assert steps[-1].lower_bound == best
        gains.append(time_bound.plan(bounded, time_bound.Params()).exposure_sum - best)
    assert min(gains) >= 0.0
    assert max(gains) > 0.01  # exposure that a sweep of w does not save


def test_a_least_length_is_refused_with_the_name_of_a_planner_that_supports_it() -> None:
    with pytest.raises(BadProblem, match="time_bound"):
        constrained.plan(replace(rough(0), min_length_cells=3.0), EXACT)
