"""Strikes: hostiles fire at vehicles whose true position enters a cell (Eq. 1 in docs/paper.md)."""

from collections.abc import Sequence

import numpy as np

from sim_vehicle.physics.geodesy import Floats

OUTSIDE = -1  # row and column of a vehicle on the ground


class Threats:
    """The cells of the area and its hostiles; row 0 is the south edge, column 0 the west edge.

    Parameters
    ----------
    rows, cols, cell_size_m: the area; its south-west corner is the local origin.
    firing_strength: probability of a hit in the hostile's cell, its 4 adjacent and its 4 diagonal cells.
    hostiles: (row, col) of each hostile.
    """

    def __init__(
        self,
        rows: int,
        cols: int,
        cell_size_m: float,
        firing_strength: tuple[float, float, float],
        hostiles: Sequence[tuple[int, int]],
    ) -> None:
        self._rows, self._cols, self._cell_size_m = rows, cols, cell_size_m
        self._strength_by_steps = firing_strength
        self._hostiles = frozenset(hostiles)

    def cells(self, position: Floats) -> Floats:
        """Return columns and rows, (2, n), of positions (3, n) [m]; also of positions beyond the area."""
        return np.floor(position[:2] / self._cell_size_m)

    def contains(self, row: int, col: int) -> bool:
        """Return True for a cell of the area."""
        return 0 <= row < self._rows and 0 <= col < self._cols

    def fire(self, row: int, col: int, rng: np.random.Generator) -> list[tuple[int, int]]:
        """Return the hostiles that hit a vehicle entering a cell; each hostile in range draws once."""
        hits = []
        for row_step in (-1, 0, 1):
            for col_step in (-1, 0, 1):
                hostile = (row + row_step, col + col_step)
                if hostile in self._hostiles:
                    strength = self._strength_by_steps[abs(row_step) + abs(col_step)]
                    if rng.random() < strength:
                        hits.append(hostile)
        return hits
