"""Occupancy from looks: Eq. 4, its generalisation compared with enumeration, and Eq. 4 as its limit."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

from swarmctl.core.belief import Belief, LookCounts, ObservationLog
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.occupancy import CellClasses, bayes, eq4
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import Observation

QUICK = settings(max_examples=examples(60), deadline=None, derandomize=True)
ROWS, COLS = 2, 4
ERRING = SensorModel(0.1, 0.02)


def enumerated(belief: Belief) -> NDArray[np.float64]:
    """Return p_O by enumeration of all sets of cells that may hold the hostiles."""
    looks, hits = belief.looks.ravel().tolist(), belief.hits.ravel().tolist()
    miss, alarm = belief.sensor.p_miss, belief.sensor.p_false_alarm
    n_cells = len(looks)
    p, weight = np.zeros(n_cells), 0.0
    for n, p_n in zip(belief.count.n.tolist(), belief.count.pmf.tolist(), strict=True):
        for held in combinations(range(n_cells), n):
            chance = p_n / math.comb(n_cells, n)
            for i in range(n_cells):
                hit = 1.0 - miss if i in held else alarm
                chance *= hit ** hits[i] * (1.0 - hit) ** (looks[i] - hits[i])
            weight += chance
            p[list(held)] += chance
    return (p / weight).reshape(belief.looks.shape)


cells = st.tuples(st.integers(0, ROWS - 1), st.integers(0, COLS - 1), st.booleans())
looked = st.lists(st.lists(cells, max_size=6).map(tuple), max_size=6).map(
    lambda several: [Observation(1 + i % 2, 1 + i, float(i), c) for i, c in enumerate(several)]
)
rates = st.tuples(st.floats(0.01, 0.6), st.floats(0.01, 0.35)).map(lambda r: SensorModel(*r))
counts = st.one_of(
    st.integers(0, ROWS * COLS).map(HostileCount.known),
    st.floats(0.1, 6.0).map(lambda mean: HostileCount.poisson(mean, ROWS * COLS)),
    st.floats(0.01, 0.99).map(lambda p: HostileCount.binomial(ROWS * COLS, p)),
    st.tuples(st.integers(0, 4), st.integers(4, 8)).map(lambda ends: HostileCount.uniform(*ends)),
    st.dictionaries(st.integers(0, 8), st.floats(0.01, 9.0), min_size=1, max_size=4).map(
        HostileCount.weighted
    ),
)


@QUICK
@given(looked, rates, counts)
def test_occupancy_equals_enumeration_of_all_placements(observations, sensor, count) -> None:
    belief = Belief.prior(ROWS, COLS, count, sensor).merge(observations)
    np.testing.assert_allclose(belief.occupancy(), enumerated(belief), rtol=1e-11, atol=1e-14)


def test_occupancy_on_twenty_by_twenty_cells_equals_integer_arithmetic() -> None:
    # (looks, hits): cells; a hit has a probability of 90 % (occupied) and 2 % (clear), a miss of 10 % and 98
    # %
    groups = {(0, 0): 250, (1, 0): 90, (2, 0): 40, (1, 1): 9, (2, 1): 5, (3, 3): 4, (4, 1): 2}
    n = 24

    def coefficients(cells: dict[tuple[int, int], int]) -> list[int]:
        of = [1] + [0] * n
        for (looks, hits), m in cells.items():
            held, clear = 90**hits * 10 ** (looks - hits), 2**hits * 98 ** (looks - hits)
            for _ in range(m):
                of = [clear * of[k] + (held * of[k - 1] if k else 0) for k in range(n + 1)]
        return of

    expected = []
    for looks, hits in groups:
        held = 90**hits * 10 ** (looks - hits)
        without = coefficients({**groups, (looks, hits): groups[looks, hits] - 1})[n - 1]
        expected.append(float(Fraction(held * without, coefficients(groups)[n])))
    looks, hits = np.array(list(groups)).T
    p = bayes(HostileCount.known(n), ERRING, CellClasses(looks, hits, np.array(list(groups.values()))))
    np.testing.assert_allclose(p, expected, rtol=1e-12)


@pytest.mark.parametrize("sensor", [SensorModel(0.0, 0.1), SensorModel(0.2, 0.0)], ids=str)
@pytest.mark.parametrize("count", [HostileCount.known(3), HostileCount.uniform(1, 5)], ids=["3", "1 to 5"])
def test_a_sensor_that_errs_one_way_settles_a_cell_the_other_way(
    sensor: SensorModel, count: HostileCount
) -> None:
    hit, clear = (
        Observation(1, 1, 0.0, ((0, 0, True), (0, 1, True))),
        Observation(1, 2, 0.0, ((0, 2, False),)),
    )
    belief = Belief.prior(ROWS, COLS, count, sensor).merge([hit, clear])
    p = belief.occupancy()
    np.testing.assert_allclose(p, enumerated(belief), rtol=1e-11, atol=1e-14)
    assert bool(p[0, 0] == 1.0) == (sensor.p_false_alarm == 0.0)
    assert bool(p[0, 2] == 0.0) == (sensor.p_miss == 0.0)


@QUICK
@given(looked, rates, counts, st.randoms(use_true_random=False))
def test_occupancy_depends_on_the_set_of_observations_alone(observations, sensor, count, random) -> None:
    at_once = Belief.prior(ROWS, COLS, count, sensor).merge(observations)
    shuffled = observations * 2
    random.shuffle(shuffled)
    one_by_one = Belief.prior(ROWS, COLS, count, sensor)
    for observation in shuffled:
        one_by_one = one_by_one.merge([observation])
    assert one_by_one.occupancy().tobytes() == at_once.occupancy().tobytes()
    assert one_by_one.known.tobytes() == at_once.known.tobytes()
    assert one_by_one.announced_too_low == at_once.announced_too_low


@QUICK
@given(st.integers(0, 400), st.lists(st.integers(0, 200), min_size=2, max_size=2))
def test_eq_4_is_the_limit_for_a_perfect_sensor_and_a_known_number(n_hostiles: int, split: list[int]) -> None:
    # no misses, no false alarms, and a prior over n_HA that has shrunk to a number
    n_clear, n_held = split
    parts = [((0, 0), 401 - n_clear - n_held), ((1, 0), n_clear), ((1, 1), n_held)]
    kept = [(looks, hits, n) for (looks, hits), n in parts if n]
    classes = CellClasses(*(np.array(column, dtype=np.int64) for column in zip(*kept, strict=True)))
    point = HostileCount.weighted({n_hostiles: 0.3})
    np.testing.assert_allclose(bayes(point, PERFECT, classes), eq4(n_hostiles, classes), rtol=1e-12, atol=0.0)


def test_an_unknown_number_with_the_perfect_sensor() -> None:
    # Eq. 4 averaged over the number: a hostile found among few cells makes more of them likelier.
    count = HostileCount.weighted({1: 1.0, 4: 1.0})
    belief = Belief.prior(1, 5, count).merge([Observation(1, 1, 0.0, ((0, 0, True),))])
    # P(found | 1) = 1/5, P(found | 4) = 4/5; then 0 or 3 are left in 4 cells
    np.testing.assert_allclose(belief.occupancy()[0], [1.0] + [0.8 * 3 / 4] * 4, rtol=1e-12)


@pytest.mark.parametrize("p_cell", [1e-4, 0.06, 0.5, 0.97])
def test_on_large_areas_independent_cells_stay_independent(p_cell: float) -> None:
    # Each cell is occupied with probability p, independently: no cell informs another.
    looks, hits = np.array([0, 1, 1, 3, 5, 8]), np.array([0, 0, 1, 1, 3, 0])
    classes = CellClasses(looks, hits, np.array([30_000, 6000, 2000, 1500, 450, 50]))
    odds = p_cell / (1.0 - p_cell) * 45.0**hits * (5.0 / 49.0) ** (looks - hits)
    p = bayes(HostileCount.binomial(40_000, p_cell), ERRING, classes)
    np.testing.assert_allclose(p, odds / (1.0 + odds), rtol=1e-9)


LARGE = [
    ("200 × 200", 200, 2400, HostileCount.known(2400)),
    ("200 × 200, Poisson", 200, 2400, HostileCount.poisson(2400.0, 40_000)),
    (
        "200 × 200, two guesses far apart",
        200,
        2400,
        HostileCount.weighted({0: 1.0, 50: 1.0, 2400: 1.0, 9000: 1.0}),
    ),
]


@pytest.mark.parametrize(
    ("size", "n_true", "count"), [row[1:] for row in LARGE], ids=[row[0] for row in LARGE]
)
def test_occupancy_on_large_areas_adds_up_and_is_calibrated(
    size: int, n_true: int, count: HostileCount
) -> None:
    rng = np.random.default_rng(size)
    truth = np.zeros(size * size, dtype=bool)
    truth[rng.choice(size * size, n_true, replace=False)] = True
    looks = np.where(rng.random(size * size) < 0.3, rng.integers(1, 8, size * size), 0).astype(np.int32)
    hits = rng.binomial(looks, np.where(truth, 0.9, 0.02)).astype(np.int32)
    shape = (size, size)
    belief = Belief(
        count, ERRING, LookCounts(looks.reshape(shape), hits.reshape(shape)), 0, ObservationLog(), 0, {}
    )
    p = belief.occupancy().ravel()
    assert ((p >= 0.0) & (p <= 1.0)).all()
    if count.is_number:
        assert p.sum() == pytest.approx(n_true, rel=1e-12)
    # Of the cells with p_O in a band around p, a share of about p holds a hostile.
    for low, high in ((0.0, 0.01), (0.01, 0.5), (0.5, 1.0)):
        band = (p >= low) & (p < high)
        sigma = math.sqrt(float((p * (1.0 - p))[band].sum())) + 1e-9
        assert abs(float(truth[band].sum() - p[band].sum())) < 4.0 * sigma + 1e-6


def test_thousands_of_looks_give_valid_probabilities() -> None:
    looks, hits = np.array([[2000, 2000, 1000, 0]], np.int32), np.array([[0, 2000, 500, 0]], np.int32)
    for count in (HostileCount.known(2), HostileCount.uniform(0, 4)):
        p = Belief(count, ERRING, LookCounts(looks, hits), 0, ObservationLog(), 0, {}).occupancy()
        # half of a thousand looks hit: that many false alarms are far less likely than that many misses
        np.testing.assert_allclose(p[0, :3], [0.0, 1.0, 1.0], atol=1e-12)
    p = Belief(HostileCount.known(2), ERRING, LookCounts(looks, hits), 0, ObservationLog(), 0, {}).occupancy()
    assert p[0, 3] == pytest.approx(0.0, abs=1e-12)


FOUND_TOO_MANY = [
    ("a prior that ends below", HostileCount.uniform(0, 2), PERFECT, 1, True),
    ("a prior that ends above", HostileCount.uniform(0, 3), PERFECT, 1, False),
    ("no false alarms", HostileCount.known(2), SensorModel(0.1, 0.0), 1, True),
    ("one doubtful look", HostileCount.known(2), ERRING, 1, False),
    ("many looks", HostileCount.known(2), ERRING, 4, True),
    ("none announced", HostileCount.known(0), ERRING, 4, True),
]


@pytest.mark.parametrize(
    ("count", "sensor", "n_looks", "too_low"),
    [row[1:] for row in FOUND_TOO_MANY],
    ids=[r[0] for r in FOUND_TOO_MANY],
)
def test_more_hostiles_than_announced_keep_probabilities_valid(
    count: HostileCount, sensor: SensorModel, n_looks: int, too_low: bool
) -> None:
    seen = tuple((0, col, True) for col in range(3))
    belief = Belief.prior(20, 20, count, sensor).merge(
        [Observation(1, 1 + seq, 0.0, seen) for seq in range(n_looks)]
    )
    assert belief.announced_too_low is too_low
    p = belief.occupancy()
    assert ((p >= 0.0) & (p <= 1.0)).all()


def test_all_cells_are_occupied_if_fewer_are_left_than_hostiles() -> None:
    clear = tuple((0, col, False) for col in range(4))
    for count in (HostileCount.known(2), HostileCount.weighted({2: 1.0, 3: 1.0})):
        belief = Belief.prior(1, 5, count, PERFECT).merge([Observation(1, 1, 0.0, clear)])
        assert belief.occupancy()[0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0]


def test_an_observation_is_informative_until_its_cell_is_certain() -> None:
    cells = ((0, 0, True), (0, 1, False), (0, 2, True))
    before = [Observation(1, 1, 0.0, ((0, 0, True), (0, 1, False)))]
    expected = {
        PERFECT: cells[2:],
        ERRING: cells,
        SensorModel(0.1, 0.0): cells[1:],
        SensorModel(0.0, 0.1): (cells[0], cells[2]),
    }
    for sensor, left in expected.items():
        assert Belief.prior(3, 3, 2, sensor).merge(before).uncertain(cells) == left


@pytest.mark.parametrize("rates", [(0.5, 0.5), (1.0, 0.0), (-0.1, 0.1), (0.1, -0.1), (float("nan"), 0.0)])
def test_a_sensor_without_information_is_refused(rates: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=f"{rates[0]} .*{rates[1]}"):
        SensorModel(*rates)


def test_priors_over_the_number_equal_the_distributions_of_their_names() -> None:
    poisson = HostileCount.poisson(3.0, 400)
    assert poisson.mean == pytest.approx(3.0, rel=1e-12)
    assert poisson.pmf[2] == pytest.approx(math.exp(-3.0) * 4.5, rel=1e-12)
    assert HostileCount.poisson(3.0, 4).n.tolist() == [0, 1, 2, 3, 4]
    binomial = HostileCount.binomial(10, 0.3)
    assert binomial.mean == pytest.approx(3.0, rel=1e-12)
    assert binomial.pmf[4] == pytest.approx(math.comb(10, 4) * 0.3**4 * 0.7**6, rel=1e-12)
    assert HostileCount.uniform(2, 6).mean == pytest.approx(4.0)
    weighted = HostileCount.weighted({5: 2.0, 1: 2.0, 9: 0.0})
    assert (weighted.least, weighted.greatest, weighted.pmf.tolist()) == (1, 5, [0.5, 0.5])
    assert HostileCount.binomial(4, 1.0).n.tolist() == [4]
    rng = np.random.default_rng(1)
    assert {weighted.draw(rng) for _ in range(30)} == {1, 5}
