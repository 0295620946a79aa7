"""Estimates and intervals: known values, and how often the intervals cover the truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from swarmctl.study.statistics import (
    RESAMPLES,
    Estimates,
    Sums,
    by_world,
    counts,
    differences,
    estimate,
    proportions,
    ratios,
    savings,
    wilson,
)

SIGMAS = 5.0
"""standard errors by which a drawn value may be off; beyond it is one draw in two million"""
LOW_TAIL = float(stats.norm.pdf(stats.norm.ppf(0.025)))
"""density of the standard normal distribution at an end of a 95 % interval"""


def percentile_error(resamples: int) -> float:
    """Return the standard error of a bootstrap interval's end, in standard errors of the mean."""
    return float(np.sqrt(0.025 * 0.975 / resamples)) / LOW_TAIL


def mean(values: ArrayLike, worlds: ArrayLike, seed: int = 0, resamples: int = RESAMPLES) -> Estimates:
    sums = by_world(values, np.zeros(np.size(worlds), dtype=np.int64), worlds, 1)
    return ratios(sums.total, sums.count, seed, resamples)[0]


def test_sums_go_to_their_group_and_world_without_nan() -> None:
    sums = by_world([1.0, 2.0, 4.0, np.nan, 8.0], [0, 0, 1, 1, -1], [5, 9, 9, 9, 9], 2)
    assert sums.total.tolist() == [[1.0, 2.0], [0.0, 4.0]]
    assert sums.count.tolist() == [[1.0, 1.0], [0.0, 1.0]]


def test_a_mean_weighs_vehicles_equally_and_not_worlds() -> None:
    assert mean([1.0, 1.0, 4.0], [0, 0, 1]).value == pytest.approx(2.0)


def test_an_interval_agrees_with_that_of_scipy_and_is_wider_for_few_worlds() -> None:
    values = np.random.default_rng(1).exponential(size=400)
    ours = mean(values, np.arange(400), resamples=20_000)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=0)
    # Both ends are drawn; ours is besides wider by the quantiles of Student's distribution.
    wider = stats.t.ppf(0.975, 399) * np.sqrt(400 / 399) - stats.norm.ppf(0.975)
    off = (SIGMAS * np.sqrt(2) * percentile_error(20_000) + wider) * stats.sem(values)
    assert ours.low == pytest.approx(theirs.confidence_interval.low, abs=off)
    assert ours.high == pytest.approx(theirs.confidence_interval.high, abs=off)
    few, worlds = values[:8], np.arange(8)
    narrow = stats.bootstrap((few,), np.mean, method="percentile", n_resamples=20_000, rng=0)
    width = narrow.confidence_interval.high - narrow.confidence_interval.low
    assert 2 * mean(few, worlds, resamples=20_000).half_width > 1.15 * width


def test_vehicles_that_copy_each_other_add_no_certainty() -> None:
    values, worlds = np.random.default_rng(1).normal(size=50), np.arange(50)
    alone = mean(values, worlds)
    copied = mean(np.repeat(values, 5), np.repeat(worlds, 5))
    assert (copied.low, copied.high) == (pytest.approx(alone.low), pytest.approx(alone.high))


def test_equal_seeds_give_equal_intervals() -> None:
    values, worlds = np.random.default_rng(1).normal(size=50), np.arange(50)
    low, again, other = (mean(values, worlds, seed=seed).low for seed in (3, 3, 4))
    assert low == again != other


def test_one_world_has_a_value_and_no_interval() -> None:
    one = mean([1.0, 3.0], [4, 4])
    assert one.value == 2.0
    assert np.isnan(one.low)
    assert one.half_width == float("inf")


def test_events_that_never_happened_have_an_upper_limit() -> None:
    found = counts(np.zeros((1, 100)), np.full((1, 100), 5.0))[0]
    assert found.low == 0.0
    assert stats.poisson.cdf(0, found.high * 500) == pytest.approx(0.025)


@pytest.mark.parametrize("values", [np.zeros(40, dtype=np.int32), np.ones(40, dtype=bool)])
def test_shares_and_counts_without_variance_are_not_certain(values: NDArray[np.generic]) -> None:
    assert estimate(values, np.arange(40)).half_width > 0.04


def test_a_difference_cancels_what_the_worlds_add_to_both_levels() -> None:
    rng = np.random.default_rng(1)
    world = rng.normal(scale=10.0, size=200)
    noise = rng.normal(scale=0.1, size=(2, 200))
    values = np.stack([world, world + 1.0]) + noise
    ones = np.ones((2, 200))
    paired, single = differences(values, ones, [0, 0]), ratios(values, ones)
    paired_error, single_error = 0.1 * np.sqrt(2 / 200), 10.0 / np.sqrt(200)
    assert paired.value.tolist() == pytest.approx([0.0, 1.0], abs=SIGMAS * paired_error)
    assert paired[0].half_width == 0.0
    # A half-width varies by the estimated standard deviation and by the drawn ends.
    z = stats.norm.ppf(0.975)
    off = SIGMAS * np.hypot(1 / np.sqrt(2 * 200), percentile_error(RESAMPLES) / np.sqrt(2) / z)
    assert paired[1].half_width == pytest.approx(z * paired_error, rel=off)
    assert single[1].half_width == pytest.approx(z * single_error, rel=off)


