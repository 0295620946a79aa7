"""The survival probability, compared with exact values: sums over all placements."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest

from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure, exposure_sum, safety_factor
from swarmctl.core.grid import Cell
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.inference.survival import ProbabilityEstimate, survival_among, survival_probability
from swarmctl.core.observation import Observation
from swarmctl.core.threat import FiringStrength

STRENGTH = FiringStrength(0.6, 0.3, 0.1)
ERRING = SensorModel(0.1, 0.02)
STRAIGHT = [(10, col) for col in range(20)]
BENT = [(0, 0), (1, 1), (2, 1), (3, 2), (3, 3), (2, 3), (2, 2)]


def survival_of(hostile: Cell, route: list[Cell], strength: FiringStrength = STRENGTH) -> float:
    """Return the probability to survive one hostile, which shoots at each entry within its reach."""
    by_steps = {0: strength.direct, 1: strength.first_neighbour, 2: strength.second_neighbour}
    chance = 1.0
    for cell in route[1:]:
        d_row, d_col = abs(cell[0] - hostile[0]), abs(cell[1] - hostile[1])
        if max(d_row, d_col) <= 1:
            chance *= 1.0 - by_steps[d_row + d_col]
    return chance


def exact_survival(
    rows: int, cols: int, n: int, route: list[Cell], clear: set[Cell], held: set[Cell]
) -> float:
    """Return the survival among n hostiles, `held` and others in any cell not clear: e_k(g) / C(m, k)."""
    free = [(r, c) for r in range(rows) for c in range(cols) if (r, c) not in clear | held]
    left = n - len(held)
    mean = np.zeros(left + 1)
    mean[0] = 1.0  # mean[k] = e_k / C(i, k) of the first i cells
    for i, cell in enumerate(free, 1):
        k = np.arange(1, left + 1)
        mean[1:] = np.where(k < i, mean[1:] * (i - k) / i, 0.0) + survival_of(cell, route) * mean[:-1] * k / i
    return math.prod(survival_of(h, route) for h in held) * float(mean[left])


def test_the_straight_crossing_of_the_model() -> None:
    # ERRATUM: the safety factor is not the survival. One unknown hostile threatens neighbouring cells, and
    # the product counts it as several.
    belief = Belief.prior(20, 20, 24)
    p_s = exposure(belief.occupancy(), STRENGTH)
    chance = survival_probability(belief, STRENGTH, STRAIGHT, np.random.default_rng(1))
    assert exposure_sum(p_s, STRAIGHT) == pytest.approx(2.5, abs=0.05)
    assert safety_factor(p_s, STRAIGHT) == pytest.approx(0.07, abs=0.005)
    assert chance.estimate == pytest.approx(0.13, abs=0.01)
    assert chance.high - chance.low < 0.015


@pytest.mark.full
def test_the_interval_holds_the_exact_value_in_95_percent_of_runs() -> None:
    around = [(r, c) for r in (9, 10, 11) for c in (3, 4, 5)]
    belief = Belief.prior(20, 20, 24).merge(
        [Observation(1, 1, 0.0, tuple((r, c, (r, c) == (9, 4)) for r, c in around))]
    )
    exact = exact_survival(20, 20, 24, STRAIGHT, set(around) - {(9, 4)}, {(9, 4)})
    chances = [
        survival_probability(belief, STRENGTH, STRAIGHT, np.random.default_rng(seed), 1000)
        for seed in range(300)
    ]
    covered = sum(c.low <= exact <= c.high for c in chances)
    # 95 % of 300 is 285; a binomial is farther than 4 standard deviations from it in one case in 16 000
    assert 270 <= covered <= 300
    mean = float(np.mean([c.estimate for c in chances]))
    assert mean == pytest.approx(exact, rel=0.005)


def test_the_interval_holds_a_probability_too_small_for_the_number_of_worlds() -> None:
    route = [(30, col) for col in range(60)]
    belief, exact = Belief.prior(60, 60, 400), exact_survival(60, 60, 400, route, set(), set())
    assert exact < 1e-4
    chances = [
        survival_probability(belief, STRENGTH, route, np.random.default_rng(seed), 1000) for seed in range(50)
    ]
    assert all(c.low <= exact <= c.high < 0.005 for c in chances)


@pytest.mark.full
@pytest.mark.parametrize(("n_hostiles", "n_worlds"), [(62, 4096), (75, 4096), (30, 100)])
def test_the_interval_holds_an_outcome_that_few_worlds_show(n_hostiles: int, n_worlds: int) -> None:
    # Hostiles that never miss, along a row: the vehicle survives if and only if none is in reach.
    never_miss = FiringStrength(1.0, 1.0 - 1e-9, 1.0 - 2e-9)
    belief, route = Belief.prior(1, 500, n_hostiles), [(0, col) for col in range(41)]
    exact = math.comb(500 - 42, n_hostiles) / math.comb(500, n_hostiles)
    chances = [
        survival_probability(belief, never_miss, route, np.random.default_rng(seed), n_worlds)
        for seed in range(200)
    ]
    covered = sum(c.low <= exact <= c.high for c in chances)
    assert covered >= 180  # 190 at 95 %; three standard deviations below


@pytest.mark.parametrize("n_worlds", [-1, 0, 1])
def test_too_few_worlds_are_refused(n_worlds: int) -> None:
    with pytest.raises(ValueError, match=f"^{n_worlds} "):
        survival_probability(
            Belief.prior(5, 5, 2), STRENGTH, [(0, 0), (0, 1)], np.random.default_rng(0), n_worlds
        )


@pytest.mark.parametrize(
    ("chance", "text"),
    [
        (ProbabilityEstimate(0.134, 0.128, 0.141, 9), "0.134 (0.128–0.141)"),
        (ProbabilityEstimate(0.9, 0.9, 0.9, 9), "0.900 (certain)"),
        (ProbabilityEstimate(2.3e-5, 0.0, 1.1e-3, 9), "2.3e-05 (0.000–0.001)"),
        (ProbabilityEstimate(0.99995, 0.998, 1.0, 9), "0.99995 (0.998–1.000)"),
    ],
)
def test_an_estimate_is_printed_with_its_interval(chance: ProbabilityEstimate, text: str) -> None:
    assert str(chance) == text


POSTERIORS = [
    ("an erring sensor", HostileCount.known(3), ERRING),
    ("an unknown number", HostileCount.uniform(0, 4), SensorModel()),
    ("both", HostileCount.weighted({1: 1.0, 4: 2.0}), ERRING),
    ("no false alarms", HostileCount.known(3), SensorModel(0.2, 0.0)),
]
LOOKS = [
    Observation(1, 1, 0.0, ((1, 1, True), (0, 1, False), (3, 3, False))),
    Observation(2, 1, 0.0, ((2, 2, False), (3, 0, False))),
]


@pytest.mark.parametrize("looks", [[], LOOKS], ids=["nothing seen", "five cells seen"])
@pytest.mark.parametrize(("count", "sensor"), [p[1:] for p in POSTERIORS], ids=[p[0] for p in POSTERIORS])
def test_worlds_are_drawn_from_the_posterior(
    count: HostileCount, sensor: SensorModel, looks: list[Observation]
) -> None:
    if looks and not sensor.is_perfect:
        looks = [*looks, Observation(2, 2, 0.0, ((2, 2, True), (0, 1, False)))]
    belief = Belief.prior(4, 4, count, sensor).merge(looks)
    cells = [(r, c) for r in range(4) for c in range(4)]
    survived = weight = 0.0
    for n, p_n in zip(count.n.tolist(), count.pmf.tolist(), strict=True):
        for held in combinations(cells, n):
            chance = p_n / math.comb(16, n)
            for cell in cells:
                hit = 1.0 - sensor.p_miss if cell in held else sensor.p_false_alarm
                chance *= hit ** int(belief.hits[cell])
                chance *= (1.0 - hit) ** int(belief.looks[cell] - belief.hits[cell])
            weight += chance
            survived += chance * math.prod(survival_of(h, BENT) for h in held)
    estimate = survival_probability(belief, STRENGTH, BENT, np.random.default_rng(2), 200_000)
    # the interval at 4 instead of 1.96 standard deviations
    assert abs(estimate.estimate - survived / weight) < 4.0 / 1.96 * (estimate.high - estimate.low) / 2.0


def test_a_certain_outcome_has_no_interval() -> None:
    everything = tuple((r, c, (r, c) in {(1, 2), (3, 3)}) for r in range(4) for c in range(4))
    belief = Belief.prior(4, 4, 2).merge([Observation(1, 1, 0.0, everything)])
    chance = survival_probability(belief, STRENGTH, BENT, np.random.default_rng(3), 100)
    exact = survival_of((1, 2), BENT) * survival_of((3, 3), BENT)
    assert chance.estimate == pytest.approx(exact, rel=1e-12)
    assert chance.low == pytest.approx(chance.high, rel=1e-12)
    assert survival_among({(1, 2), (3, 3)}, STRENGTH, BENT, (4, 4)) == pytest.approx(exact, rel=1e-12)


def test_a_shot_that_never_misses() -> None:
    sure = FiringStrength(1.0, 0.5, 0.0)
    assert survival_among({(2, 1)}, sure, BENT, (4, 4)) == 0.0
    belief = Belief.prior(4, 4, 16)
    assert survival_probability(belief, sure, BENT, np.random.default_rng(4)).high == 0.0


@pytest.mark.parametrize("route", [[(0, 0)], [(3, 3), (3, 2)]], ids=["no step", "in a corner"])
def test_short_routes(route: list[Cell]) -> None:
    belief = Belief.prior(4, 4, 2)
    chance = survival_probability(belief, STRENGTH, route, np.random.default_rng(5), 50_000)
    assert chance.low <= exact_survival(4, 4, 2, route, set(), set()) <= chance.high


def test_the_interval_includes_an_outcome_that_no_world_shows() -> None:
    belief, route = Belief.prior(200, 200, 1), [(0, 0), (0, 1)]
    chance = survival_probability(belief, STRENGTH, route, np.random.default_rng(8), 100)
    assert chance.estimate == 1.0
    assert chance.low <= exact_survival(200, 200, 1, route, set(), set()) < chance.high


def test_without_hostiles_every_vehicle_survives() -> None:
    chance = survival_probability(Belief.prior(4, 4, 0), STRENGTH, BENT, np.random.default_rng(6))
    assert (chance.low, chance.estimate, chance.high) == (1.0, 1.0, 1.0)
    assert survival_among(set(), STRENGTH, BENT, (4, 4)) == 1.0


@pytest.mark.parametrize("cell", [(-1, 0), (0, 5), (5, 0)])
def test_a_route_out_of_the_area_is_refused(cell: Cell) -> None:
    belief = Belief.prior(5, 5, 3)
    with pytest.raises(ValueError, match="outside"):
        survival_probability(belief, STRENGTH, [(0, 0), cell], np.random.default_rng(0))
    with pytest.raises(ValueError, match="outside"):
        survival_among([(1, 1)], STRENGTH, [(0, 0), cell], (5, 5))
