"""The 8-connected lattice of cells with flat padded indices, and a binary heap."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
Bytes = NDArray[np.uint8]

T = TypeVar("T", bound=np.generic)

ROOT2 = math.sqrt(2.0)


def offsets_of(width: int) -> Ints:
    """Return the index offsets of the steps E, N, W, S, NE, NW, SW, SE."""
    return np.array([1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1])


def cuts_corner(entry_cost: Floats, offsets: Ints, m: int, k: int) -> bool:
    """Return whether the diagonal step from m in direction k (4 to 7) passes a wall's corner (inf: wall)."""
    # DEVIATION: the paper's lattice has every diagonal edge. A vehicle of finite size on a diagonal edge
    # passes over the corners of the two cells beside the edge, so a wall in one of these cells closes the
    # edge. A vehicle in a wall may leave the wall in any direction, because the exit has priority.
    beside, other = m + offsets[k - 4], m + offsets[(k - 3) & 3]
    return bool(entry_cost[m] != np.inf and (entry_cost[beside] == np.inf or entry_cost[other] == np.inf))


def enlarged(array: NDArray[T]) -> NDArray[T]:
    """Return a flat array of twice the size that begins with the values of `array`."""
    larger = np.empty(2 * array.size, dtype=array.dtype)
    for i in range(array.size):  # numba compiles a loop faster than a concatenation
        larger[i] = array[i]
    return larger


def push(items: Ints, keys: Floats, size: int, item: int, key: float) -> tuple[Ints, Floats, int]:
    """Add an item to a heap, least key first; return the heap, enlarged if necessary, and its size."""
    if size == items.size:
        items, keys = enlarged(items), enlarged(keys)
    slot = size
    while slot > 0 and keys[(slot - 1) >> 1] > key:
        items[slot] = items[(slot - 1) >> 1]
        keys[slot] = keys[(slot - 1) >> 1]
        slot = (slot - 1) >> 1
    items[slot] = item
    keys[slot] = key
    return items, keys, size + 1


def pop_least(items: Ints, keys: Floats, size: int) -> int:
    """Remove the item of the least key from the heap; return the new size."""
    size -= 1
    item, key = items[size], keys[size]
    slot = 0
    while True:
        child = 2 * slot + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        items[slot] = items[child]
        keys[slot] = keys[child]
        slot = child
    items[slot] = item
    keys[slot] = key
    return size
