"""The 8-connected lattice as compiled code sees it, and a heap."""

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


@njit(nogil=True, cache=True)
def offered(label: Floats, extra: float, width: int, m: int) -> float:
    """The least that any neighbour of m offers, `extra` more across; where there are no walls."""
    near = min(label[m - 1], label[m + 1], label[m - width], label[m + width])
    low = min(label[m - width - 1], label[m - width + 1])
    high = min(label[m + width - 1], label[m + width + 1])
    return float(min(near, min(low, high) + extra))


@njit(nogil=True, cache=True)
def push(cells: Ints, keys: Floats, size: int, cell: int, key: float) -> tuple[Ints, Floats, int]:
    """Adds to a binary heap, least key first, which grows where it must."""
    if size == cells.size:
        cells = np.concatenate((cells, np.empty(size, dtype=np.int64)))
        keys = np.concatenate((keys, np.empty(size)))
    slot = size
    while slot > 0 and keys[(slot - 1) >> 1] > key:
        cells[slot] = cells[(slot - 1) >> 1]
        keys[slot] = keys[(slot - 1) >> 1]
        slot = (slot - 1) >> 1
    cells[slot] = cell
    keys[slot] = key
    return cells, keys, size + 1


@njit(nogil=True, cache=True)
def pop_least(cells: Ints, keys: Floats, size: int) -> int:
    """Takes the least out of the heap; returns how many are left."""
    size -= 1
    cell, key = cells[size], keys[size]
    slot = 0
    while True:
        child = 2 * slot + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        cells[slot] = cells[child]
        keys[slot] = keys[child]
        slot = child
    cells[slot] = cell
    keys[slot] = key
    return size
