"""A label-setting search for routes by two sums, length and exposure.

A label is a route from the start to a cell, with the length and the exposure of the route. A label is dropped
if another label of the cell is at most as long and at most as exposed. A label that cannot lead to a useful
route is dropped too. Three fields give lower bounds for the route from a cell to a goal: the least length,
the least exposure, and the least exposure + price · length. A label's key is the lower bound on exposure +
price · length of its complete routes. The label of the least key is extended first. So a label that reaches a
goal is final, and the least key is a lower bound for all routes that are not found yet.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.descent import LENGTH_TIE, REL_TIE
from swarmctl.planners.kernels.field import Field, is_small
from swarmctl.planners.kernels.lattice import (
    ROOT2,
    Floats,
    Ints,
    cuts_corner,
    enlarged,
    offsets_of,
    pop_least,
    push,
)

KEY_TIE = 1e-13
"""smallest relative gain by which a route counts as better in exposure + price · length"""
FIRST_POOL = 1 << 12
"""number of labels for which a search allocates memory at its start"""


class ToGo(msgspec.Struct, frozen=True, eq=False):
    """Lower bounds for the route from each cell to a goal: padded flat arrays, 0 in walls."""

    length: Floats
    exposure: Floats
    priced: Floats
    """exposure + price · length"""
    price: float

    @classmethod
    def of(cls, shortest: Field, safest: Field | None, cheapest: Field, price: float) -> ToGo:
        """Return the bounds from fields at w = 0 (ψ = 1), w = 1 (None: bound 0) and w = 1/2 (ψ = price)."""
        length = _to_go(shortest)
        exposure = np.zeros_like(length) if safest is None else _to_go(safest)
        return cls(length, exposure, 2.0 * _to_go(cheapest), price)


def _to_go(field: Field) -> Floats:
    """Return the least cost from each cell to a goal, padded and flat; 0 in walls."""
    exposed = field.straight - field.step
    return np.subtract(field.label, exposed, out=np.zeros(exposed.size), where=np.isfinite(exposed))


class LabelSearchResult(msgspec.Struct, frozen=True):
    """The result of a label search."""

    routes: tuple[tuple[Cell, ...], ...]
    """routes from the start to a goal in the order found; none dominates another"""
    least_open: float
    """lower bound on exposure + price · length of the routes not found; infinite if all were found"""
    n_labels: int


def label_search(
    exposure: Floats,
    start: Cell,
    goals: Sequence[Cell],
    to_go: ToGo,
    *,
    longest_cells: float,
    below_exposure: float,
    whole_front: bool,
    max_labels: int,
) -> LabelSearchResult:
    """Return routes no longer than `longest_cells` and less exposed than `below_exposure`; `exposure` is P_s.

    If `whole_front`, the result has a route for each non-dominated pair of sums. Otherwise the exposure falls
    from route to route, and the last route is the least exposed. `max_labels` limits the number of labels (0:
    no limit).
    """
    rows, cols = exposure.shape
    width = cols + 2
    p_s = np.full((rows + 2, width), np.inf)
    p_s[1:-1, 1:-1] = exposure
    is_goal = np.zeros(p_s.size, dtype=np.bool_)
    for row, col in goals:
        is_goal[(row + 1) * width + col + 1] = True
    first = (start[0] + 1) * width + start[1] + 1
    search = set_labels if is_small(exposure.size) else compiled(set_labels)
    ends, cell, parent, least_open = search(
        p_s.reshape(-1), width, first, is_goal, to_go.length, to_go.exposure, to_go.priced, to_go.price,
        longest_cells, below_exposure, whole_front, max_labels,
    )  # fmt: skip
    routes = []
    for end in ends.tolist():
        path = []
        label = end
        while label >= 0:
            index = int(cell[label])
            path.append((index // width - 1, index % width - 1))
            label = int(parent[label])
        routes.append(tuple(reversed(path)))
    return LabelSearchResult(tuple(routes), float(least_open), len(cell))


def set_labels(
    p_s: Floats,
    width: int,
    first: int,
    is_goal: NDArray[np.bool_],
    to_length: Floats,
    to_exposure: Floats,
    to_priced: Floats,
    price: float,
    longest: float,
    below_exposure: float,
    whole_front: bool,
    max_labels: int,
) -> tuple[Ints, NDArray[np.int32], NDArray[np.int32], float]:
    """Return the labels at goals in the order found, all labels' cells and parents, and `least_open`."""
    offsets = offsets_of(width)
    head = np.full(p_s.size, -1, dtype=np.int32)  # each cell's newest label; `older` has the label before
    cell = np.empty(FIRST_POOL, dtype=np.int32)
    parent = np.empty(FIRST_POOL, dtype=np.int32)
    older = np.empty(FIRST_POOL, dtype=np.int32)
    sums = np.empty((FIRST_POOL, 2))
    alive = np.empty(FIRST_POOL, dtype=np.bool_)
    heap, keys, size = np.empty(FIRST_POOL, dtype=np.int64), np.empty(FIRST_POOL), 0
    stairs = np.empty((16, 2))  # (length, exposure) of the routes found, by rising length
    stairs[0, 0], stairs[0, 1] = 0.0, below_exposure
    n_stairs = 1
    ends = np.empty(16, dtype=np.int64)
    n_ends = 0
    cutoff = (below_exposure + price * longest) * (1.0 - KEY_TIE)
    cell[0] = first
    parent[0] = -1
    older[0] = -1
    sums[0, 0], sums[0, 1] = 0.0, 0.0
    alive[0] = True
    head[first] = 0
    count = 1
    heap, keys, size = push(heap, keys, size, 0, to_priced[first])
    while size > 0 and keys[0] < cutoff:
        key, label = keys[0], heap[0]
        size = pop_least(heap, keys, size)
        if not alive[label]:
            continue
        m = cell[label]
        length, exposure = sums[label, 0], sums[label, 1]
        if _is_dominated(stairs, n_stairs, length + to_length[m], exposure + to_exposure[m]):
            continue
        if is_goal[m]:
            if n_ends == ends.size:
                ends = enlarged(ends)
            ends[n_ends] = label
            n_ends += 1
            if not whole_front:
                n_stairs = 0
                length = 0.0
            if n_stairs + 1 >= stairs.shape[0]:
                stairs = _with_more_rows(stairs)
            n_stairs = _insert(stairs, n_stairs, length, exposure)
            cutoff = _highest_corner(stairs, n_stairs, price, longest) * (1.0 - KEY_TIE)
            continue
        if max_labels > 0 and count >= max_labels:
            return ends[:n_ends], cell[:count], parent[:count], key
        if count + 8 > cell.size:
            cell, parent, older, alive = enlarged(cell), enlarged(parent), enlarged(older), enlarged(alive)
            sums = _with_more_rows(sums)
        for k in range(8):
            n = m + offsets[k]
            if p_s[n] == np.inf or (k >= 4 and cuts_corner(p_s, offsets, m, k)):
                continue
            new_length = length + (1.0 if k < 4 else ROOT2)
            new_exposure = exposure + p_s[n]
            new_key = new_exposure + price * new_length + to_priced[n]
            if (
                new_key >= cutoff
                or new_length + to_length[n] > longest
                or _is_dominated(stairs, n_stairs, new_length + to_length[n], new_exposure + to_exposure[n])
                or not _is_nondominated(head, older, alive, sums, n, new_length, new_exposure)
            ):
                continue
            cell[count] = n
            parent[count] = label
            older[count] = head[n]
            head[n] = count
            sums[count, 0] = new_length
            sums[count, 1] = new_exposure
            alive[count] = True
            heap, keys, size = push(heap, keys, size, count, new_key)
            count += 1
    return ends[:n_ends], cell[:count], parent[:count], np.inf


