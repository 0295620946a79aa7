"""The conditional Bernoulli distribution: independent cells, conditioned on the total number of hostiles.

A cell holds at most one hostile, and every set S of |S| = n cells is equally likely a priori. The looks at a
cell multiply its odds by a ratio λ: P(S) ∝ ∏_{i in S} λ_i. Cells with the same λ are exchangeable and form a
group. The number of hostiles in each group is a sufficient statistic. Even a large area has few groups.

Method (Chen and Liu, "Statistical applications of the Poisson-binomial and conditional Bernoulli
distributions", 1997):

1. Multiply all odds by a common factor e^t. The conditional distribution stays the same.
2. Choose t so that the expected total equals the given total. The number in each group is binomial.
3. Convolve the groups (forward pass), then condition on the total (backward pass).

All terms are positive, so no cancellation occurs. Near the given total no underflow occurs. The negligible
tails of each distribution are left out. An uncertain total is split into ranges with one t each. A saddle
point bound excludes negligible totals.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TAIL = 1e-40
"""share of the largest term below which terms are left out of a distribution"""
NEGLIGIBLE = 60.0
"""difference of log probability from the likeliest total above which a total is left out"""
REACH_SIGMA = 6.0
"""half width of a range of totals [standard deviations]; small enough for precise tails"""
KNOT_SIGMA = 3.0
"""distance between knots of the saddle point bound [standard deviations]"""
MAX_KNOTS = 257
N_BISECTIONS = 32
"""number of bisections for t, which need not be exact"""


class _Window(msgspec.Struct, frozen=True):
    """A sequence with values at lo, lo + 1, ... and zero elsewhere."""

    lo: int
    values: Floats

    @property
    def end(self) -> int:
        return self.lo + self.values.size

    def spread(self, lo: int, end: int) -> Floats:
        """Return the values at lo .. end − 1."""
        wide = np.zeros(end - lo)
        first, last = max(lo, self.lo), min(end, self.end)
        if first < last:
            wide[first - lo : last - lo] = self.values[first - self.lo : last - self.lo]
        return wide


class HostileGroups:
    """The numbers of hostiles in groups of exchangeable cells, given the weight of each total.

    Parameters
    ----------
    log_ratio: (g,) finite, log λ of the cells of each group.
    n_cells: (g,) cells in each group, at least 1.
    totals: (k,) possible totals of hostiles, ascending, from 0 to the number of cells.
    log_weight: (k,) for each total n, log weight of *one* set of n cells, up to a common constant.
    """

    def __init__(self, log_ratio: Floats, n_cells: Ints, totals: Ints, log_weight: Floats) -> None:
        self.n_groups = int(n_cells.size)
        kept = _relevant_totals(log_ratio, n_cells, totals, log_weight)
        self._ranges = [
            _TotalRange(log_ratio, n_cells, t, totals[part], log_weight[part])
            for t, part in _ranges(log_ratio, n_cells, totals, kept)
        ]
        log_evidence = np.array([part.log_evidence for part in self._ranges])
        weight = np.exp(log_evidence - log_evidence.max())
        self._weight = weight / weight.sum()

    def means(self) -> Floats:
        """Return (g,) expected numbers of hostiles in each group."""
        parts = zip(self._weight.tolist(), self._ranges, strict=True)
        means = np.zeros(self.n_groups)
        for weight, total_range in parts:
            means += weight * total_range.means()
        return means

    def draw(self, rng: np.random.Generator, size: int, n_groups: int) -> Ints:
        """Return (size, n_groups) random numbers in the first `n_groups` groups, by range of totals."""
        shares = rng.multinomial(size, self._weight).tolist()
        parts = zip(shares, self._ranges, strict=True)
        return np.concatenate([total_range.draw(rng, n, n_groups) for n, total_range in parts if n])


class _TotalRange:
    """A range of adjacent totals with one t."""

    def __init__(self, log_ratio: Floats, n_cells: Ints, t: float, totals: Ints, log_weight: Floats) -> None:
        odds = np.clip(log_ratio + t, -700.0, 700.0)
        self._groups = [_binomial(m, o) for m, o in zip(n_cells.tolist(), odds.tolist(), strict=True)]
        self._forward = [_Window(0, np.ones(1))]
        for group in self._groups:
            before = self._forward[-1]
            after = np.convolve(before.values, group.values)
            self._forward.append(_trimmed(_Window(before.lo + group.lo, after)))
        last = self._forward[-1]
        inside = (totals >= last.lo) & (totals < last.end)
        tilted = log_weight[inside] - t * totals[inside]
        top = float(tilted.max())
        weight = np.zeros(last.values.size)
        weight[totals[inside] - last.lo] = np.exp(tilted - top)
        self._total_weight = _Window(last.lo, weight)
        self._sum = float(last.values @ weight)
        self.log_evidence = math.log(self._sum) + top + float(n_cells @ np.logaddexp(0.0, log_ratio + t))

    def means(self) -> Floats:
        means = np.zeros(len(self._groups))
        backward = self._total_weight
        for g in range(len(self._groups) - 1, -1, -1):
            before, group = self._forward[g], self._groups[g]
            wide = backward.spread(before.lo + group.lo, before.end + group.end - 1)
            number = np.arange(group.lo, group.end)
            means[g] = before.values @ np.correlate(wide, number * group.values, "valid") / self._sum
            backward = _Window(before.lo, np.correlate(wide, group.values, "valid"))
        return means

    def draw(self, rng: np.random.Generator, size: int, n_groups: int) -> Ints:
        backward = self._total_weight
        for g in range(len(self._groups) - 1, n_groups - 1, -1):
            before, group = self._forward[g], self._groups[g]
            wide = backward.spread(before.lo + group.lo, before.end + group.end - 1)
            backward = _Window(before.lo, np.correlate(wide, group.values, "valid"))
        first = self._forward[n_groups]
        chance = np.cumsum(first.values * backward.values)
        remaining = first.lo + np.searchsorted(chance, rng.random(size) * chance[-1], side="right")
        numbers = np.zeros((size, n_groups), dtype=np.int64)
        for g in range(n_groups - 1, 0, -1):
            numbers[:, g] = self._draw_group(rng, g, remaining)
            remaining = remaining - numbers[:, g]
        if n_groups:
            numbers[:, 0] = remaining
        return numbers

    def _draw_group(self, rng: np.random.Generator, g: int, total: Ints) -> Ints:
        """Return draws of the number in group g, given `total` hostiles in the groups 0 .. g."""
        before, group = self._forward[g], self._groups[g]
        possible, which = np.unique(total, return_inverse=True)
        rest = possible[:, None] - np.arange(group.lo, group.end)[None, :] - before.lo
        inside = (rest >= 0) & (rest < before.values.size)
        weights = np.where(inside, before.values[np.where(inside, rest, 0)], 0.0) * group.values
        chance = np.cumsum(weights, axis=1)
        reached = chance[which] <= (rng.random(total.size) * chance[which, -1])[:, None]
        return group.lo + np.asarray(reached.sum(axis=1), dtype=np.int64)


def _binomial(n: int, log_odds: float) -> _Window:
    """Return binomial probabilities without negligible tails.

    The ratios of neighbouring terms are multiplied outwards from the likeliest number.
    """
    p, q = float(expit(log_odds)), float(expit(-log_odds))
    # Bernstein's inequality: a tail of e^-l begins no farther than this from the mean.
    log_tail = -math.log(TAIL) + 5.0
    reach = log_tail / 3.0 + math.sqrt(log_tail**2 / 9.0 + 2.0 * log_tail * n * p * q)
    lo, hi = max(0, math.floor(n * p - reach)), min(n, math.ceil(n * p + reach))
    mode = min(max(math.floor((n + 1) * p), lo), hi)
    odds = math.exp(log_odds)
    up = np.arange(mode, hi)
    down = np.arange(mode, lo, -1)
    values = np.concatenate(
        [
            np.cumprod(down / ((n - down + 1) * odds))[::-1],
            np.ones(1),
            np.cumprod((n - up) * odds / (up + 1)),
        ]
    )
    return _trimmed(_Window(lo, values / values.sum()))


def _trimmed(window: _Window) -> _Window:
    kept = np.flatnonzero(window.values > TAIL * window.values.max())
    return _Window(window.lo + int(kept[0]), window.values[kept[0] : kept[-1] + 1])


def _tilt(log_ratio: Floats, n_cells: Ints, expected: Floats) -> Floats:
    """Return the t for each of the `expected` totals, which lie between 0 and the number of cells."""
    margin = math.log(2.0 * float(n_cells.sum())) + 1.0
    low = np.full(expected.shape, -float(log_ratio.max()) - margin)
    high = np.full(expected.shape, -float(log_ratio.min()) + margin)
    for _ in range(N_BISECTIONS):
        middle = 0.5 * (low + high)
        too_few = expit(log_ratio + middle[:, None]) @ n_cells < expected
        low, high = np.where(too_few, middle, low), np.where(too_few, high, middle)
    return np.asarray(0.5 * (low + high))


def _clipped(expected: Floats, n_cells: Ints) -> Floats:
    return np.clip(expected, 0.5, float(n_cells.sum()) - 0.5)


def _relevant_totals(log_ratio: Floats, n_cells: Ints, totals: Ints, log_weight: Floats) -> Ints:
    """Return the indices of all totals except those that are certainly negligible.

    Let e_J(λ) be the weight of all sets of J cells, and U(J) = min over t of Σ m log(1 + λ e^t) − J t. Then
    e_J(λ) < e^U(J), and the ratio of both is bounded by a power of J. U is concave. Between knots its chord
    is a lower bound, and its tangents are upper bounds.
    """
    if totals.size <= 2:
        return np.arange(totals.size)
    cells = float(n_cells.sum())
    # An angle of 1 is 2 √cells standard deviations of a binomial distribution, at every total.
    first, last = np.arcsin(np.sqrt(np.array([totals[0], totals[-1]]) / cells)).tolist()
    n_knots = min(2 + math.ceil((last - first) * 2.0 * math.sqrt(cells) / KNOT_SIGMA), MAX_KNOTS)
    at = np.unique(_clipped(cells * np.sin(np.linspace(first, last, n_knots)) ** 2, n_cells))
    t = _tilt(log_ratio, n_cells, at)
    top = np.logaddexp(0.0, log_ratio + t[:, None]) @ n_cells
    lower = log_weight + np.interp(totals, at, top - at * t)
    right = np.clip(np.searchsorted(at, totals), 1, at.size - 1) if at.size > 1 else np.zeros_like(totals)
    left = np.maximum(right - 1, 0)
    upper = log_weight + np.minimum(top[left] - totals * t[left], top[right] - totals * t[right])
    return np.flatnonzero(upper >= lower.max() - NEGLIGIBLE)


def _ranges(log_ratio: Floats, n_cells: Ints, totals: Ints, kept: Ints) -> list[tuple[float, Ints]]:
    """Return (t, indices of totals) of each range."""
    ranges: list[tuple[float, Ints]] = []
    while kept.size:
        first = totals[kept[:1]].astype(np.float64)
        t, sigma = _tilt_and_sigma(log_ratio, n_cells, first)
        middle = np.minimum(first + REACH_SIGMA * sigma, 0.5 * (first + totals[kept[-1]]))
        t, sigma = _tilt_and_sigma(log_ratio, n_cells, middle)
        in_range = totals[kept] <= max(first[0], middle[0] + REACH_SIGMA * sigma)
        ranges.append((t, kept[in_range]))
        kept = kept[~in_range]
    return ranges


def _tilt_and_sigma(log_ratio: Floats, n_cells: Ints, expected: Floats) -> tuple[float, float]:
    t = float(_tilt(log_ratio, n_cells, _clipped(expected, n_cells))[0])
    p = expit(log_ratio + t)
    return t, math.sqrt(float((p * expit(-log_ratio - t)) @ n_cells))
