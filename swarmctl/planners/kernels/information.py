"""The value of information: by how much the cost of a route falls when the state of a cell becomes known.

`planners.benevolence` has the formula. A candidate route goes from the start to a cell, and on to a goal. All
cells are flat padded indices.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.lattice import Floats, Ints, cuts_corner, offsets_of

SAME_COST = 1e-9
"""relative difference below which the costs of two candidates are equal"""


def write_next(
    label: Floats,
    step: float,
    extra: float,
    straight: Floats,
    width: int,
    ends: Ints,
    cost: Floats,
    after: Ints,
) -> None:
    """Write the least cost from each cell to `ends`, and the next cell on the way; −1 at the ends."""
    offsets = offsets_of(width)
    for m in range(width + 1, label.size - width - 1):
        cost[m], after[m] = np.inf, -1
        for k in range(8):
            beyond = label[m + offsets[k]] + (0.0 if k < 4 else extra) + step
            if beyond < cost[m] and not (k >= 4 and cuts_corner(straight, offsets, m, k)):
                cost[m], after[m] = beyond, m + offsets[k]
    for end in ends:
        cost[end], after[end] = 0.0, -1


def follow(after: Ints, m: int, route: Ints, size: int) -> int:
    """Write the cells after m into `route`, from index `size`; return the number of cells in `route`."""
    m = after[m]
    while m >= 0 and size < route.size:
        route[size] = m
        size += 1
        m = after[m]
    return size


def fire_at(route: Ints, size: int, width: int, strength: Floats, sums: Floats, touched: Ints) -> int:
    """Add the firing strengths at the cells of a route to `sums`; return how many are in `touched`."""
    n = 0
    for index in range(size):
        for row_step in range(-1, 2):
            for col_step in range(-1, 2):
                j = route[index] + row_step * width + col_step
                if sums[j] == 0.0:
                    touched[n] = j
                    n += 1
                sums[j] += strength[abs(row_step) + abs(col_step)]
    return n


def candidates(
    best: float, p: Floats, over: Floats, sums: Floats, w: float, p_hits: float, most: int
) -> Ints:
    """Return the cells over which a route may become the best one, at most `most` of them."""
    # No observation favours a dearer route than `reach` over the best route.
    gain, greatest = 0.0, 0.0
    for j in range(p.size):
        gain = max(gain, (1.0 - p[j]) * sums[j])
        if p[j] < 1.0:
            greatest = max(greatest, p[j])
    reach = w * max(gain, greatest * p_hits)
    found = np.flatnonzero(over < best + reach)
    if found.size <= most:
        return found
    return found[np.linspace(0, found.size - 1, most).astype(np.int64)]


def value_of_knowing(
    p: Floats,
    to_goal: Floats,
    to_start: Floats,
    straight: Floats,
    strength: Floats,
    w: float,
    step: float,
    extra: float,
    width: int,
    start: int,
    goals: Ints,
    most: int,
) -> Floats:
    """Return the value of knowing each cell for a vehicle at `start`, from which a route leads to a goal.

    `to_goal` and `to_start` are the labels of fields. `strength` is Eq. 1 by the number of steps. p, the
    chance of a hostile, is 0 in the padding. `most` limits the number of candidates.
    """
    after, before = np.full(p.size, -1), np.full(p.size, -1)
    cost, over = np.full(p.size, np.inf), np.full(p.size, np.inf)
    write_next(to_start, step, extra, straight, width, np.full(1, start), over, before)
    write_next(to_goal, step, extra, straight, width, goals, cost, after)
    over += to_goal  # the cost of the cheapest route over each cell
    best = over[start] = cost[start]
    route, sums = np.empty(2 * p.size, dtype=np.int64), np.zeros(p.size)
    on_best, touched = np.empty(p.size, dtype=np.int64), np.empty(p.size, dtype=np.int64)
    if_occupied, if_clear = np.full(p.size, best), np.full(p.size, best)
    n_best = fire_at(route, follow(after, start, route, 0), width, strength, sums, on_best)
    found = candidates(best, p, over, sums, w, strength[0] + 4.0 * (strength[1] + strength[2]), most)
    for index in range(n_best):
        j = on_best[index]
        if_occupied[j], if_clear[j] = best + (1.0 - p[j]) * w * sums[j], best - p[j] * w * sums[j]
    sums[:] = 0.0
    is_passed = np.zeros(p.size, dtype=np.uint8)
    for cell in found:
        if is_passed[cell]:
            continue
        # The way from the cell back to the start, without the start, is the first part in reverse.
        size = 0
        if cell != start:
            route[0] = cell
            size = max(follow(before, cell, route, 1) - 1, 1)
        size = follow(after, cell, route, size)
        for index in range(size):  # the route is the cheapest one over these cells, too
            is_passed[route[index]] |= over[route[index]] >= over[cell] * (1.0 - SAME_COST)
        n = fire_at(route, size, width, strength, sums, touched)
        for index in range(n):
            j = touched[index]
            if_occupied[j] = min(if_occupied[j], over[cell] + (1.0 - p[j]) * w * sums[j])
            if_clear[j] = min(if_clear[j], over[cell] - p[j] * w * sums[j])
        for index in range(n_best):
            if sums[on_best[index]] == 0.0:
                if_occupied[on_best[index]] = min(if_occupied[on_best[index]], over[cell])
        for index in range(n):
            sums[touched[index]] = 0.0
    value = np.zeros(p.size)
    for j in range(p.size):
        if 0.0 < p[j] < 1.0:  # without the rounding at 0 and 1
            value[j] = max(best - p[j] * if_occupied[j] - (1.0 - p[j]) * if_clear[j], 0.0)
    return value
