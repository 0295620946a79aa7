"""The threat over each cell (Eq. 2 and 3) and what a route through it adds up to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength


def exposure(p_occupied: NDArray[np.float64], strength: FiringStrength) -> NDArray[np.float64]:
    """P_s over every cell, shape (rows, cols): Eq. 3, and Eq. 2 where p_O is 0 or 1 everywhere.

    A threat outside the area does not exist, so cells on the border have fewer neighbours and a lower P_s.

    ERRATUM: the paper calls this a probability. It is a sum over threats and may exceed 1: nine occupied
    cells at 0.9/0.5/0.3 give 4.1.
    """
    # Eq. 3; the kernel is symmetric, so correlation and convolution are one.
    return ndimage.correlate(p_occupied, strength.kernel, output=np.float64, mode="constant", cval=0.0)


def prior_inner_exposure(rows: int, cols: int, n_hostiles: float, strength: FiringStrength) -> float:
    """P_s of a cell away from the border before anything was observed.

    This is the default ψ per cell: one cell of way then weighs as much as one cell of unknown threat.
    """
    return n_hostiles / (rows * cols) * float(strength.kernel.sum())


def length_cells(cells: Sequence[Cell]) -> float:
    """Length of a route [cells], √2 for a diagonal step.

    Raises ValueError where two cells in a row are no neighbours.
    """
    straight = diagonal = 0
    for (row, col), (next_row, next_col) in pairwise(cells):
        match abs(next_row - row) + abs(next_col - col), max(abs(next_row - row), abs(next_col - col)):
            case 1, 1:
                straight += 1
            case 2, 1:
                diagonal += 1
            case _:
                raise ValueError(
                    f"{(row, col)} to {(next_row, next_col)} is no step between neighbouring cells"
                )
    return straight + diagonal * math.sqrt(2.0)


def exposure_sum(p_s: NDArray[np.float64], cells: Sequence[Cell]) -> float:
    """ΣP_s over a route, the start cell left out and the goal counted: the exposure part of Eq. 5.

    ERRATUM: the paper holds that the path of least ΣP_s has the greatest safety factor too. It need not:
    one cell of 0.50 has the smaller sum, two cells of 0.26 the better chance.
    """
    return math.fsum(float(p_s[cell]) for cell in cells[1:])


def safety_factor(p_s: NDArray[np.float64], cells: Sequence[Cell]) -> float:
    """∏(1 − P_s) over a route, the start cell left out and the goal counted; P_s is clipped to 1.

    ERRATUM: the paper takes this for the chance of getting through. Neighbouring cells are exposed to the
    same unknown hostile, so they are not independent and the true survival differs (about 0.13 where this
    says 0.07, on a straight crossing of 20 × 20 cells with 24 hostiles at 0.6/0.3/0.1).
    """
    return math.prod(1.0 - min(float(p_s[cell]), 1.0) for cell in cells[1:])
