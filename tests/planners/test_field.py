"""Cost fields: every search finds the same field, and stored fields do not change later results."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

from swarmctl.core.exposure import exposure
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import Problem, dijkstra
from swarmctl.planners.dijkstra import Params, cost_to_go, plan

ROOT2 = math.sqrt(2.0)
KINDS = ("random", "belief", "mostly zero", "ridges", "maze", "soft walls")


def field_of(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float64]:
    if kind == "belief":
        occupied = np.where(rng.random(shape) < 0.3, rng.random(shape) < 0.1, 0.06)
        return exposure(occupied.astype(float), FiringStrength(0.6, 0.3, 0.1))
    values = rng.random(shape)
    if kind == "mostly zero":
        return np.where(rng.random(shape) < 0.2, values, 0.0)
    if kind == "ridges":  # long routes with many reversals
        values *= 0.01
        values[::4, :-1] = 5.0
        values[2::4, 1:] = 5.0
    if kind == "soft walls":
        return np.where(rng.random(shape) < 0.3, 10.0 ** rng.integers(1, 9), values)
    if kind == "maze":
        return np.where(rng.random(shape) < 0.35, math.inf, values)
    return values


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(25), deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), w=st.sampled_from([0.0, 0.5, 0.95, 1.0]))
def test_each_cost_is_the_least_that_a_neighbour_offers(kind: str, seed: int, w: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 40)), int(rng.integers(1, 40)))
    p_s = field_of(kind, shape, rng)
    goals = [(int(rng.integers(shape[0])), int(rng.integers(shape[1]))) for _ in range(2)]
    cost = cost_to_go(p_s, goals, w, 0.13).cost
    offered = best_offer(p_s, cost, w, 0.13)
    for goal in goals:
        assert cost[goal] == 0.0
        offered[goal] = 0.0
    np.testing.assert_allclose(cost, offered, rtol=1e-12, atol=1e-300)


def best_offer(
    p_s: NDArray[np.float64], cost: NDArray[np.float64], w: float, psi: float
) -> NDArray[np.float64]:
    """Return the right side of Bellman's equation, in NumPy over the whole area."""
    rows, cols = cost.shape
    wall = np.isinf(p_s)
    through = np.pad(np.where(wall, np.inf, cost + w * np.where(wall, 0.0, p_s)), 1, constant_values=np.inf)
    padded = np.pad(wall, 1, constant_values=False)
    offers = np.full(cost.shape, np.inf)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            if (dr, dc) != (0, 0):
                offer = through[1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols] + (1 - w) * psi * math.hypot(
                    dr, dc
                )
                beside = padded[1 + dr : 1 + dr + rows, 1:-1] | padded[1:-1, 1 + dc : 1 + dc + cols]
                closed = beside & ~wall if dr and dc else np.zeros_like(wall)
                offers = np.minimum(offers, np.where(closed, np.inf, offer))
    return offers


@pytest.mark.parametrize("large", [1, 10**9])
def test_an_exposure_changed_in_place_changes_the_field(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dijkstra, "LARGE_AREA_CELLS", large)
    p_s = np.full((5, 5), 0.1)
    problem = Problem(p_s, (2, 0), ((2, 4),), 0.9, 0.01)
    straight = plan(problem, Params())
    assert straight.cells == tuple((2, col) for col in range(5))
    p_s[2, 2] = 5.0
    assert (2, 2) not in plan(problem, Params()).cells
    p_s[2, 2] = 0.1
    assert plan(problem, Params()) == straight


@pytest.mark.parametrize("large", [1, 10**9])
def test_earlier_plans_do_not_change_a_field(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dijkstra, "LARGE_AREA_CELLS", large)
    monkeypatch.setattr(dijkstra, "MAX_KEPT_CELLS", 500)
    rng = np.random.default_rng(3)
    fields = [field_of(kind, (12, 17), rng) for kind in ("random", "belief", "random")]
    problems = [
        Problem(p_s, (start, 0), goals, w, 0.13)
        for p_s in fields
        for start in (0, 5, 11)
        for goals in (((4, 16),), ((0, 16), (11, 16)))
        for w in (0.0, 0.5)
    ]
    alone = [plan(problem, Params()) for problem in problems]
    for index in rng.permutation(np.repeat(np.arange(len(problems)), 3)):
        assert plan(problems[index], Params()) == alone[index]
