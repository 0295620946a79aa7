"""The probability that a hostile holds a cell, given all looks: the paper's Eq. 4, and Bayes beyond it.

Cells that were looked at equally often with equally many hits are alike: a class. Every function here takes
the classes of a whole area; the same class may come in several parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

from swarmctl.core.inference.conditional import HostileGroups
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SURE_SIGMA = 1.645
"""how far above what was announced the number found must lie: one-sided 95 % of a normal distribution"""


@dataclass(frozen=True, slots=True, eq=False)
class CellClasses:
    """Cells that are alike by what was seen of them."""

    looks: Ints
    """(k,) looks at each cell of a class"""
    hits: Ints
    """(k,) of which this many showed a hostile"""
    n_cells: Ints
    """(k,) cells in it, at least 1"""

    @property
    def total(self) -> int:
        return int(self.n_cells.sum())


def eq4(n_hostiles: int, classes: CellClasses) -> Floats:
    """p_O (k,) by Eq. 4: 1 where a hostile was seen, 0 where none was, (n_HA − n_V)/(n_C − v) elsewhere.

    For sensors that do not err, and a number of hostiles that is announced.
    """
    unseen, held = classes.looks == 0, classes.hits > 0
    left = int(classes.n_cells[unseen].sum())  # n_C - v
    n_found = int(classes.n_cells[held].sum())  # n_V
    # DEVIATION: Eq. 4 has no value once v = n_C, and leaves [0, 1] when the announced count was wrong.
    p_unseen = min(max((n_hostiles - n_found) / left, 0.0), 1.0) if left else 0.0  # Eq. 4
    return np.where(unseen, p_unseen, np.where(held, 1.0, 0.0))


def bayes(count: HostileCount, sensor: SensorModel, classes: CellClasses) -> Floats:
    """p_O (k,), the posterior probability: hostiles lie anywhere with equal chance, one a cell at most, their
    number as `count` has it, and looks err as `sensor` does. Exact to rounding; Eq. 4 is its limit.

    Every look informs every cell: what is less likely to hide where it was looked for is likelier elsewhere.
    """
    open_cells, groups = posterior(count, sensor, classes)
    p = np.where(sensor.log_ratio(classes.looks, classes.hits) > 0.0, 1.0, 0.0)
    if groups is not None:
        p[open_cells] = np.clip(groups.means() / classes.n_cells[open_cells], 0.0, 1.0)
    return p


def posterior(
    count: HostileCount, sensor: SensorModel, classes: CellClasses
) -> tuple[NDArray[np.bool_], HostileGroups | None]:
    """Which classes are not certain (k,), and how many hostiles each of those holds: None where there is
    none.

    Where more hostiles are sure than can be, or fewer cells are left than hostiles must be, the nearest
    number that fits is taken, as Eq. 4 is clamped to [0, 1].
    """
    log_ratio = sensor.log_ratio(classes.looks, classes.hits)
    open_cells = np.isfinite(log_ratio)
    n_sure = int(classes.n_cells[log_ratio == np.inf].sum())
    left = int(classes.n_cells[open_cells].sum())
    if not left:
        return open_cells, None
    fits = (count.n >= n_sure) & (count.n <= n_sure + left)
    if fits.any():
        n, log_prior = count.n[fits], count.log_weight[fits]
    else:
        n = np.array([min(max(count.least, n_sure), n_sure + left)])
        log_prior = np.zeros(1)
    total = classes.total
    # Given n, each of the C(total, n) sets of cells is as likely as any other.
    log_sets = gammaln(total + 1) - gammaln(n + 1) - gammaln(total - n + 1)
    in_open = classes.n_cells[open_cells]
    return open_cells, HostileGroups(log_ratio[open_cells], in_open, n - n_sure, log_prior - log_sets)


def announced_too_low(count: HostileCount, sensor: SensorModel, classes: CellClasses) -> bool:
    """Whether more hostiles were found than can be: for sure, or with 95 % where sensors err.

    Each cell is judged by its own looks alone, at the odds announced for a cell: a posterior under `count`
    could never hold more hostiles than `count` allows.
    """
    log_ratio = sensor.log_ratio(classes.looks, classes.hits)
    # Half a hostile and half a clear cell more, so that an announcement of none, or of all, can be wrong too.
    prior = (count.mean + 0.5) / (classes.total + 1.0)
    seen = classes.looks > 0
    log_odds = log_ratio[seen] + np.log(prior) - np.log1p(-prior)
    p, n_cells = expit(log_odds), classes.n_cells[seen]
    found, variance = float(p @ n_cells), float((p * expit(-log_odds)) @ n_cells)
    return bool(found - SURE_SIGMA * math.sqrt(variance) > count.greatest)
