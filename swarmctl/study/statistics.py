"""Estimates with 95 % intervals from samples of worlds. Pure.

Vehicles of one world meet the same hostiles, so they are not independent. The world is therefore the unit
of each interval here. Arrays have one row a group (a level, or a value on an axis) and one column a world.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CONFIDENCE = 0.95
RESAMPLES = 2000
_CHUNK = 250
"""number of resamples drawn at once, which limits the memory to 2 MB for 1000 worlds"""


class Estimates(msgspec.Struct, frozen=True, eq=False):
    """Estimated values with their intervals, arrays of one shape; NaN: not defined."""

    value: Floats
    low: Floats
    high: Floats
    n_worlds: Ints

    def __getitem__(self, at: Any) -> Estimates:
        """Return the part at an index of the arrays."""
        return Estimates(self.value[at], self.low[at], self.high[at], self.n_worlds[at])

    def reshape(self, shape: Sequence[int]) -> Estimates:
        """Return the same values as arrays of another shape."""
        size = tuple(shape)
        value, low, high = (limit.reshape(size) for limit in (self.value, self.low, self.high))
        return Estimates(value, low, high, self.n_worlds.reshape(size))

    @property
    def half_width(self) -> Floats:
        """Half the width of each interval; infinite if one world is too few for an interval."""
        width = self.high - self.low
        return np.where(np.isfinite(width), width / 2, np.inf)


class Sums(msgspec.Struct, frozen=True, eq=False):
    """Sums of a measure (groups, worlds), and the number of summed values; 0 values: no such world."""

    total: Floats
    count: Floats


def by_world(values: ArrayLike, groups: ArrayLike, worlds: ArrayLike, n_groups: int) -> Sums:
    """Return the sums of `values` (n,) by group index and world; NaN is left out.

    `groups` are indices below `n_groups`; a negative one leaves the value out. Columns are sorted by world.
    """
    value = np.asarray(values, dtype=np.float64)
    group = np.asarray(groups, dtype=np.int64)
    _, world = np.unique(np.asarray(worlds), return_inverse=True)
    n_worlds = int(world.max(initial=-1)) + 1
    kept = np.isfinite(value) & (group >= 0)
    cell = group[kept] * n_worlds + world[kept]
    size, shape = n_groups * n_worlds, (n_groups, n_worlds)
    total = np.bincount(cell, weights=value[kept], minlength=size).astype(np.float64)
    count = np.bincount(cell, minlength=size).astype(np.float64)
    return Sums(total.reshape(shape), count.reshape(shape))


def estimate(values: NDArray[Any], worlds: ArrayLike) -> Estimates:
    """Return the mean of `values` (n,) with its interval, as numbers, by their type as in `estimates`."""
    sums = by_world(values, np.zeros(np.size(worlds), dtype=np.int64), worlds, 1)
    return estimates(values.dtype, sums.total, sums.count)[0]


def estimates(dtype: np.dtype[Any], numerator: ArrayLike, denominator: ArrayLike) -> Estimates:
    """Return Σ numerator / Σ denominator of each group with its interval, by the type of the summed values.

    bool is a share, an integer is a number of events, and every other type a mean.
    """
    if dtype.kind == "b":
        return proportions(numerator, denominator)
    return counts(numerator, denominator) if dtype.kind == "i" else ratios(numerator, denominator)


def ratios(
    numerator: ArrayLike, denominator: ArrayLike, seed: int = 0, resamples: int = RESAMPLES
) -> Estimates:
    """Return Σ numerator / Σ denominator of each group; with counts as denominator this is the mean.

    The interval is the percentile bootstrap over worlds, with Hesterberg's expanded percentiles ("What
    Teachers Should Know About the Bootstrap", 2015), which correct its narrowness for few worlds. Equal
    seeds draw the same worlds for all groups.
    """
    top, below = _matrix(numerator), _matrix(denominator)
    n = top.shape[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        value = top.sum(axis=1) / below.sum(axis=1)
        drawn = _resample(np.concatenate([top, below]), seed, resamples)
        sample = drawn[:, :n] / drawn[:, n:]
    return _interval(value, sample, (below != 0).sum(axis=1))


def counts(events: ArrayLike, denominator: ArrayLike) -> Estimates:
    """Return events by unit of the denominator: as `ratios`, also right where no event was seen.

    A bootstrap of zeros has no width. There the upper limit is the exact one of a Poisson count of zero.
    """
    total, units = _matrix(events).sum(axis=1), _matrix(denominator).sum(axis=1)
    found = ratios(events, denominator)
    with np.errstate(divide="ignore"):
        limit = -np.log((1.0 - CONFIDENCE) / 2) / units
    none = (total == 0) & (units > 0)
    return Estimates(
        found.value, np.where(none, 0.0, found.low), np.where(none, limit, found.high), found.n_worlds
    )


def differences(numerator: ArrayLike, denominator: ArrayLike, reference: ArrayLike) -> Estimates:
    """Return the ratio of each group minus the ratio of its reference group, in the worlds of both.

    `reference` (groups,) are row indices. Both groups of a pair get the same drawn worlds, so what a world
    adds to both cancels out.
    """
    top, below, top_ref, below_ref = _paired(numerator, denominator, reference)
    n = top.shape[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        value = top.sum(axis=1) / below.sum(axis=1) - top_ref.sum(axis=1) / below_ref.sum(axis=1)
        drawn = _resample(np.concatenate([top, below, top_ref, below_ref]))
        sample = drawn[:, :n] / drawn[:, n : 2 * n] - drawn[:, 2 * n : 3 * n] / drawn[:, 3 * n :]
    return _interval(value, sample, (below != 0).sum(axis=1))


def savings(saved: Sums, spent: Sums, reference: ArrayLike) -> Estimates:
    """Return what each group saves against its reference for each unit that it spends more.

    This is Σ(saved_ref − saved) / Σ(spent − spent_ref) over the worlds of both. The value and its interval
    are NaN unless the group spends more in all drawn samples of worlds: a ratio whose denominator may be
    zero says nothing.
    """
    row = np.asarray(reference, dtype=np.int64)
    both = (saved.count > 0) & (saved.count[row] > 0)
    gain = (saved.total[row] - saved.total) * both
    cost = (spent.total - spent.total[row]) * both
    n = gain.shape[0]
    drawn = _resample(np.concatenate([gain, cost]))
    is_defined = (drawn[:, n:] > 0).all(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(is_defined, gain.sum(axis=1) / cost.sum(axis=1), np.nan)
        sample = np.where(is_defined, drawn[:, :n] / drawn[:, n:], np.nan)
    return _interval(value, sample, both.sum(axis=1))


def proportions(successes: ArrayLike, trials: ArrayLike) -> Estimates:
    """Return the share of successes of each group with its Wilson interval.

    Dependence within worlds enters by the effective number of trials: trials / design effect. The design
    effect compares the variance between worlds with that of independent trials. It is at least 1, and at
    most that of worlds whose trials all end alike; this greatest one is taken for shares of 0 and 1.
    """
    won, tried = _matrix(successes), _matrix(trials)
    n, n_worlds = tried.sum(axis=1), (tried != 0).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = won.sum(axis=1) / n
        rest = np.where(tried != 0, won - p[:, None] * tried, 0.0)
        variance = n_worlds / (n_worlds - 1) * (rest**2).sum(axis=1) / n**2
        fewest = n**2 / (tried**2).sum(axis=1)
        effective = np.where((p > 0) & (p < 1) & (n_worlds > 1), p * (1 - p) / variance, fewest)
        effective = np.clip(effective, fewest, n)
        low, high = wilson(p * effective, effective)
    return Estimates(p, low, high, n_worlds.astype(np.int64))


def wilson(successes: ArrayLike, trials: ArrayLike) -> tuple[Floats, Floats]:
    """Return the limits of Wilson's interval; the numbers need not be whole."""
    n = np.asarray(trials, dtype=np.float64)
    p = np.asarray(successes, dtype=np.float64) / n
    z2 = float(stats.norm.ppf((1.0 + CONFIDENCE) / 2)) ** 2
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = np.sqrt(z2 * (p * (1 - p) / n + z2 / (4 * n**2))) / (1 + z2 / n)
    return np.where(p == 0, 0.0, centre - half), np.where(p == 1, 1.0, centre + half)


