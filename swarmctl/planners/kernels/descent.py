"""The route down a field.

From each cell the route goes to the neighbour of least total cost. Costs within REL_TIE of each other count
as equal, so that rounding does not change the route. The shortest of equal routes is taken, then the first in
the order of `offsets_of`. Only a cell at which routes cost the same needs lengths. The lengths are computed
for all cells on the cheapest routes from this cell.
"""

from __future__ import annotations

import numpy as np

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

REL_TIE = 1e-12
"""relative difference below which costs are equal; sums over thousands of cells have a smaller error"""
LENGTH_TIE = 1e-9
"""difference below which lengths are equal [cells]; different sums of steps differ by more on real areas"""
UNKNOWN = np.inf
"""value in `length` of a cell whose length is not known yet"""
MANY_GOALS = 4
"""number of goals above which `_least_length` is 0, to save time"""


def cost_of(label: Floats, step: float, extra: float, straight: Floats, offsets: Ints, m: int) -> float:
    """Return the least cost from m, which is no goal, to a goal."""
    best = np.inf
    for k in range(8):
        cost = label[m + offsets[k]] + (0.0 if k < 4 else extra)
        if cost < best and not (k >= 4 and cuts_corner(straight, offsets, m, k)):
            best = cost
    return best + step


def costs(
    label: Floats, step: float, extra: float, straight: Floats, rows: int, cols: int, has_walls: bool
) -> Floats:
    """Return the least cost from every cell, (rows, cols), as if no cell were a goal."""
    width = cols + 2
    offsets = offsets_of(width)
    cost = np.empty((rows, cols))
    for row in range(rows):
        base = row * width
        if has_walls:
            for col in range(cols):
                cost[row, col] = cost_of(label, step, extra, straight, offsets, base + width + col + 1)
            continue
        # With slices the compiler handles several cells at once: a third of the time.
        below, here, above, out = label[base:], label[base + width :], label[base + 2 * width :], cost[row]
        for col in range(cols):
            near = min(here[col], here[col + 2], below[col + 1], above[col + 1])
            diagonal = min(below[col], below[col + 2], above[col], above[col + 2])
            out[col] = min(near, diagonal + extra) + step
    return cost


def descend(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    has_walls: bool,
    width: int,
    goals: Ints,
    start: int,
    length: Floats,
) -> tuple[Ints, Floats]:
    """Return the route from a start of finite cost to one of the sorted `goals`, and `length`.

    `length` includes the lengths computed here, and has size 0 if none are known.

    At a tie with unknown lengths the search assumes that the shortest route is as short as the lattice
    allows. If the assumption fails, the search goes back to the cell of the tie and computes the lengths.
    """
    offsets = offsets_of(width)
    neighbour_costs = np.empty(8)
    path = np.empty(512, dtype=np.int64)
    path[0] = m = start
    count, assumed_since = 1, -1
    while not is_goal(goals, m):
        bound = np.inf
        for k in range(8):
            neighbour_costs[k] = label[m + offsets[k]] + (0.0 if k < 4 else extra) + step
            if has_walls and k >= 4 and cuts_corner(straight, offsets, m, k):
                neighbour_costs[k] = np.inf
            bound = min(bound, neighbour_costs[k])
        bound *= 1.0 + REL_TIE
        best, ties = -1, 0
        for k in range(7, -1, -1):
            if neighbour_costs[k] <= bound:
                ties += 1
                best = m + offsets[k]
        if ties > 1 and assumed_since < 0 and (length.size == 0 or length[m] == UNKNOWN):
            assumed_since = count
        if ties > 1 or assumed_since >= 0:
            best, assumption_fails = _next_of_shortest(
                neighbour_costs, bound, width, offsets, goals, m, length, assumed_since >= 0
            )
            if assumption_fails:
                count, assumed_since = assumed_since, -1
                m = path[count - 1]
                if length.size == 0:
                    length = np.full(label.size, UNKNOWN)
                find_lengths(label, step, extra, straight, width, goals, m, length)
                continue
        m = best
        if count == path.size:
            path = enlarged(path)
        path[count] = m
        count += 1
    return path[:count], length


