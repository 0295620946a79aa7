"""Planning areas drawn by seed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.exposure import exposure
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.replan import Layers

STRENGTH = FiringStrength(0.6, 0.3, 0.1)
DENSITY = 0.06
"""hostiles a cell, as in the model: 24 in 400"""
Cell = tuple[int, int]


def random_field(side: int, seed: int = 0) -> NDArray[np.float64]:
    """Return independent random cells, which are harder for a search than any real belief."""
    return np.random.default_rng(seed).random((side, side)) * 0.3


def observed(side: int, seed: int = 0) -> NDArray[np.float64]:
    """Return P_s after 3 × 3 observations of a sixth of the cells with hostiles among them (Eq. 3, 4)."""
    rng = np.random.default_rng(seed)
    occupied = np.full((side, side), DENSITY)
    for row, col in rng.integers(1, side - 1, (side * side // 50, 2)):
        occupied[row - 1 : row + 2, col - 1 : col + 2] = rng.random((3, 3)) < DENSITY
    return exposure(occupied, STRENGTH)


class Crossing:
    """A vehicle half-way across, unknown hostiles, and the knowledge of them in layers."""

    def __init__(self, side: int, goal: Cell, seen: float, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        shape = (side, side)
        self._truth = self._rng.random(shape) < DENSITY
        self._seen = np.zeros(shape, dtype=bool)
        for row, col in self._rng.integers(1, side - 1, (int(seen * side * side / 9), 2)):
            self._seen[row - 1 : row + 2, col - 1 : col + 2] = True
        self.position, self.goal = (side // 2, side // 2), goal
        self.layers = Layers(self._around(self._truth & self._seen), self._around(~self._seen), 0.0)
        self._share()

    def observe(self, *, anywhere: bool) -> list[Cell]:
        """Observe around the vehicle or anywhere, and return the cells whose layers changed."""
        row, col = self._rng.integers(0, self._seen.shape[0], 2).tolist() if anywhere else self.position
        near, wide = self._square(row, col, 1), self._square(row, col, 3)
        if self._seen[near].all():
            return []
        self._seen[near] = True
        known, unseen = self._around((self._truth & self._seen)[wide]), self._around(~self._seen[wide])
        changed, inner = (
            self._square(row, col, 2),
            tuple(
                slice(max(i - 2, 0) - max(i - 3, 0), None if i + 3 >= n else -1)
                for i, n in zip((row, col), self._seen.shape, strict=True)
            ),
        )
        self.layers.known[changed], self.layers.unseen[changed] = known[inner], unseen[inner]
        self._share()
        return [(r, c) for r in range(*_ends(changed[0])) for c in range(*_ends(changed[1]))]

    def _share(self) -> None:
        left = int((self._truth & ~self._seen).sum())
        self.layers.p_unseen = left / max(int((~self._seen).sum()), 1)

    def _square(self, row: int, col: int, reach: int) -> tuple[slice, slice]:
        rows, cols = self._seen.shape
        return (
            slice(max(row - reach, 0), min(row + reach + 1, rows)),
            slice(max(col - reach, 0), min(col + reach + 1, cols)),
        )

    @staticmethod
    def _around(cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        return np.asarray(ndimage.correlate(cells.astype(float), STRENGTH.kernel, mode="constant"))


def _ends(part: slice) -> tuple[int, int]:
    return part.start, part.stop
