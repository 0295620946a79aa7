"""The way down a field.

From each cell the way goes on to the neighbour through which it is cheapest. Costs within REL_TIE of each
other count as equal, for the order in which a sum is rounded shall move no route; among equals the shortest
way is taken, then the first in the order of `offsets_of`. How long the ways of equal cost are is worked out
only where there are any: over the cells that can be reached from there without loss.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from swarmctl.planners.kernels.lattice import ROOT2, Floats, Ints, offsets_of, squeezes

REL_TIE = 1e-12
"""Costs closer than this, relatively, are equal: rounding of a sum over thousands of cells stays below."""
LENGTH_TIE = 1e-9
"""Lengths closer than this are equal [cells]; two that differ in steps differ by more on any real area."""
UNKNOWN = np.inf
"""in `length`: nobody asked yet; while it is being worked out: -2 minus the cell's place among those"""


@njit(nogil=True, cache=True)
def cost_of(label: Floats, step: float, extra: float, straight: Floats, width: int, m: int) -> float:
    """The least cost from m, no goal, to a goal."""
    offsets = offsets_of(width)
    best = np.inf
    for k in range(8):
        cost = label[m + offsets[k]] + (0.0 if k < 4 else extra)
        if cost < best and not (k >= 4 and squeezes(straight, offsets, m, k)):
            best = cost
    return best + step


@njit(nogil=True, cache=True)
def costs(
    label: Floats, step: float, extra: float, straight: Floats, rows: int, cols: int, goals: Ints
) -> Floats:
    """The least cost from every cell: padded and flat, infinite outside."""
    width = cols + 2
    cost = np.full(label.size, np.inf)
    for row in range(1, rows + 1):
        for m in range(row * width + 1, row * width + cols + 1):
            cost[m] = cost_of(label, step, extra, straight, width, m)
    cost[goals] = 0.0
    return cost


@njit(nogil=True, cache=True)
def run_down(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    width: int,
    goals: Ints,
    m: int,
    length: Floats,
) -> tuple[Ints, bool]:
    """Flat indices from m, whose cost is finite, to one of the sorted `goals`; whether it got there.

    It stops short at a cell from which several ways cost the same, if `length` does not know them.
    """
    offsets = offsets_of(width)
    path = np.empty(256, dtype=np.int64)
    path[0] = m
    count = 1
    while not is_goal(goals, m):
        bound = cost_of(label, step, extra, straight, width, m) * (1.0 + REL_TIE)
        best, ties, best_length = -1, 0, np.inf
        for k in range(8):
            n = m + offsets[k]
            d = 1.0 if k < 4 else ROOT2
            if label[n] + (0.0 if k < 4 else extra) + step > bound:
                continue
            if k >= 4 and squeezes(straight, offsets, m, k):
                continue
            ties += 1
            if best < 0 or (length.size > 0 and length[n] + d < best_length - LENGTH_TIE):
                best = n
                best_length = length[n] + d if length.size > 0 else np.inf
        if ties > 1 and (length.size == 0 or length[m] == UNKNOWN):
            return path[:count], False
        m = best
        if count == path.size:
            path = np.concatenate((path, np.empty(path.size, dtype=np.int64)))
        path[count] = m
        count += 1
    return path[:count], True


@njit(nogil=True, cache=True)
def is_goal(goals: Ints, m: int) -> bool:
    place = np.searchsorted(goals, m)
    return bool(place < goals.size and goals[place] == m)


@njit(nogil=True, cache=True)
def find_lengths(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    width: int,
    goals: Ints,
    start: int,
    length: Floats,
) -> None:
    """Writes into `length` how long the shortest of the cheapest ways is, from `start` and from every cell on
    any of them: Dijkstra's algorithm over the edges that lose nothing."""
    offsets = offsets_of(width)
    cells, bounds, size = _without_loss(label, step, extra, straight, width, goals, start, length)
    heap_cell = np.empty(64, dtype=np.int64)
    heap_length = np.empty(64)
    n_heap = 0
    for place in range(size):  # the cells next to those whose length is known
        m = cells[place]
        best = 0.0 if is_goal(goals, m) else np.inf
        for k in range(8):
            n = m + offsets[k]
            if 0.0 <= length[n] < np.inf and best > 0.0:
                loses = label[n] + (0.0 if k < 4 else extra) + step > bounds[place]
                if not loses and not (k >= 4 and squeezes(straight, offsets, m, k)):
                    best = min(best, length[n] + (1.0 if k < 4 else ROOT2))
        if best < np.inf:
            heap_cell, heap_length, n_heap = _push(heap_cell, heap_length, n_heap, m, best)
    while n_heap > 0:
        n, known = heap_cell[0], heap_length[0]
        n_heap = _pop(heap_cell, heap_length, n_heap)
        if length[n] >= 0.0:
            continue
        length[n] = known
        for k in range(8):
            m = n + offsets[k]
            if length[m] >= 0.0:  # known, or of no interest
                continue
            place = int(-length[m]) - 2
            back = k ^ 2 if k >= 4 else k
            loses = label[n] + (0.0 if k < 4 else extra) + step > bounds[place]
            if not loses and not (k >= 4 and squeezes(straight, offsets, m, back)):
                d = 1.0 if k < 4 else ROOT2
                heap_cell, heap_length, n_heap = _push(heap_cell, heap_length, n_heap, m, known + d)


@njit(nogil=True, cache=True)
def _without_loss(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    width: int,
    goals: Ints,
    start: int,
    length: Floats,
) -> tuple[Ints, Floats, int]:
    """The cells on the cheapest ways from `start` whose length is not known, and what counts as cheapest."""
    offsets = offsets_of(width)
    cells = np.empty(256, dtype=np.int64)
    bounds = np.empty(256)
    cells[0] = start
    length[start] = -2.0
    size, looked_at = 1, 0
    while looked_at < size:
        m = cells[looked_at]
        if is_goal(goals, m):
            bounds[looked_at] = -1.0  # no way leads on from a goal
            looked_at += 1
            continue
        bound = cost_of(label, step, extra, straight, width, m) * (1.0 + REL_TIE)
        bounds[looked_at] = bound
        looked_at += 1
        for k in range(8):
            n = m + offsets[k]
            if length[n] != UNKNOWN or label[n] + (0.0 if k < 4 else extra) + step > bound:
                continue
            if k >= 4 and squeezes(straight, offsets, m, k):
                continue
            if size == cells.size:
                cells = np.concatenate((cells, np.empty(size, dtype=np.int64)))
                bounds = np.concatenate((bounds, np.empty(size)))
            cells[size] = n
            length[n] = -2.0 - size
            size += 1
    return cells, bounds, size


@njit(nogil=True, cache=True)
def _push(cells: Ints, keys: Floats, size: int, cell: int, key: float) -> tuple[Ints, Floats, int]:
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
def _pop(cells: Ints, keys: Floats, size: int) -> int:
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
