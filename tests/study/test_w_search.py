"""Searches in w: never better than the exact answers, and equal to them where they look at every route."""

from __future__ import annotations

import numpy as np
import pytest

from swarmctl.core.exposure import exposure
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import BoundTooTight, Problem, pareto_front, plan
from swarmctl.study import w_search

FIRING = FiringStrength(0.6, 0.3, 0.1)


def problem(seed: int, longer: float) -> Problem:
    """Return a crossing of 12 × 12 cells among known and unknown hostiles, with a bound on its length."""
    rng = np.random.default_rng(seed)
    p_s = exposure(np.where(rng.random((12, 12)) < 0.2, 1.0, 0.05), FIRING)
    free = Problem(p_s, (6, 0), ((int(rng.integers(12)), 11),), 0.5, 0.13)
    return replace(free, max_length_cells=(1.0 + longer) * plan(replace(free, w=0.0)).length_cells)


@pytest.mark.parametrize("method", w_search.METHODS)
def test_a_search_in_w_keeps_the_bound_and_is_never_better_than_the_exact_answers(method: str) -> None:
    for seed in range(6):
        crossing = problem(seed, 0.15)
        found = w_search.search(crossing, method, 9, 0.1, np.random.default_rng(seed))
        assert 1 <= len(found.tried) <= 9
        assert found.best.length_cells <= crossing.max_length_cells
        assert found.best.exposure_sum >= plan(crossing, "time_bound").exposure_sum - 1e-9
        assert found.best.exposure_sum >= plan(crossing, "constrained").exposure_sum - 1e-9
        assert found.best.exposure_sum == min(
            route.exposure_sum
            for route in found.tried
            if route.length_cells <= crossing.max_length_cells + 1e-9
        )


def test_a_fine_grid_finds_the_best_route_of_all_w() -> None:
    for seed in range(3):
        crossing = problem(seed, 0.15)
        front = pareto_front(replace(crossing, max_length_cells=1e9))
        ranges = [r for r in front.w_ranges if r is not None and r[1] - r[0] > 0.0]
        searches = 2 + int(1.0 / min(high - low for low, high in ranges))
        found = w_search.search(crossing, "fixed_grid", searches, 0.1, np.random.default_rng(0))
        assert len(found.tried) == searches
        best = plan(crossing, "time_bound").exposure_sum
        assert found.best.exposure_sum == pytest.approx(best, rel=1e-12)
        # Every route of the envelope is found, not only the best.
        seen = {round(route.exposure_sum, 9) for route in found.tried}
        corners = [route for route, is_corner in zip(front.routes, front.supported, strict=True) if is_corner]
        assert {round(route.exposure_sum, 9) for route in corners[1:]} <= seen


# The fitness over w of a method's proposals: a plateau, a hill beside a higher hill, a slope.
def proposals(method: str, fitness: dict[float, float], searches: int, step: float) -> list[float]:
    """Return the w that a method tries on a made-up fitness; the nearest w given counts."""
    asked = w_search.METHODS[method](searches, step, np.random.default_rng(2))
    tried: list[float] = []
    w = next(asked, None)
    while w is not None and len(tried) < searches:
        tried.append(w)
        try:
            w = asked.send(fitness[min(fitness, key=lambda known: abs(known - tried[-1]))])
        except StopIteration:
            w = None
    return tried


def test_hill_climbing_compares_both_neighbours_and_stops_on_the_first_hill() -> None:
    two_hills = {0.0: 9.0, 0.25: 0.0, 0.5: 1.0, 0.75: 2.0, 1.0: 1.5}
    assert proposals("hill_climbing", two_hills, 20, 0.25) == [0.5, 0.25, 0.75, 1.0]
    assert proposals("hill_climbing", {0.5: 1.0}, 20, 0.25) == [0.5, 0.25, 0.75]  # a plateau


def test_iterated_climbs_find_the_higher_hill() -> None:
    two_hills = {k / 20: 9.0 - k if k < 8 else float(k) / 10 for k in range(21)}
    assert 0.0 <= min(proposals("iterated_hill_climbing", two_hills, 60, 0.05)) < 0.05


def test_annealing_leaves_a_hill_that_stochastic_climbing_does_not_leave() -> None:
    """Stochastic climbing stays within a step of its best w; annealing, while hot, goes beyond."""
    valley = {k / 100: abs(k - 40) / 1000 for k in range(101)}
    spread = {
        method: float(np.ptp(proposals(method, valley, 80, 0.05)[1:]))
        for method in ("stochastic_hill_climbing", "simulated_annealing")
    }
    assert spread["simulated_annealing"] > 0.0
    climbed = proposals("stochastic_hill_climbing", valley, 80, 0.05)
    height = [valley[round(w, 2)] for w in climbed]
    assert max(height[-20:]) - min(height[-20:]) <= 0.05 + 0.02


def test_a_bound_below_the_shortest_route_is_refused() -> None:
    with pytest.raises(BoundTooTight):
        w_search.search(problem(0, -0.1), "fixed_grid", 5, 0.1, np.random.default_rng(0))