def test_a_difference_takes_only_the_worlds_of_both_levels() -> None:
    total = np.array([[1.0, 2.0, 90.0, 3.0], [2.0, 3.0, 0.0, 4.0]])
    count = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 0.0, 1.0]])
    found = differences(total, count, [0, 0])[1]
    assert found.value == pytest.approx(1.0)
    assert (found.low, found.high, found.n_worlds) == (pytest.approx(1.0), pytest.approx(1.0), 3)


def test_savings_are_what_is_saved_for_a_unit_spent_more() -> None:
    ones = np.ones((2, 50))
    strikes = Sums(np.stack([np.full(50, 4.0), np.full(50, 1.0)]), ones)
    messages = Sums(np.stack([np.zeros(50), np.full(50, 6.0)]), ones)
    found = savings(strikes, messages, [0, 0])
    assert found[1].value == pytest.approx(0.5)
    assert np.isnan(found[0].value), "the reference spends nothing more than itself"
    doubtful = Sums(np.stack([np.zeros(50), np.linspace(-1.0, 1.0, 50)]), ones)
    assert np.isnan(savings(strikes, doubtful, [0, 0])[1].value)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (10, 10), (481, 1000)])
def test_independent_trials_have_the_interval_of_wilson(k: int, n: int) -> None:
    exact = stats.binomtest(k, n).proportion_ci(method="wilson")
    assert np.ravel(wilson(k, n)) == pytest.approx([exact.low, exact.high])
    found = estimate(np.arange(n) < k, np.arange(n))
    assert (found.low, found.high) == (pytest.approx(exact.low), pytest.approx(exact.high))


def test_vehicles_that_share_their_fate_count_as_one_trial_a_world() -> None:
    fates = np.arange(40) < 14
    worlds = np.arange(40)
    alone = stats.binomtest(14, 40).proportion_ci(method="wilson")
    shared = estimate(np.repeat(fates, 5), np.repeat(worlds, 5))
    assert (shared.low, shared.high) == (pytest.approx(alone.low), pytest.approx(alone.high))
    all_survive = estimate(np.ones(200, dtype=bool), np.repeat(worlds, 5))
    assert all_survive.low == pytest.approx(stats.binomtest(40, 40).proportion_ci(method="wilson").low)


def test_a_group_without_worlds_is_not_defined() -> None:
    none = np.zeros((1, 3))
    assert np.isnan(ratios(none, none).value[0])
    assert np.isnan(proportions(none, none).low[0])


Draw = Callable[[np.random.Generator, int], tuple[NDArray[np.float64], NDArray[np.float64]]]


def _clustered_counts(rng: np.random.Generator, n_worlds: int) -> tuple[NDArray, NDArray]:
    danger = rng.gamma(2.0, 0.4, size=n_worlds)
    return rng.poisson(danger[:, None], size=(n_worlds, 5)).sum(axis=1), np.full(n_worlds, 5.0)


def _skewed(rng: np.random.Generator, n_worlds: int) -> tuple[NDArray, NDArray]:
    return rng.gamma(4.0, 0.25, size=n_worlds), np.ones(n_worlds)


@pytest.mark.full
@pytest.mark.parametrize("n_worlds", [20, 50, 200])
@pytest.mark.parametrize(("draw", "truth"), [(_clustered_counts, 0.8), (_skewed, 1.0)])
def test_intervals_of_means_cover_the_truth(draw: Draw, truth: float, n_worlds: int) -> None:
    rng = np.random.default_rng(1)
    studies = [draw(rng, n_worlds) for _ in range(2000)]
    covered = 0
    for first in range(0, 2000, 100):
        top, below = (np.stack(side) for side in zip(*studies[first : first + 100], strict=True))
        found = ratios(top, below, seed=first)
        covered += int(((found.low <= truth) & (truth <= found.high)).sum())
    assert 0.92 <= covered / 2000 <= 0.98


@pytest.mark.full
@pytest.mark.parametrize("n_worlds", [30, 200])
@pytest.mark.parametrize("sharing", [0.0, 0.3])
def test_intervals_of_proportions_cover_the_truth(sharing: float, n_worlds: int) -> None:
    rng = np.random.default_rng(2)
    p = 0.3
    chance = np.full((2000, n_worlds), p)
    if sharing:
        chance = rng.beta(p * (1 / sharing - 1), (1 - p) * (1 / sharing - 1), size=(2000, n_worlds))
    found = proportions(rng.binomial(5, chance), np.full((2000, n_worlds), 5.0))
    covered = float(((found.low <= p) & (p <= found.high)).mean())
    assert 0.92 <= covered <= 0.98
