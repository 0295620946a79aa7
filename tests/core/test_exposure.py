import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure, exposure_sum, length_cells, prior_inner_exposure, safety_factor
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.threat import FiringStrength

STRENGTH = FiringStrength(0.6, 0.3, 0.1)
PRIOR = Belief.prior(20, 20, 24)


def test_eq_3_on_the_prior_of_the_model() -> None:
    p_s = exposure(PRIOR.occupancy(), STRENGTH)
    inner, edge, corner = p_s[1:-1, 1:-1], p_s[0, 1:-1], p_s[0, 0]
    np.testing.assert_allclose(inner, 0.132, rtol=1e-12)
    np.testing.assert_allclose(edge, 0.102, rtol=1e-12)
    assert corner == pytest.approx(0.078, rel=1e-12)


@pytest.mark.parametrize(
    ("cell", "p_s"),
    [
        ((10, 10), 0.6),
        ((10, 12), 0.1),
        ((0, 0), 0.076470588),
        ((5, 5), 0.129411765),
    ],
)
def test_eq_3_after_nine_cells_of_the_model(cell: Cell, p_s: float) -> None:
    around = tuple((r, c, (r, c) == (10, 10)) for r in (9, 10, 11) for c in (9, 10, 11))
    belief = PRIOR.merge([Observation(1, 1, 0.0, around)])
    assert exposure(belief.occupancy(), STRENGTH)[cell] == pytest.approx(p_s, abs=5e-10)


@settings(max_examples=examples(30), deadline=None, derandomize=True)
@given(st.integers(1, 6), st.integers(1, 6), st.data())
def test_exposure_is_the_sum_of_eq_1_over_all_hostiles(rows: int, cols: int, data: st.DataObject) -> None:
    all_cells = [(r, c) for r in range(rows) for c in range(cols)]
    hostiles = data.draw(st.sets(st.sampled_from(all_cells)))
    occupied = np.zeros((rows, cols))
    expected = np.zeros((rows, cols))
    for r, c in hostiles:
        occupied[r, c] = 1.0
        for i, j in all_cells:
            steps = abs(i - r) + abs(j - c)
            if max(abs(i - r), abs(j - c)) <= 1:
                expected[i, j] += (0.6, 0.3, 0.1)[steps]
    np.testing.assert_allclose(exposure(occupied, STRENGTH), expected, atol=1e-12)


def test_the_default_weight_of_distance_is_the_exposure_of_an_inner_cell() -> None:
    assert prior_inner_exposure(20, 20, 24, STRENGTH) == pytest.approx(0.132, rel=1e-12)


def test_measures_leave_the_start_out_and_count_the_goal() -> None:
    p_s = np.array([[0.9, 0.2, 0.5], [0.0, 0.0, 1.7]])
    assert exposure_sum(p_s, [(0, 0), (0, 1), (0, 2)]) == pytest.approx(0.7)
    assert safety_factor(p_s, [(0, 0), (0, 1), (0, 2)]) == pytest.approx(0.8 * 0.5)
    assert exposure_sum(p_s, [(0, 0)]) == 0.0
    assert safety_factor(p_s, [(0, 0)]) == 1.0
    assert safety_factor(p_s, [(0, 1), (1, 2)]) == 0.0  # clipped: nothing is worse than certain


def test_length_counts_a_diagonal_as_root_two() -> None:
    assert length_cells([(0, 0), (0, 1), (1, 2), (2, 2)]) == pytest.approx(2.0 + math.sqrt(2.0))
    assert length_cells([(3, 3)]) == 0.0
    for leap in [(0, 2), (0, 0), (2, 1), (2, 2)]:
        with pytest.raises(ValueError, match=rf"\(0, 0\) to \({leap[0]}, {leap[1]}\)"):
            length_cells([(0, 0), leap])


def test_the_sum_of_exposures_is_no_probability() -> None:
    # ERRATUM: the paper calls P_s a probability.
    p_s = exposure(np.ones((3, 3)), FiringStrength(0.9, 0.5, 0.3))
    assert p_s[1, 1] == pytest.approx(4.1)
