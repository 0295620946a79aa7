"""The true survival probability of a route, which differs from 1 − ΣP_s and from ∏(1 − P_s).

For each cell that a vehicle enters, each hostile in reach shoots once, independently, and hits with the
probability of Eq. 1. Among known hostiles the probability of survival is ∏(1 − fs). But the hostiles' cells
are unknown, and one hostile threatens several cells of a route. So possible placements of the hostiles
("worlds") are drawn from the belief, and their survival probabilities are averaged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.belief import Belief
from swarmctl.core.grid import Cell
from swarmctl.core.inference.occupancy import CellClasses, posterior
from swarmctl.core.threat import FiringStrength

N_WORLDS = 4096
Z_95 = 1.959964
"""two-sided 95 % of a normal distribution"""
MIN_EFFECTIVE_WORLDS = 100.0
"""Least effective number of worlds, n·mean²/mean of squares. If the average rests on fewer worlds, the normal
interval is too narrow. Wilson's interval is valid for all values in [0, 1]."""


class ProbabilityEstimate(msgspec.Struct, frozen=True):
    """An estimated probability with its 95 % interval."""

    estimate: float
    low: float
    high: float
    n_worlds: int

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{_digits(self.estimate)} (certain)"
        return f"{_digits(self.estimate)} ({_digits(self.low)}–{_digits(self.high)})"


def _digits(chance: float) -> str:
    """Return a probability with three decimals, or with more digits below 0.001 and above 0.999."""
    if chance in (0.0, 1.0) or 0.001 <= chance <= 0.999:
        return f"{chance:.3f}"
    return f"{chance:.1e}" if chance < 0.001 else f"{chance:.5f}"


def survival_probability(
    belief: Belief,
    strength: FiringStrength,
    cells: Sequence[Cell],
    rng: np.random.Generator,
    n_worlds: int = N_WORLDS,
) -> ProbabilityEstimate:
    """Estimate the probability, by belief, that a vehicle enters every cell of a route without being hit.

    The start cell does not count. A cell entered twice counts twice.

    The shots are not drawn. For given hostiles the survival probability is a product. The product's average
    over the worlds has the same mean as the share of surviving vehicles, and a smaller variance
    (Rao-Blackwell). The interval is the normal interval of this average. If the average rests on few worlds,
    the interval is widened to cover Wilson's interval. If every cell in reach is certain, the interval is a
    point. Raises ValueError for fewer than 2 worlds, and for a cell outside the area.
    """
    if n_worlds < 2:
        raise ValueError(f"{n_worlds} worlds: expected 2 or more")
    reached, entries = _in_reach(belief.looks.shape, cells)
    # Cells in reach with equal looks and hits and with equal entries are one kind.
    alike = np.hstack([belief.looks_and_hits(reached), entries])
    kinds, n_cells = np.unique(alike, axis=0, return_counts=True)
    survival = _survival(strength, kinds[:, 2:])
    looks, hits = kinds[:, 0], kinds[:, 1]
    worlds = _Worlds(belief, CellClasses(looks, hits, n_cells.astype(np.int64)))
    survived = np.full(n_worlds, np.prod(survival[worlds.is_occupied] ** n_cells[worlds.is_occupied]))
    for chance, hostiles in zip(survival[worlds.is_uncertain], worlds.draw(rng, n_worlds).T, strict=True):
        survived *= chance**hostiles
    mean = float(survived.mean())
    p_occupied = belief.occupancy().ravel()[reached]
    is_certain = bool(((p_occupied == 0.0) | (p_occupied == 1.0)).all())
    low, high = (mean, mean) if is_certain else _interval(survived, mean)
    return ProbabilityEstimate(mean, low, high, n_worlds)


