"""The probability that a hostile holds a cell, given all looks: the paper's Eq. 4, and Bayes' rule.

The cells of a class have equal numbers of looks and hits; two classes may have the same numbers. Every
function takes the classes of a whole area.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

from swarmctl.core.inference.conditional import HostileGroups
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SURE_SIGMA = 1.645
"""least excess of the found over the announced number [standard deviations]: one-sided 95 %, normal"""


class CellClasses(msgspec.Struct, frozen=True, eq=False):
    """Classes of cells with equal looks and hits."""

    looks: Ints
    """(k,) looks at each cell of a class"""
    hits: Ints
    """(k,) looks that showed a hostile"""
    n_cells: Ints
    """(k,) cells in the class, at least 1"""

    @property
    def total(self) -> int:
        return int(self.n_cells.sum())


def eq4(n_hostiles: int, classes: CellClasses) -> Floats:
    """Return p_O (k,) by Eq. 4: 1 for a seen hostile, 0 for a seen clear cell, else (n_HA − n_V)/(n_C − v).

    Eq. 4 holds for perfect sensors and an announced number of hostiles.
    """
    unseen, held = classes.looks == 0, classes.hits > 0
    n_unseen = int(classes.n_cells[unseen].sum())  # n_C - v
    n_found = int(classes.n_cells[held].sum())  # n_V
    # DEVIATION: Eq. 4 has no value once v = n_C, and leaves [0, 1] when the announced count was wrong.
    p_unseen = min(max((n_hostiles - n_found) / n_unseen, 0.0), 1.0) if n_unseen else 0.0  # Eq. 4
    return np.where(unseen, p_unseen, np.where(held, 1.0, 0.0))


def bayes(count: HostileCount, sensor: SensorModel, classes: CellClasses) -> Floats:
    """Return the posterior probability p_O (k,), exact to rounding. Eq. 4 is a special case.

    A priori, every placement of the same number of hostiles is equally likely, with at most one in a cell. A
    look can change p_O of every cell: fewer hostiles in some cells mean more hostiles elsewhere.
    """
    is_uncertain, groups = posterior(count, sensor, classes)
    p = np.where(sensor.log_ratio(classes.looks, classes.hits) > 0.0, 1.0, 0.0)
    if groups is not None:
        p[is_uncertain] = np.clip(groups.means() / classes.n_cells[is_uncertain], 0.0, 1.0)
    return p


def posterior(
    count: HostileCount, sensor: SensorModel, classes: CellClasses
) -> tuple[NDArray[np.bool_], HostileGroups | None]:
    """Return the mask (k,) of uncertain classes, and their hostiles' distribution; None if all are certain.

    If all numbers of `count` contradict the certain cells, the number of hostiles is taken as `count.least`,
    clipped to the numbers that the certain cells allow.
    """
    log_ratio = sensor.log_ratio(classes.looks, classes.hits)
    is_uncertain = np.isfinite(log_ratio)
    n_certain = int(classes.n_cells[log_ratio == np.inf].sum())
    n_uncertain = int(classes.n_cells[is_uncertain].sum())
    if not n_uncertain:
        return is_uncertain, None
    fits = (count.n >= n_certain) & (count.n <= n_certain + n_uncertain)
    if fits.any():
        n, log_prior = count.n[fits], count.log_weight[fits]
    else:
        n = np.array([min(max(count.least, n_certain), n_certain + n_uncertain)])
        log_prior = np.zeros(1)
    total = classes.total
    # For a given n all C(total, n) sets of cells are equally likely.
    log_sets = gammaln(total + 1) - gammaln(n + 1) - gammaln(total - n + 1)
    n_cells = classes.n_cells[is_uncertain]
    return is_uncertain, HostileGroups(log_ratio[is_uncertain], n_cells, n - n_certain, log_prior - log_sets)


def announced_too_low(count: HostileCount, sensor: SensorModel, classes: CellClasses) -> bool:
    """Return whether more hostiles were found than announced; with 95 % confidence for sensors that err.

    The posterior of each cell follows from the looks at this cell alone, with the announced odds as prior. A
    posterior under `count` cannot show an excess, because `count` limits the number of hostiles.
    """
    log_ratio = sensor.log_ratio(classes.looks, classes.hits)
    # Half a hostile and half a clear cell are added, so that an announcement of none or of all can be wrong.
    prior = (count.mean + 0.5) / (classes.total + 1.0)
    seen = classes.looks > 0
    log_odds = log_ratio[seen] + np.log(prior) - np.log1p(-prior)
    p, n_cells = expit(log_odds), classes.n_cells[seen]
    found, variance = float(p @ n_cells), float((p * expit(-log_odds)) @ n_cells)
    return bool(found - SURE_SIGMA * math.sqrt(variance) > count.greatest)
