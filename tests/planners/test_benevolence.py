"""The gain of cells for other vehicles against the exact value of information, and Eq. 5 with gains."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import BadProblem, Problem, cost_to_go, plan
from swarmctl.planners.benevolence import OtherVehicle, cell_gains, value_of_knowing

QUICK = settings(max_examples=examples(30), deadline=None, derandomize=True)
FIRING = FiringStrength(0.6, 0.3, 0.1)
W, PSI = 0.5, 0.15


def route_cost(belief: Belief, other: OtherVehicle) -> float:
    p_s = exposure(belief.occupancy(), FIRING)
    return float(cost_to_go(p_s, other.goals, W, PSI).cost[other.cell])


def exact_value(belief: Belief, other: OtherVehicle, cell: Cell) -> float:
    """Return the value of knowing a cell by planning again for both outcomes."""
    p = float(belief.occupancy()[cell])
    after = 0.0
    for occupied, chance in ((True, p), (False, 1.0 - p)):
        looked = Observation(9, 1, 0.0, ((*cell, occupied),))
        after += chance * route_cost(belief.merge([looked]), other)
    return route_cost(belief, other) - after


def values(belief: Belief, other: OtherVehicle) -> NDArray[np.float64]:
    p = belief.occupancy()
    return value_of_knowing(p, exposure(p, FIRING), FIRING, other, W, PSI)


@pytest.mark.parametrize(("n", "hostiles", "row", "to"), [(7, 4, 3, 3), (7, 4, 0, 6), (8, 5, 6, 2)])
def test_values_are_close_to_those_of_planning_again(n: int, hostiles: int, row: int, to: int) -> None:
    belief, other = Belief.prior(n, n, hostiles), OtherVehicle((row, 0), ((to, n - 1),))
    exact = np.array([[exact_value(belief, other, (r, c)) for c in range(n)] for r in range(n)])
    found = values(belief, other)
    assert np.corrcoef(exact.ravel(), found.ravel())[0, 1] > 0.98
    assert found.sum() == pytest.approx(exact.sum(), rel=0.2)


def test_the_value_of_the_only_doubtful_cell_is_exact() -> None:
    # A doubtful corridor along row 2 between walls, and safe ways around along rows 0 and 4.
    p, other = np.zeros((5, 7)), OtherVehicle((2, 0), ((2, 6),))
    p[2, 3] = 0.4

    def exposure_if(occupied: float) -> NDArray[np.float64]:
        p_s = exposure(np.where(p > 0.0, occupied, 0.0), FIRING)
        p_s[[1, 3], 1:6] = math.inf
        return p_s

    p_s = exposure_if(0.4)
    now, occupied, clear = (
        float(cost_to_go(exposure_if(q), other.goals, W, PSI).cost[2, 0]) for q in (0.4, 1.0, 0.0)
    )
    assert clear < now < occupied
    found = value_of_knowing(p, p_s, FIRING, other, W, PSI)
    assert found[2, 3] == pytest.approx(now - 0.4 * occupied - 0.6 * clear)
    assert found[2, 3] > 0.0
    assert np.count_nonzero(found) == 1
    gains = cell_gains(p, p_s, FIRING, [other, other], W, PSI)
    assert gains[1:4, 2:5] == pytest.approx(np.full((3, 3), 2.0 * found[2, 3] / 3.0))
    assert gains.sum() == pytest.approx(9.0 * 2.0 * found[2, 3] / 3.0)


@QUICK
@given(st.integers(0, 10_000), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_gains_are_never_negative_and_known_cells_have_no_value(seed: int, w: float, share: float) -> None:
    rng = np.random.default_rng(seed)
    p = np.where(rng.random((6, 7)) < share, (rng.random((6, 7)) < 0.2).astype(float), rng.random((6, 7)))
    p_s = exposure(p, FIRING)
    p_s[rng.random((6, 7)) < 0.1] = math.inf
    other = OtherVehicle((int(rng.integers(6)), 0), ((int(rng.integers(6)), 6), (0, 6)))
    value = value_of_knowing(p, p_s, FIRING, other, w, PSI)
    assert np.isfinite(value).all()
    assert (value >= 0.0).all()
    assert (value[(p == 0.0) | (p == 1.0)] == 0.0).all()


@QUICK
@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_a_route_with_gains_is_the_cheapest_of_all_and_reports_its_true_exposure(seed: int, w: float) -> None:
    rng = np.random.default_rng(seed)
    p_s, gain = rng.random((5, 6)), rng.random((5, 6)) * 0.4
    problem = Problem(p_s, (0, 0), ((4, 5),), w, 0.1, gain=gain)
    route, paper = plan(problem), plan(Problem(p_s, (0, 0), ((4, 5),), w, 0.1))

    def cost(cells: Any) -> float:  # Eq. 5 with the gains, edge by edge
        return math.fsum(
            (1.0 - w) * 0.1 * math.dist(a, b) + max(0.0, w * p_s[b] - gain[b]) for a, b in pairwise(cells)
        )

    assert route.cost == pytest.approx(cost(route.cells), abs=1e-12)
    assert route.cost <= cost(paper.cells) + 1e-12
    assert route.exposure_sum == pytest.approx(sum(p_s[cell] for cell in route.cells[1:]))
    assert plan(Problem(p_s, (0, 0), ((4, 5),), w, 0.1, gain=np.zeros((5, 6)))).cells == paper.cells


def test_a_gain_opens_no_wall_and_no_cell_above_the_maximum_exposure() -> None:
    p_s = np.full((3, 5), 0.1)
    p_s[0, 2], p_s[1, 2] = math.inf, 0.9
    gain = np.where(p_s > 0.5, 10.0, 0.0)
    route = plan(Problem(p_s, (0, 0), ((0, 4),), 0.9, 0.1, max_exposure=0.5, gain=gain))
    assert (2, 2) in route.cells


@pytest.mark.parametrize("gain", [np.zeros((2, 2)), np.full((3, 5), -0.1), np.full((3, 5), math.nan)])
def test_a_bad_gain_is_refused(gain: NDArray[np.float64]) -> None:
    with pytest.raises(BadProblem):
        Problem(np.zeros((3, 5)), (0, 0), ((2, 4),), 0.5, 0.1, gain=gain)