def _is_nondominated(
    head: NDArray[np.int32],
    older: NDArray[np.int32],
    alive: NDArray[np.bool_],
    sums: Floats,
    n: int,
    length: float,
    exposure: float,
) -> bool:
    """Return whether no label of cell n dominates these sums; drop labels that these sums dominate."""
    before = -1
    label = head[n]
    longer = length + LENGTH_TIE
    shorter = length - LENGTH_TIE
    most = exposure * (1.0 + REL_TIE)
    while label >= 0:
        if sums[label, 0] <= longer and sums[label, 1] <= most:
            return False
        follower = older[label]
        if sums[label, 0] >= shorter and sums[label, 1] >= exposure:
            alive[label] = False
            if before < 0:
                head[n] = follower
            else:
                older[before] = follower
        else:
            before = label
        label = follower
    return True


def _is_dominated(stairs: Floats, n_stairs: int, length: float, exposure: float) -> bool:
    """Return whether a step of `stairs` is at most as long and at most as exposed as these sums."""
    low, high = 0, n_stairs  # the first step that is longer
    while low < high:
        middle = (low + high) >> 1
        if stairs[middle, 0] <= length + LENGTH_TIE:
            low = middle + 1
        else:
            high = middle
    return bool(low > 0 and stairs[low - 1, 1] <= exposure * (1.0 + REL_TIE))


def _with_more_rows(pairs: Floats) -> Floats:
    """Return pairs (n, 2) as the first of twice as many."""
    more = np.empty((2 * pairs.shape[0], 2))
    for row in range(pairs.shape[0]):
        more[row, 0], more[row, 1] = pairs[row, 0], pairs[row, 1]
    return more


def _insert(stairs: Floats, n_stairs: int, length: float, exposure: float) -> int:
    """Insert a step between the shorter and the longer steps; return the number of steps."""
    slot = n_stairs
    while slot > 0 and stairs[slot - 1, 0] > length:
        stairs[slot, 0], stairs[slot, 1] = stairs[slot - 1, 0], stairs[slot - 1, 1]
        slot -= 1
    stairs[slot, 0] = length
    stairs[slot, 1] = exposure
    return n_stairs + 1


def _highest_corner(stairs: Floats, n_stairs: int, price: float, longest: float) -> float:
    """Return an upper bound on exposure + price · length of the routes that no step dominates."""
    highest = stairs[n_stairs - 1, 1] + price * longest
    for step in range(n_stairs - 1):
        highest = max(highest, stairs[step, 1] + price * stairs[step + 1, 0])
    return float(highest)
