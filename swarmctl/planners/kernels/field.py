"""The cost-to-go field and the way down it.

Two things make the way down independent of rounding and free of circles. Beside the least cost the field
keeps the length of the way that has it, the second key of the order; and on the way down costs within REL_TIE
of each other count as equal and the length decides, then the order of OFFSETS. The length to go shrinks by
at least a whole step each time, also where costs are zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.lattice import ROOT2, Floats, Ints, offsets_of, squeezes

REL_TIE = 1e-12
"""Costs closer than this, relatively, are equal: rounding of a sum over thousands of cells stays below."""
LENGTH_TIE = 1e-9
"""Lengths closer than this are equal [cells]; two that differ in steps differ by more on any real area."""
SETTLE_MARGIN = 1e-9
"""An early stop still settles all costs up to this part above the start's, more than ties can add up to, so
that it leads to the same route as the whole field."""


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """Padded flat arrays, and how to read them."""

    rows: int
    cols: int
    enter: Floats
    step: float
    cost: Floats
    length: Floats

    def unpadded_cost(self) -> Floats:
        """(rows, cols), read-only"""
        cost = self.cost.reshape(self.rows + 2, self.cols + 2)[1:-1, 1:-1].copy()
        cost.flags.writeable = False
        return cost

    def cost_of(self, cell: Cell) -> float:
        return float(self.cost[self._index(cell)])

    def run_down(self, start: Cell) -> tuple[Cell, ...]:
        """The cells from a start with a finite cost to a goal."""
        width = self.cols + 2
        path = _run_down(self.enter, self.step, width, self._index(start), self.cost, self.length)
        return tuple((index // width - 1, index % width - 1) for index in path.tolist())

    def _index(self, cell: Cell) -> int:
        return (cell[0] + 1) * (self.cols + 2) + cell[1] + 1


def spread(
    exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float, *, until: Cell | None = None
) -> Field:
    """The cost-to-go field by Eq. 5 for P_s of shape (rows, cols); no checks.

    With `until` only as much of it as the way down from that cell needs.
    """
    rows, cols = exposure.shape
    enter = np.full((rows + 2, cols + 2), np.inf)
    inner = enter[1:-1, 1:-1]
    inner[...] = exposure
    inner[np.isfinite(inner)] *= w  # a wall stays one for w = 0 too
    flat = enter.reshape(-1)
    field = Field(
        rows, cols, flat, (1.0 - w) * psi_per_cell, np.full(flat.size, np.inf), np.full(flat.size, np.inf)
    )
    seeds = np.array([field._index(goal) for goal in goals], dtype=np.int64)
    stop = -1 if until is None else field._index(until)
    _spread(field.enter, field.step, rows, cols, seeds, stop, field.cost, field.length)
    return field


def warm_up() -> None:
    """Compiles the kernels or loads them from the cache: no vehicle shall wait for a compiler in flight."""
    spread(np.zeros((2, 2)), [(1, 1)], 0.5, 1.0, until=(0, 0)).run_down((0, 0))


@njit(nogil=True, cache=True)
def _sift_up(heap: Ints, place: Ints, slot: int, cost: Floats, length: Floats) -> None:
    """Moves the cell in `slot` up to where no cell above it has a greater (cost, length)."""
    cell = heap[slot]
    while slot > 0:
        parent_slot = (slot - 1) >> 1
        parent = heap[parent_slot]
        if cost[parent] < cost[cell] or (cost[parent] == cost[cell] and length[parent] <= length[cell]):
            break
        heap[slot] = parent
        place[parent] = slot
        slot = parent_slot
    heap[slot] = cell
    place[cell] = slot


@njit(nogil=True, cache=True)
def _sift_down(heap: Ints, place: Ints, size: int, cell: int, cost: Floats, length: Floats) -> None:
    """Puts `cell` into the empty top of the heap and down to where none below has a lesser (cost, length)."""
    slot = 0
    while True:
        child_slot = 2 * slot + 1
        if child_slot >= size:
            break
        child = heap[child_slot]
        if child_slot + 1 < size:
            other = heap[child_slot + 1]
            if cost[other] < cost[child] or (cost[other] == cost[child] and length[other] < length[child]):
                child_slot += 1
                child = other
        if cost[cell] < cost[child] or (cost[cell] == cost[child] and length[cell] <= length[child]):
            break
        heap[slot] = child
        place[child] = slot
        slot = child_slot
    heap[slot] = cell
    place[cell] = slot


@njit(nogil=True, cache=True)
def _spread(
    enter: Floats, step: float, rows: int, cols: int, seeds: Ints, stop: int, cost: Floats, length: Floats
) -> None:
    """Dijkstra's algorithm backwards from the cells `seeds`, least (cost, length) first.

    `cost` and `length` come in all infinite. `place` is a cell's slot in the heap, -1 before it was reached
    and -2 once it is settled; the padding is settled from the beginning, so that nothing spreads into it.
    """
    width = cols + 2
    offsets = offsets_of(width)
    place = np.full(enter.size, -2, dtype=np.int64)
    for row in range(1, rows + 1):
        place[row * width + 1 : row * width + cols + 1] = -1
    heap = np.empty(rows * cols, dtype=np.int64)
    size = 0
    for seed in seeds:
        if place[seed] == -1:
            cost[seed] = 0.0
            length[seed] = 0.0
            heap[size] = seed
            place[seed] = size
            size += 1
    limit = np.inf
    while size > 0:
        n = heap[0]
        if cost[n] > limit:
            break
        size -= 1
        if size > 0:
            _sift_down(heap, place, size, heap[size], cost, length)
        place[n] = -2
        if n == stop:
            limit = cost[n] * (1.0 + SETTLE_MARGIN)
        if enter[n] == np.inf:
            continue  # a wall: one may stand in it, but not come in
        through = cost[n] + enter[n]
        for k in range(8):
            m = n + offsets[k]
            if place[m] == -2 or (k >= 4 and squeezes(enter, offsets, m, k ^ 2)):  # k ^ 2: back from m to n
                continue
            d = 1.0 if k < 4 else ROOT2
            new_cost = through + step * d  # Eq. 5
            new_length = length[n] + d
            if new_cost < cost[m] or (new_cost == cost[m] and new_length < length[m]):
                cost[m] = new_cost
                length[m] = new_length
                if place[m] == -1:
                    place[m] = size
                    heap[size] = m
                    size += 1
                _sift_up(heap, place, place[m], cost, length)


@njit(nogil=True, cache=True)
def _run_down(enter: Floats, step: float, width: int, start: int, cost: Floats, length: Floats) -> Ints:
    """Flat indices from `start`, whose cost is finite, to a goal: always to a neighbour through which the way
    is cheapest, of these through which it is shortest, of these the first in the order of OFFSETS."""
    offsets = offsets_of(width)
    path = np.empty(int(length[start]) + 2, dtype=np.int64)
    m = start
    path[0] = m
    count = 1
    while length[m] > 0.0:
        tie = cost[m] * (1.0 + REL_TIE)
        best = -1
        best_length = np.inf
        for k in range(8):
            n = m + offsets[k]
            d = 1.0 if k < 4 else ROOT2
            if (
                cost[n] + enter[n] + step * d <= tie
                and length[n] + d < best_length - LENGTH_TIE
                and not (k >= 4 and squeezes(enter, offsets, m, k))
            ):
                best = n
                best_length = length[n] + d
        m = best
        path[count] = m
        count += 1
    return path[:count]