def _next_of_shortest(
    neighbour_costs: Floats,
    bound: float,
    width: int,
    offsets: Ints,
    goals: Ints,
    m: int,
    length: Floats,
    assumes_least: bool,
) -> tuple[int, bool]:
    """Return the neighbour of m on the shortest route of at most the cost `bound`.

    If `assumes_least`, lengths are the least that the lattice allows, otherwise from `length`. The second
    value is True if no route is as short as assumed.
    """
    best, best_length = -1, np.inf
    for k in range(8):
        if neighbour_costs[k] <= bound:
            n = m + offsets[k]
            to_go = (1.0 if k < 4 else ROOT2) + (
                _least_length(goals, width, n) if assumes_least else length[n]
            )
            if to_go < best_length - LENGTH_TIE:
                best, best_length = n, to_go
    return best, assumes_least and best_length > _least_length(goals, width, m) + LENGTH_TIE


def _least_length(goals: Ints, width: int, m: int) -> float:
    """Return a lower bound on the length of a route from m to a goal [cells]; 0 for many goals."""
    if goals.size > MANY_GOALS:
        return 0.0
    least = np.inf
    for goal in goals:
        rows, cols = abs(goal // width - m // width), abs(goal % width - m % width)
        least = min(least, max(rows, cols) + (ROOT2 - 1.0) * min(rows, cols))
    return least


def is_goal(goals: Ints, m: int) -> bool:
    if goals.size == 1:
        return bool(goals[0] == m)
    at = np.searchsorted(goals, m)
    return bool(at < goals.size and goals[at] == m)


def _cheapest_directions(
    label: Floats, step: float, extra: float, straight: Floats, offsets: Ints, goals: Ints, m: int
) -> int:
    """Return the directions of the cheapest routes from m, one bit for each; 0 at a goal."""
    if is_goal(goals, m):
        return 0
    bound = cost_of(label, step, extra, straight, offsets, m) * (1.0 + REL_TIE)
    directions = 0
    for k in range(8):
        is_dearer = label[m + offsets[k]] + (0.0 if k < 4 else extra) + step > bound
        if not is_dearer and (k < 4 or not cuts_corner(straight, offsets, m, k)):
            directions |= 1 << k
    return directions


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
    """Write the least length of the cheapest routes, for all cells on the cheapest routes from `start`.

    The method is Dijkstra's algorithm over the edges of cheapest routes, which may form cycles of cost 0.
    """
    offsets = offsets_of(width)
    cells, directions, size = _cells_without_length(label, step, extra, straight, width, goals, start, length)
    least = np.full(size, np.inf)
    heap, keys, n_open = np.empty(256, dtype=np.int64), np.empty(256), 0
    for index in range(size):  # the cells next to known lengths
        m = cells[index]
        best = 0.0 if is_goal(goals, m) else np.inf
        for k in range(8):
            known = length[m + offsets[k]]
            if (directions[index] >> k) & 1 != 0 and known >= 0.0:
                best = min(best, known + (1.0 if k < 4 else ROOT2))
        if best < np.inf:
            least[index] = best
            heap, keys, n_open = push(heap, keys, n_open, index, best)
    while n_open > 0:
        index = heap[0]
        n_open = pop_least(heap, keys, n_open)
        n, known = cells[index], least[index]
        if length[n] >= 0.0:
            continue
        length[n] = known
        for k in range(8):
            m = n + offsets[k]
            if length[m] >= 0.0:  # known, or on no cheapest route
                continue
            other = int(-length[m]) - 2
            longer = known + (1.0 if k < 4 else ROOT2)
            back = k ^ 2
            if longer >= least[other] or (directions[other] >> back) & 1 == 0:
                continue
            least[other] = longer
            heap, keys, n_open = push(heap, keys, n_open, other, longer)


def _cells_without_length(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    width: int,
    goals: Ints,
    start: int,
    length: Floats,
) -> tuple[Ints, Ints, int]:
    """Return the cells of unknown length on the cheapest routes from `start`, and their cheapest directions.

    The third value is the number of cells; the arrays are longer. Write -2 - index into `length` for each of
    the cells.
    """
    offsets = offsets_of(width)
    cells = np.empty(256, dtype=np.int64)
    directions = np.empty(256, dtype=np.int64)
    cells[0] = start
    length[start] = -2.0
    size, n_done = 1, 0
    while n_done < size:
        m = cells[n_done]
        directions[n_done] = _cheapest_directions(label, step, extra, straight, offsets, goals, m)
        for k in range(8):
            n = m + offsets[k]
            if (directions[n_done] >> k) & 1 == 0 or length[n] != UNKNOWN:
                continue
            if size == cells.size:
                cells, directions = enlarged(cells), enlarged(directions)
            cells[size] = n
            length[n] = -2.0 - size
            size += 1
        n_done += 1
    return cells, directions, size
