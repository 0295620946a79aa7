"""Straight tracks over the cells: the cells crossed, the length over each, and the exposure.

Points are (x, y) in cells from the south-west corner of cell (0, 0). The centre of cell (row, col) is
(col + 0.5, row + 0.5).

Eq. 5 has no measure of exposure for a track between cells. There are two:

entered
    ΣP_s over the cells that a track enters, as in Eq. 5 and as strikes are drawn. A cell counts once for each
    entry, even for a short crossing. A track through a corner enters only the diagonal cell, like a diagonal
    step. A straight track at a skew angle enters more cells than the lattice route beside it.
integral
    ∫ P_s ds along the track [cells], which counts the length and not the number of cells.

The measures also differ on a lattice route: a diagonal step enters one cell over a length of √2 cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.core.planar import PlanarPoint, distance_to_leg

Floats = NDArray[np.float64]
GridPoint = tuple[float, float]

CORNER_LENGTH = 1e-9
"""Length between two crossings of grid lines below which both count as one crossing of a corner [cells]. On
legs between centres up to 10 000 cells apart, different crossings are at least 5e-5 cells apart."""

WALL_MARGIN = 0.1
"""Least distance of a track from the corner of a wall [cells], for errors of position and of following.
Between the centres of neighbouring cells a track comes near a wall only at a corner."""

MIN_SURVIVAL = 1e-12
"""Least value of 1 − P_s, so that its logarithm is finite; P_s may reach or exceed 1."""


def centre(cell: Cell) -> GridPoint:
    return cell[1] + 0.5, cell[0] + 0.5


class CrossedCells(msgspec.Struct, frozen=True):
    """The cells under a track in the order flown, once for each visit, with the length over each [cells]."""

    cells: tuple[Cell, ...]
    lengths: tuple[float, ...]
    legs: tuple[int, ...]
    """index of the leg on which each cell was entered"""


def crossed_cells(points: Sequence[GridPoint]) -> CrossedCells:
    """Return the cells that straight legs cross. A leg along a grid line is in the north or east cells."""
    cells: list[Cell] = []
    lengths: list[float] = []
    legs: list[int] = []
    for leg, (a, b) in enumerate(pairwise(points)):
        for cell, length in zip(*_crossed(a, b), strict=True):
            if cells and cells[-1] == cell:
                lengths[-1] += length
            else:
                cells.append(cell)
                lengths.append(length)
                legs.append(leg)
    if not cells and points:
        (x, y) = points[0]
        return CrossedCells(((math.floor(y), math.floor(x)),), (0.0,), (0,))
    return CrossedCells(tuple(cells), tuple(lengths), tuple(legs))


def cells_under(path_m: Sequence[PlanarPoint], cell_size_m: float) -> tuple[Cell, ...]:
    """Return the cells that a path crosses, in the order flown; points (east, north) are local [m]."""
    return crossed_cells([(east_m / cell_size_m, north_m / cell_size_m) for east_m, north_m in path_m]).cells


def _crossed(a: GridPoint, b: GridPoint) -> tuple[list[Cell], list[float]]:
    length = math.dist(a, b)
    if length == 0.0:
        return [], []
    shares = np.concatenate(([0.0, 1.0], _crossings(a[0], b[0]), _crossings(a[1], b[1])))
    shares.sort()
    # Two crossings at a corner count as one crossing, without a piece between them.
    pieces = np.flatnonzero(np.diff(shares) * length > CORNER_LENGTH)
    middle = (shares[pieces] + shares[pieces + 1]) / 2.0
    cols = np.floor(a[0] + middle * (b[0] - a[0])).astype(int)
    rows = np.floor(a[1] + middle * (b[1] - a[1])).astype(int)
    lengths = (shares[pieces + 1] - shares[pieces]) * length
    return list(zip(rows.tolist(), cols.tolist(), strict=True)), lengths.tolist()


def _crossings(here: float, there: float) -> Floats:
    """Return the grid lines between two coordinates, as shares of the distance."""
    if here == there:
        return np.empty(0)
    low, high = min(here, there), max(here, there)
    lines = np.arange(math.floor(low) + 1, math.ceil(high), dtype=np.float64)
    return (lines - here) / (there - here)


class ThreatMap(msgspec.Struct, frozen=True, eq=False):
    """P_s in the forms that measures of tracks need. Infinite P_s counts as 0; `is_clear` avoids walls."""

    p_s: Floats
    """(rows, cols), finite"""
    hazard: Floats
    """−ln(1 − P_s), (rows, cols), finite; its sum over a route is −ln of the safety factor"""
    blocked: NDArray[np.bool_]
    """(rows, cols): cells that may not be entered"""

    @classmethod
    def of(cls, p_s: Floats, max_exposure: float = math.inf) -> ThreatMap:
        """Return the map for `p_s` (rows, cols); cells above `max_exposure` and infinite cells are walls."""
        blocked = ~np.isfinite(p_s) | (p_s > max_exposure)
        finite = np.where(np.isfinite(p_s), p_s, 0.0)
        return cls(finite, -np.log(np.maximum(1.0 - finite, MIN_SURVIVAL)), blocked)

    def entered(self, cells: Sequence[Cell]) -> Floats:
        """Return (2,): ΣP_s and Σ −ln(1 − P_s) over cells that are entered."""
        rows, cols = _indices(cells)
        return np.array([self.p_s[rows, cols].sum(), self.hazard[rows, cols].sum()])

    def integral(self, cells: Sequence[Cell], lengths: Sequence[float]) -> Floats:
        """Return (2,): ∫ P_s ds and ∫ −ln(1 − P_s) ds over cells and the length over each [cells]."""
        rows, cols = _indices(cells)
        return np.array([self.p_s[rows, cols] @ lengths, self.hazard[rows, cols] @ lengths])


def _indices(cells: Sequence[Cell]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    array = np.array(cells, dtype=np.int64).reshape(-1, 2)
    return array[:, 0], array[:, 1]


def is_clear(threat: ThreatMap, points: Sequence[GridPoint], margin: float = WALL_MARGIN) -> bool:
    """Return whether a track enters no wall and keeps `margin` [cells] from the corners of walls.

    The first cell does not count as a wall, so that a vehicle may leave a wall.
    """
    rows, cols = threat.blocked.shape
    begin = crossed_cells(points).cells[0]

    def is_wall(row: int, col: int) -> bool:
        inside = 0 <= row < rows and 0 <= col < cols
        return inside and (row, col) != begin and bool(threat.blocked[row, col])

    for a, b in pairwise(points):
        cells = crossed_cells((a, b)).cells
        if any(is_wall(*cell) for cell in cells):
            return False
        # A corner within the margin is a corner of a cell under the track.
        for y, x in {(row + up, col + right) for row, col in cells for up in (0, 1) for right in (0, 1)}:
            around = ((y - 1, x - 1), (y - 1, x), (y, x - 1), (y, x))
            if (
                any(is_wall(*cell) for cell in around)
                and distance_to_leg((x, y), a, b) <= margin + CORNER_LENGTH
            ):
                return False
    return True
