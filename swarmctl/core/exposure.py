"""The exposure of each cell (Eq. 2 and 3), and the measures of a route."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength

RouteCells = Sequence[Cell] | NDArray[np.int64]
"""The cells of a route; as an (n, 2) array to save conversions for several sums over a route."""


def exposure(p_occupied: NDArray[np.float64], strength: FiringStrength) -> NDArray[np.float64]:
    """Return P_s of every cell, shape (rows, cols): Eq. 3, and Eq. 2 if p_O is 0 or 1 everywhere.

    Cells on the border have fewer neighbours, so at equal p_O their P_s is lower: no threat is outside.

    ERRATUM: the paper calls P_s a probability. It is a sum over threats and may exceed 1: nine occupied
    cells at 0.9/0.5/0.3 give 4.1.
    """
    # Eq. 3; the kernel is symmetric, so correlation equals convolution.
    return ndimage.correlate(p_occupied, strength.kernel, output=np.float64, mode="constant", cval=0.0)


def prior_inner_exposure(rows: int, cols: int, n_hostiles: float, strength: FiringStrength) -> float:
    """Return P_s of a cell away from the border before the first observation.

    This is the default ψ per cell: for w = 0.5 a cell of length costs as much as a cell of unknown threat.
    """
    return n_hostiles / (rows * cols) * float(strength.kernel.sum())


def length_cells(cells: RouteCells) -> float:
    """Return the length of a route [cells], √2 for a diagonal step.

    Raises ValueError if two consecutive cells are not neighbours.
    """
    route = np.asarray(cells, dtype=np.int64).reshape(-1, 2)
    steps = np.abs(np.diff(route, axis=0))
    diagonal = steps[:, 0] * steps[:, 1]
    if (wrong := np.flatnonzero(steps.sum(axis=1) != 1 + diagonal)).size or diagonal.max(initial=0) > 1:
        here = int(wrong[0]) if wrong.size else int(np.argmax(diagonal))
        wrong_step = " to ".join(str(tuple(cell)) for cell in route[here : here + 2].tolist())
        raise ValueError(f"{wrong_step} is no step between neighbouring cells")
    n_diagonal = int(diagonal.sum())
    return len(steps) - n_diagonal + n_diagonal * math.sqrt(2.0)


def exposure_sum(p_s: NDArray[np.float64], cells: RouteCells) -> float:
    """Return ΣP_s over a route without its start cell and with its goal: the exposure part of Eq. 5.

    ERRATUM: the paper says that the path of least ΣP_s has the greatest safety factor too. That is not always
    so: one cell of 0.50 has the smaller sum, but two cells of 0.26 have the greater safety factor.
    """
    return math.fsum(_entered(p_s, cells))


def safety_factor(p_s: NDArray[np.float64], cells: RouteCells) -> float:
    """Return ∏(1 − P_s) over a route without its start cell and with its goal; P_s is clipped to 1.

    ERRATUM: the paper treats this factor as the survival probability. But neighbouring cells are exposed to
    the same unknown hostile, so their hits are not independent. Example: a straight crossing of 20 × 20 cells
    with 24 hostiles at 0.6/0.3/0.1 has a survival probability of about 0.13 and a factor of 0.07.
    """
    return math.prod(1.0 - min(value, 1.0) for value in _entered(p_s, cells))


def _entered(p_s: NDArray[np.float64], cells: RouteCells) -> list[float]:
    """Return P_s of the cells after the first, with one array access, because single accesses are slow."""
    rows, cols = np.asarray(cells, dtype=np.int64).reshape(-1, 2)[1:].T
    entered: list[float] = p_s[rows, cols].tolist()
    return entered
