"""The 8-connected lattice of flat padded arrays, and a heap."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
Bytes = NDArray[np.uint8]

ROOT2 = math.sqrt(2.0)


def offsets_of(width: int) -> Ints:
    """Return the index offsets of the steps E, N, W, S, NE, NW, SW, SE."""
    return np.array([1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1])


def cuts_corner(enter: Floats, offsets: Ints, m: int, k: int) -> bool:
    """Return whether the diagonal step from m in direction k (4 to 7) passes the corner of a wall."""
    # DEVIATION: the paper's lattice has every diagonal edge. A vehicle of finite size on a diagonal edge
    # passes over the corners of the two cells beside the edge, so a wall in one of these cells closes the
    # edge. A vehicle in a wall may leave the wall in any direction, because the exit has priority.
    beside, other = m + offsets[k - 4], m + offsets[(k - 3) & 3]
    return bool(enter[m] != np.inf and (enter[beside] == np.inf or enter[other] == np.inf))


def offered(label: Floats, extra: float, width: int, m: int) -> float:
    """Return the least label of the neighbours of m, plus `extra` for diagonal neighbours; ignore walls."""
    near = min(label[m - 1], label[m + 1], label[m - width], label[m + width])
    low = min(label[m - width - 1], label[m - width + 1])
    high = min(label[m + width - 1], label[m + width + 1])
    return float(min(near, min(low, high) + extra))


def push(cells: Ints, keys: Floats, size: int, cell: int, key: float) -> tuple[Ints, Floats, int]:
    """Add a cell to a binary heap, least key first; return the heap, enlarged if necessary, and its size."""
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


def pop_least(cells: Ints, keys: Floats, size: int) -> int:
    """Remove the least key from the heap; return the new size."""
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
