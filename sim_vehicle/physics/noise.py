"""Standard normal draws for a whole fleet, with one generator per vehicle.

The sequence of a vehicle depends only on its generator, not on the size of the fleet. Draws are made a block
ahead. Each call of `take` draws a part of the next block, so that no call takes long.
"""

from collections.abc import Sequence

import numpy as np

from sim_vehicle.physics.geodesy import Floats

BLOCK = 64  # rows per block


class Normals:
    """Draws for all vehicles; `take()` returns the next `width` draws of each vehicle, (width, n)."""

    def __init__(self, rngs: Sequence[np.random.Generator], width: int) -> None:
        self._rngs, self._width = rngs, width
        self._current = np.zeros((BLOCK, width, len(rngs)))
        self._next = np.zeros((BLOCK, width, len(rngs)))
        self._used = 0
        self._fill(self._current, 0, len(rngs))

    def take(self) -> Floats:
        """Return the next draws, (width, n)."""
        n = len(self._rngs)
        self._fill(self._next, n * self._used // BLOCK, n * (self._used + 1) // BLOCK)
        row: Floats = self._current[self._used].copy()
        self._used += 1
        if self._used == BLOCK:
            self._current, self._next, self._used = self._next, self._current, 0
        return row

    def _fill(self, block: Floats, first: int, end: int) -> None:
        for i in range(first, end):
            block[:, :, i] = self._rngs[i].standard_normal((BLOCK, self._width))
