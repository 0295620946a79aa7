"""Routes of the planner `window`: the least exposed within a window of lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from brute_force import all_routes
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.exposure import exposure_sum, length_cells
from swarmctl.planners import BoundTooTight, Problem, constrained, window

PARAMS = window.Params()


def problem(
    rows: int = 7, cols: int = 9, *, least: float = 0.0, most: float = math.inf, seed: int = 1
) -> Problem:
    exposure = np.random.default_rng(seed).random((rows, cols)) * 0.3
    middle = rows // 2
    return Problem(
        exposure, (middle, 0), ((middle, cols - 1),), 0.5, 0.1, min_length_cells=least, max_length_cells=most
    )


def test_a_window_without_a_least_length_gives_the_least_exposed_route_within_the_bound() -> None:
    asked = problem(most=10.0)
    found = window.plan(asked, PARAMS)
    assert found.cost == pytest.approx(constrained.plan(asked, constrained.Params()).cost)


@pytest.mark.parametrize("least", [12.0, 14.0, 18.0])
def test_a_route_longer_than_those_of_any_w_visits_no_cell_twice(least: float) -> None:
    asked = problem(least=least, most=least + 2.0)
    found = window.plan(asked, PARAMS)
    assert least <= length_cells(found.cells) <= least + 2.0
    assert len(set(found.cells)) == len(found.cells)
    assert found.cells[0] == asked.start
    assert found.cells[-1] in asked.goals
    assert found.cost == pytest.approx(exposure_sum(asked.exposure, found.cells))


def test_a_route_of_a_window_crosses_no_wall() -> None:
    asked = problem(least=12.0, most=16.0)
    walled = asked.exposure.copy()
    walled[2:6, 4] = math.inf
    asked = Problem(walled, asked.start, asked.goals, 0.5, 0.1, min_length_cells=12.0, max_length_cells=16.0)
    found = window.plan(asked, PARAMS)
    assert math.isfinite(window.measure(asked, found.cells, PARAMS))


def test_a_window_beyond_all_routes_is_an_error_with_the_longest_found_route() -> None:
    with pytest.raises(BoundTooTight) as caught:
        window.plan(problem(3, 3, least=30.0, most=40.0), PARAMS)
    assert 2.0 < length_cells(caught.value.nearest.cells) < 30.0


def test_the_measure_of_a_route_outside_the_window_is_infinite() -> None:
    asked = problem(least=12.0, most=16.0)
    short = constrained.plan(problem(), constrained.Params()).cells
    assert window.measure(asked, short, PARAMS) == math.inf


@settings(derandomize=True, deadline=None, max_examples=examples(30))
@given(seed=st.integers(0, 10_000), least=st.floats(2.0, 7.0))
def test_no_found_route_is_better_than_the_best_of_all_routes(seed: int, least: float) -> None:
    """The areas are so small that the test can enumerate every route."""
    asked = problem(3, 3, least=least, most=least + 1.5, seed=seed)
    every = all_routes((3, 3), asked.start, frozenset(asked.goals)).points(asked.exposure)
    fits = [exposed for length, exposed in every if least - 1e-9 <= length <= least + 1.5 + 1e-9]
    try:
        found = window.plan(asked, PARAMS)
    except BoundTooTight:
        return
    assert any(found.cost == pytest.approx(exposed) for exposed in fits)
    assert found.cost >= min(fits) - 1e-9
