"""Standard normal draws for a whole fleet, with one generator per vehicle.

The draws of a vehicle depend only on its generator, not on the size of the fleet. No call takes long: each
call of `take` reads a row of the current block and fills a part of the next block.
"""

from collections.abc import Sequence

import numpy as np

from sim_vehicle.physics.geodesy import Floats

BLOCK_ROWS = 64


class Normals:
    """Standard normal draws for n vehicles, `width` draws of each vehicle at a time."""

    def __init__(self, rngs: Sequence[np.random.Generator], width: int) -> None:
        self._rngs, self._width = rngs, width
        self._current = np.zeros((BLOCK_ROWS, width, len(rngs)))
        self._next = np.zeros((BLOCK_ROWS, width, len(rngs)))
        self._used = 0
        self._fill(self._current, 0, len(rngs))

    def take(self) -> Floats:
        """Return the next draws, (width, n)."""
        n = len(self._rngs)
        self._fill(self._next, n * self._used // BLOCK_ROWS, n * (self._used + 1) // BLOCK_ROWS)
        row: Floats = self._current[self._used].copy()
        self._used += 1
        if self._used == BLOCK_ROWS:
            self._current, self._next, self._used = self._next, self._current, 0
        return row

    def _fill(self, block: Floats, first: int, end: int) -> None:
        for i in range(first, end):
            block[:, :, i] = self._rngs[i].standard_normal((BLOCK_ROWS, self._width))
