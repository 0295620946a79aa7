"""Random planning areas, the same for the same seed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.exposure import exposure
from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.replan import Layers

STRENGTH = FiringStrength(0.6, 0.3, 0.1)
DENSITY = 0.06
"""hostiles in a cell, as in the paper: 24 in 400 cells"""


def random_field(side: int, seed: int = 0) -> NDArray[np.float64]:
    """Return independent random costs, (side, side), which are harder to search than any belief."""
    return np.random.default_rng(seed).random((side, side)) * 0.3


def observed_field(side: int, seed: int = 0) -> NDArray[np.float64]:
    """Return P_s, (side, side), after random 3 × 3 observations of a sixth of the cells (Eq. 3, 4)."""
    rng = np.random.default_rng(seed)
    occupied = np.full((side, side), DENSITY)
    for row, col in rng.integers(1, side - 1, (side * side // 50, 2)):
        occupied[row - 1 : row + 2, col - 1 : col + 2] = rng.random((3, 3)) < DENSITY
    return exposure(occupied, STRENGTH)


class Crossing:
    """A vehicle half-way across an area, the hidden hostiles, and P_s in the layers of a replanner.

    seen_share: share of the cells observed at the start, without overlaps of the observations.
    """

    def __init__(self, side: int, goal: Cell, seen_share: float, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        shape = (side, side)
        self._truth = self._rng.random(shape) < DENSITY
        self._seen = np.zeros(shape, dtype=bool)
        for row, col in self._rng.integers(1, side - 1, (int(seen_share * side * side / 9), 2)):
            self._seen[row - 1 : row + 2, col - 1 : col + 2] = True
        self.position, self.goal = (side // 2, side // 2), goal
        self.layers = Layers(self._exposure_to(self._truth & self._seen), self._exposure_to(~self._seen), 0.0)
        self._update_p_unseen()

    def observe(self, *, anywhere: bool) -> list[Cell]:
        """Observe around the vehicle or anywhere, and return the cells whose layers changed."""
        row, col = self._rng.integers(0, self._seen.shape[0], 2).tolist() if anywhere else self.position
        near, wide = self._square_around(row, col, 1), self._square_around(row, col, 3)
        if self._seen[near].all():
            return []
        self._seen[near] = True
        known, unseen = (
            self._exposure_to((self._truth & self._seen)[wide]),
            self._exposure_to(~self._seen[wide]),
        )
        changed, inner = (
            self._square_around(row, col, 2),
            tuple(
                slice(max(i - 2, 0) - max(i - 3, 0), None if i + 3 >= n else -1)
                for i, n in zip((row, col), self._seen.shape, strict=True)
            ),
        )
        self.layers.known[changed], self.layers.unseen[changed] = known[inner], unseen[inner]
        self._update_p_unseen()
        return [(r, c) for r in range(*_bounds(changed[0])) for c in range(*_bounds(changed[1]))]

    def _update_p_unseen(self) -> None:
        remaining = int((self._truth & ~self._seen).sum())
        self.layers.p_unseen = remaining / max(int((~self._seen).sum()), 1)

    def _square_around(self, row: int, col: int, reach: int) -> tuple[slice, slice]:
        rows, cols = self._seen.shape
        return (
            slice(max(row - reach, 0), min(row + reach + 1, rows)),
            slice(max(col - reach, 0), min(col + reach + 1, cols)),
        )

    @staticmethod
    def _exposure_to(cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        return np.asarray(ndimage.correlate(cells.astype(float), STRENGTH.kernel, mode="constant"))


def _bounds(part: slice) -> tuple[int, int]:
    return part.start, part.stop
