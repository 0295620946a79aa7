"""Standard normal draws for a whole fleet, each vehicle's from its own generator.

A vehicle's sequence depends on its generator only, not on the size of the fleet. Rows are drawn a block
ahead. The draws of the next block are spread over the use of the present one, so that no step takes long.
"""

from collections.abc import Sequence

import numpy as np

from sim_vehicle.physics.geodesy import Floats

BLOCK = 64  # draws ahead


class Normals:
    """Draws for all vehicles; `take()` returns the next `width` draws of each vehicle, (width, n)."""

    def __init__(self, rngs: Sequence[np.random.Generator], width: int) -> None:
        self._rngs, self._width = rngs, width
        self._present = np.zeros((BLOCK, width, len(rngs)))
        self._coming = np.zeros((BLOCK, width, len(rngs)))
        self._used = 0
        self._fill(self._present, 0, len(rngs))

    def take(self) -> Floats:
        """Return the next draws, (width, n)."""
        n = len(self._rngs)
        self._fill(self._coming, n * self._used // BLOCK, n * (self._used + 1) // BLOCK)
        row: Floats = self._present[self._used].copy()
        self._used += 1
        if self._used == BLOCK:
            self._present, self._coming, self._used = self._coming, self._present, 0
        return row

    def _fill(self, block: Floats, first: int, end: int) -> None:
        for i in range(first, end):
            block[:, :, i] = self._rngs[i].standard_normal((BLOCK, self._width))
