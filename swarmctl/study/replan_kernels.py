"""The replanning of the abstract mission as machine code: belief, exposure, search and decision.

The functions are those of `core.belief`, `core.exposure`, `planners.dijkstra` and `agent.replan.decide`, for
the paper's sensor and planner. The routes are equal, with equal rules at ties.
"""

from __future__ import annotations

import numpy as np

from swarmctl.agent.replan.time_bound import BETTER_COST_SHARE
from swarmctl.planners.kernels.descent import descend
from swarmctl.planners.kernels.lattice import ROOT2, Bytes, Floats, Ints, cuts_corner, pop_least
from swarmctl.study.kernel_layout import (
    FOUND,
    INDEX,
    KNOWN,
    N_ROUTE,
    REPLANS,
    SEARCHES,
    Area,
    Search,
    Settings,
    Vehicles,
)

MARGIN = 1e-9
"""relative cost above that of the best route, up to which the search goes on, so that ties are complete"""


def believed_exposure(known: Bytes, n_unseen: int, n_hidden: int, area: Area, search: Search) -> float:
    """Write P_s of each cell, Eq. 3 over Eq. 4, infinite in walls; return the least one."""
    p_unseen = min(max(n_hidden / n_unseen, 0.0), 1.0) if n_unseen > 0 else 0.0  # Eq. 4
    p_occupied, p_s, width, walls = search.p_occupied, search.p_s, area.width, area.walls
    for m in range(known.size):
        p_occupied[m] = float(area.occupied[m]) if known[m] else p_unseen * area.inside[m]
    least = np.inf
    fs_o, fs_n1, fs_n2 = area.strength
    for row in range(1, known.size // width - 1):
        # With slices the compiler handles several cells at once.
        base = row * width
        below, here, above = p_occupied[base - width :], p_occupied[base:], p_occupied[base + width :]
        out = p_s[base + 1 : base + width - 1]
        for c in range(out.size):
            total = fs_n2 * below[c] + fs_n1 * below[c + 1] + fs_n2 * below[c + 2] + fs_n1 * here[c]
            total = total + fs_o * here[c + 1] + fs_n1 * here[c + 2]
            out[c] = total + fs_n2 * above[c] + fs_n1 * above[c + 1] + fs_n2 * above[c + 2]
        for c in range(out.size):
            if walls[base + 1 + c]:
                out[c] = np.inf
            least = min(least, out[c])
    return least


def write_straight(settings: Settings, search: Search) -> bool:
    """Write the cost of a straight step into each cell (Eq. 5); return whether any cell is a wall."""
    p_s, straight, w, step = search.p_s, search.straight, settings.w, settings.step
    has_walls = False
    for m in range(p_s.size):
        if p_s[m] > settings.max_exposure or p_s[m] == np.inf:
            has_walls = has_walls or p_s[m] >= 0.0
            straight[m] = np.inf
        elif p_s[m] >= 0.0:  # not the padding
            straight[m] = p_s[m] * w + step
    return has_walls


def write_rest(start: int, width: int, step: float, per_cell: float, rest: Floats) -> None:
    """Write a lower bound on the cost from `start` to each cell, without the exposure of that cell."""
    start_row, start_col = start // width, start % width
    for row in range(rest.size // width):
        rows = abs(row - start_row)
        for col in range(width):
            cols = abs(col - start_col)
            many, few = max(rows, cols), min(rows, cols)
            rest[row * width + col] = step * (many + (ROOT2 - 1.0) * few) + per_cell * max(many - 1, 0)


def push(heap: Ints, keys: Floats, size: int, item: int, key: float) -> int:
    """Add an item to a heap, least key first; return the new size.

    `lattice.push` returns the arrays as well, which takes a third of the time of a search.
    """
    slot = size
    while slot > 0 and keys[(slot - 1) >> 1] > key:
        parent = (slot - 1) >> 1
        heap[slot], keys[slot] = heap[parent], keys[parent]
        slot = parent
    heap[slot], keys[slot] = item, key
    return size + 1


def spread_to(
    start: int, below: float, goals: Ints, has_walls: bool, settings: Settings, area: Area, search: Search
) -> float:
    """Write the labels of all cells on the cheapest routes from `start`; return the least cost if `below`.

    An A* search backwards from the goals, without the cells on no route of a cost below `below`. The labels
    are those of `planners.kernels.field`; cells on no cheapest route may have greater ones.
    """
    step, offsets, straight, rest = settings.step, area.offsets, search.straight, search.rest
    label, heap, keys = search.label, search.heap, search.keys
    extra, n_open, cost, limit = step * (ROOT2 - 1.0), 0, np.inf, below
    for m in range(label.size):
        label[m] = np.inf
    for goal in goals:
        if straight[goal] < np.inf:
            label[goal] = settings.w * search.p_s[goal]
            n_open = push(heap, keys, n_open, goal, label[goal] + rest[goal])
    while n_open > 0 and keys[0] <= limit:
        n, key = heap[0], keys[0]
        n_open = pop_least(heap, keys, n_open)
        if key > label[n] + rest[n]:
            continue
        for k in range(8):
            m = n + offsets[k]
            before = label[n] + (0.0 if k < 4 else extra)
            entered = before + straight[m]
            if m != start and (entered >= label[m] or entered + rest[m] > limit):
                continue
            if has_walls and k >= 4 and cuts_corner(straight, offsets, m, k ^ 2):
                continue
            if m == start:
                cost = min(cost, before + step)
                limit = min(limit, cost * (1.0 + MARGIN))
            if entered < label[m]:
                label[m] = entered
                n_open = push(heap, keys, n_open, m, entered + rest[m])
    return cost


def route_cost(route: Ints, settings: Settings, width: int, search: Search) -> float:
    """Return the cost of a route (Eq. 5); infinite through a wall, or past the corner of one."""
    p_s, straight = search.p_s, search.straight
    total, n_straight, n_diagonal = 0.0, 0, 0
    for index in range(1, route.size):
        here, there = route[index - 1], route[index]
        is_diagonal = here // width != there // width and here % width != there % width
        if straight[there] == np.inf:
            return np.inf
        if is_diagonal and straight[here] < np.inf:
            beside = here // width * width + there % width
            other = there // width * width + here % width
            if straight[beside] == np.inf or straight[other] == np.inf:
                return np.inf
        n_straight += not is_diagonal
        n_diagonal += is_diagonal
        total += p_s[there]
    length = n_straight + n_diagonal * ROOT2
    return settings.step * length + (settings.w * total if settings.w > 0.0 else 0.0)


def replan(i: int, goals: Ints, settings: Settings, area: Area, vehicles: Vehicles, search: Search) -> None:
    """Take the best route by the present belief if it is better than the rest of the present route."""
    ints, routes, straight = vehicles.ints, vehicles.routes, search.straight
    width, w, step = area.width, settings.w, settings.step
    here = int(routes[i, ints[i, INDEX]])
    n_cells = (width - 2) * (search.label.size // width - 2)
    n_unseen, n_hidden = n_cells - ints[i, KNOWN], settings.n_hostiles - ints[i, FOUND]
    least = believed_exposure(vehicles.known[i], n_unseen, n_hidden, area, search)
    has_walls = write_straight(settings, search)
    write_rest(here, width, step, w * least if least < np.inf else 0.0, search.rest)
    ints[i, SEARCHES] += 1
    ahead = routes[i, ints[i, INDEX] : ints[i, N_ROUTE]].astype(np.int64)
    old = route_cost(ahead, settings, width, search)
    below = old * (1.0 - 0.5 * BETTER_COST_SHARE)
    if spread_to(here, below, goals, has_walls, settings, area, search) >= below:
        return  # also without any route: a vehicle in flight keeps its own
    extra = step * (ROOT2 - 1.0)
    path, _ = descend(search.label, step, extra, straight, has_walls, width, goals, here, np.empty(0))
    if old > route_cost(path, settings, width, search) * (1.0 + BETTER_COST_SHARE):
        take_route(i, path, vehicles)


def take_route(i: int, path: Ints, vehicles: Vehicles) -> None:
    """Replace a vehicle's route."""
    for index in range(path.size):
        vehicles.routes[i, index] = path[index]
    vehicles.ints[i, INDEX], vehicles.ints[i, N_ROUTE] = 0, path.size
    vehicles.ints[i, REPLANS] += 1
