"""The announced number of hostiles, n_HA: a number, or a distribution."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlog1py, xlogy

LOG_RANGE = 745.0
"""difference of log weight from the likeliest number, beyond which a number counts as impossible"""


class HostileCount(msgspec.Struct, frozen=True, eq=False):
    """A prior over n_HA. Raises ValueError for no n, a negative or unordered n, or log weights not finite."""

    n: NDArray[np.int64]
    """(k,) possible numbers, ascending"""
    log_weight: NDArray[np.float64]
    """(k,) logarithm of the weight of each number, up to a common constant"""

    def __post_init__(self) -> None:
        if self.n.size == 0 or self.n.shape != self.log_weight.shape:
            raise ValueError("the prior over the number of hostiles has no possible number")
        if self.n[0] < 0 or (np.diff(self.n) <= 0).any():
            raise ValueError(f"numbers of hostiles {self.n.tolist()}: expected 0 or more, ascending")
        if not np.isfinite(self.log_weight).all():
            raise ValueError("the weight of a number of hostiles is not a positive, finite number")

    @classmethod
    def known(cls, n: int) -> HostileCount:
        """Return the paper's n_HA, announced as a number."""
        return cls(np.array([n], dtype=np.int64), np.zeros(1))

    @classmethod
    def uniform(cls, least: int, greatest: int) -> HostileCount:
        """Return the uniform distribution from `least` to `greatest`."""
        n = np.arange(least, greatest + 1, dtype=np.int64)
        return cls(n, np.zeros(n.size))

    @classmethod
    def poisson(cls, mean: float, n_cells: int) -> HostileCount:
        """Return the Poisson distribution, cut off at the number of cells."""
        n = np.arange(n_cells + 1, dtype=np.int64)
        return cls._of_possible(n, xlogy(n, mean) - gammaln(n + 1))

    @classmethod
    def binomial(cls, trials: int, p: float) -> HostileCount:
        """Return the binomial distribution: each of `trials` hostiles exists with probability p."""
        n = np.arange(trials + 1, dtype=np.int64)
        log_ways = gammaln(trials + 1) - gammaln(n + 1) - gammaln(trials - n + 1)
        return cls._of_possible(n, log_ways + xlogy(n, p) + xlog1py(trials - n, -p))

    @classmethod
    def weighted(cls, weights: Mapping[int, float]) -> HostileCount:
        """Return the distribution with these weights by number. The weights need not add up to 1."""
        n = np.array(sorted(weights), dtype=np.int64)
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls._of_possible(n, np.log([weights[int(k)] for k in n]))

    @classmethod
    def _of_possible(cls, n: NDArray[np.int64], log_weight: NDArray[np.float64]) -> HostileCount:
        possible = log_weight > log_weight.max(initial=-np.inf) - LOG_RANGE
        return cls(n[possible], log_weight[possible])

    @property
    def is_number(self) -> bool:
        return self.n.size == 1

    @property
    def least(self) -> int:
        return int(self.n[0])

    @property
    def greatest(self) -> int:
        return int(self.n[-1])

    @property
    def pmf(self) -> NDArray[np.float64]:
        """(k,) probability of each number."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    @property
    def mean(self) -> float:
        return float(self.pmf @ self.n)

    def __str__(self) -> str:
        """Return the number, or its 95 % range."""
        if self.is_number:
            return str(self.least)
        low, high = self.n[np.searchsorted(np.cumsum(self.pmf), (0.025, 0.975)).clip(max=self.n.size - 1)]
        return f"{low} to {high} (95 %)"

    def draw(self, rng: np.random.Generator) -> int:
        """Return a random number of hostiles; `rng` stays unused if only one number is possible."""
        return self.least if self.is_number else int(rng.choice(self.n, p=self.pmf))