def _matrix(values: ArrayLike) -> Floats:
    return np.atleast_2d(np.asarray(values, dtype=np.float64))


def _paired(
    first: ArrayLike, second: ArrayLike, reference: ArrayLike
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return both arrays and their reference rows, with zeros in worlds that one of the pair lacks."""
    a, b, row = _matrix(first), _matrix(second), np.asarray(reference, dtype=np.int64)
    both = (b != 0) & (b[row] != 0)
    return a * both, b * both, a[row] * both, b[row] * both


def _resample(columns: Floats, seed: int = 0, resamples: int = RESAMPLES) -> Floats:
    """Return the sums of `columns` (k, worlds) over worlds drawn with replacement, (resamples, k)."""
    rng = np.random.default_rng(seed)
    n_worlds = columns.shape[1]
    parts = []
    for begin in range(0, resamples, _CHUNK):
        n = min(_CHUNK, resamples - begin)
        drawn = rng.integers(n_worlds, size=(n, n_worlds)) + np.arange(n)[:, None] * n_worlds
        times = np.bincount(drawn.ravel(), minlength=n * n_worlds).reshape(n, n_worlds)
        parts.append(times.astype(np.float64) @ columns.T)
    return np.concatenate(parts)


def _interval(value: Floats, sample: Floats, n_worlds: NDArray[np.integer]) -> Estimates:
    """Return the expanded percentile intervals of `sample` (resamples, groups)."""
    low, high = np.full(value.shape, np.nan), np.full(value.shape, np.nan)
    for n in np.unique(n_worlds[n_worlds > 1]).tolist():
        same = (n_worlds == n) & np.isfinite(value)
        if not same.any():
            continue
        t = float(stats.t.ppf((1.0 - CONFIDENCE) / 2, n - 1))
        tail = float(stats.norm.cdf(np.sqrt(n / (n - 1)) * t))
        low[same], high[same] = np.nanquantile(sample[:, same], [tail, 1.0 - tail], axis=0)
    return Estimates(value, low, high, n_worlds.astype(np.int64))
