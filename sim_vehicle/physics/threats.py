"""Strikes: hostiles fire at vehicles whose true position enters a cell (Eq. 1 in docs/paper.md)."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats

Ints = npt.NDArray[np.int64]
OUTSIDE = -1


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

    def cells(self, position_m: Floats) -> Ints:
        """Return the cell indices (row * cols + col) of positions (n, 3) [m]; OUTSIDE beyond the area."""
        col = np.floor(position_m[:, 0] / self._cell_size_m).astype(np.int64)
        row = np.floor(position_m[:, 1] / self._cell_size_m).astype(np.int64)
        inside = (row >= 0) & (row < self._rows) & (col >= 0) & (col < self._cols)
        return np.where(inside, row * self._cols + col, OUTSIDE)

    def row_col(self, cell: int) -> tuple[int, int]:
        return divmod(cell, self._cols)

    def fire(self, cell: int, rng: np.random.Generator) -> list[tuple[int, int]]:
        """Return the hostiles that hit a vehicle entering `cell`; each hostile in range draws once."""
        row, col = self.row_col(cell)
        hits = []
        for row_step in (-1, 0, 1):
            for col_step in (-1, 0, 1):
                hostile = (row + row_step, col + col_step)
                if hostile in self._hostiles:
                    strength = self._strength_by_steps[abs(row_step) + abs(col_step)]
                    if rng.random() < strength:
                        hits.append(hostile)
        return hits
