"""The 8-connected lattice as compiled code sees it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
Bytes = NDArray[np.uint8]

ROOT2 = math.sqrt(2.0)


@njit(nogil=True, cache=True)
def offsets_of(width: int) -> Ints:
    """OFFSETS: the straight steps E, N, W, S, then the diagonal ones NE, NW, SW, SE."""
    return np.array([1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1])


@njit(nogil=True, cache=True)
def squeezes(enter: Floats, offsets: Ints, m: int, k: int) -> bool:
    """Whether the diagonal step from m in direction k (4 to 7) leads past the corner of a wall."""
    # DEVIATION: the paper's lattice has every diagonal edge. A vehicle of finite size that flies one passes
    # over the corner of both cells beside it, so it is no way where either is a wall. Who stands in a wall
    # may leave it all the same, in any direction: getting out comes first.
    beside, other = m + offsets[k - 4], m + offsets[(k - 3) & 3]
    return bool(enter[m] != np.inf and (enter[beside] == np.inf or enter[other] == np.inf))