def _interval(survived: NDArray[np.float64], mean: float) -> tuple[float, float]:
    """Return the 95 % interval of the mean of values in [0, 1]."""
    n = survived.size
    half = Z_95 * float(survived.std(ddof=1)) / math.sqrt(n)
    low, high = mean - half, mean + half
    # The rare outcome may be the survival or the loss.
    rare_mean = min(mean, 1.0 - mean)
    rare = survived if mean <= 0.5 else 1.0 - survived
    squares = float(np.mean(rare**2))
    if squares == 0.0 or n * rare_mean**2 / squares < MIN_EFFECTIVE_WORLDS:
        z2 = Z_95**2 / n
        centre = (mean + z2 / 2.0) / (1.0 + z2)
        spread = Z_95 / (1.0 + z2) * math.sqrt(mean * (1.0 - mean) / n + z2 / (4.0 * n))
        low, high = min(low, centre - spread), max(high, centre + spread)
    return max(low, 0.0), min(high, 1.0)


def survival_among(
    hostiles: Iterable[Cell], strength: FiringStrength, cells: Sequence[Cell], shape: tuple[int, int]
) -> float:
    """Return the exact probability, ∏(1 − fs), that a vehicle survives a route among known hostiles.

    The start cell does not count. Raises ValueError for a cell outside the area.
    """
    reached, entries = _in_reach(shape, cells)
    is_occupied = np.isin(reached, [row * shape[1] + col for row, col in hostiles])
    return float(np.prod(_survival(strength, entries[is_occupied])))


class _Worlds:
    """Random numbers of hostiles in the kinds of cells `near` a route, by a belief."""

    def __init__(self, belief: Belief, near: CellClasses) -> None:
        everywhere = belief.classes
        n_near = np.zeros_like(everywhere.n_cells)
        for kind in range(near.n_cells.size):
            same = (everywhere.looks == near.looks[kind]) & (everywhere.hits == near.hits[kind])
            n_near[same] += near.n_cells[kind]
        far = everywhere.n_cells > n_near
        both = CellClasses(
            np.concatenate([near.looks, everywhere.looks[far]]),
            np.concatenate([near.hits, everywhere.hits[far]]),
            np.concatenate([near.n_cells, (everywhere.n_cells - n_near)[far]]),
        )
        is_uncertain, self._groups = posterior(belief.count, belief.sensor, both)
        self.is_uncertain = is_uncertain[: near.n_cells.size]
        """(k,) True for kinds of cells that may or may not hold hostiles"""
        log_ratio = belief.sensor.log_ratio(near.looks, near.hits)
        self.is_occupied = ~self.is_uncertain & (near.hits > 0) & (log_ratio > 0.0)
        """(k,) True for kinds with a hostile in every cell"""

    def draw(self, rng: np.random.Generator, n_worlds: int) -> NDArray[np.int64]:
        """Return (worlds, uncertain kinds) numbers of hostiles in the cells of each kind."""
        n_kinds = int(np.count_nonzero(self.is_uncertain))
        if self._groups is None or n_kinds == 0:
            return np.zeros((n_worlds, n_kinds), dtype=np.int64)
        return self._groups.draw(rng, n_worlds, n_kinds)


def _in_reach(shape: tuple[int, ...], cells: Sequence[Cell]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (m,) cells from which a hostile can hit a vehicle on a route, as row · cols + col.

    Also return (m, 3) numbers of entries into the hostile's cell, an adjacent cell, and a diagonal cell.
    """
    rows, cols = shape
    entered = np.array(cells[1:], dtype=np.int64).reshape(-1, 1, 2)
    is_outside = ((entered < 0) | (entered >= (rows, cols))).any(axis=2)
    if is_outside.any():
        row, col = (int(index) for index in entered[is_outside][0])
        raise ValueError(f"the route enters cell ({row}, {col}), outside the area of {rows} × {cols} cells")
    around = entered + np.array([(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)])
    steps = np.abs(around - entered).sum(axis=2)
    inside = ((around >= 0) & (around < (rows, cols))).all(axis=2)
    reached, which = np.unique((around @ (cols, 1))[inside], return_inverse=True)
    entries = np.bincount(3 * which + steps[inside], minlength=3 * reached.size)
    return reached, entries.reshape(-1, 3)


def _survival(strength: FiringStrength, entries: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (k,) probabilities of surviving one hostile; `entries` (k, 3) as from `_in_reach`."""
    fs = np.array([strength.direct, strength.first_neighbour, strength.second_neighbour])
    return np.asarray(np.prod((1.0 - fs) ** entries, axis=1))
