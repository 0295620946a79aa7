"""Lower bounds from an older field of the whole area, for the search of a box in the area."""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.descent import is_goal
from swarmctl.planners.kernels.lattice import Floats, Ints, offsets_of


def compare(
    exposure: Floats, w: float, step: float, straight: Floats, stride: int, most: int
) -> tuple[float, Ints, Floats]:
    """Compare the present costs, from P_s of shape (rows, cols), with the older costs in `straight`.

    Return a rate of at most 1, the cells whose cost has fallen below this share of the older cost, and their
    present costs. The rate is the least ratio of present to older cost among every `stride`-th cell: a
    common drift then does not count as a change of each cell. The rate is 0 if more than `most` cells have
    fallen.
    """
    rows, cols = exposure.shape
    width = cols + 2
    rate = 1.0
    for sample in range(0, rows * cols, stride):
        row = sample // cols
        col = sample - row * cols
        was = straight[(row + 1) * width + col + 1]
        if 0.0 < was < np.inf:
            rate = min(rate, (w * exposure[row, col] + step) / was)
    fallen = np.empty(most, dtype=np.int64)
    costs = np.empty(most)
    size = 0
    limit = rate * (1.0 - 1e-12)
    for row in range(rows):
        base = (row + 1) * width + 1
        n_fallen = 0
        for col in range(cols):
            n_fallen += w * exposure[row, col] + step < limit * straight[base + col]
        if n_fallen == 0:
            continue
        if size + n_fallen > most:
            return 0.0, fallen[:0], costs[:0]
        for col in range(cols):
            cost = w * exposure[row, col] + step
            if cost < limit * straight[base + col]:
                fallen[size] = base + col
                costs[size] = cost
                size += 1
    return rate, fallen[:size], costs[:size]


def descend_roughly(
    label: Floats, extra: float, width: int, goals: Ints, m: int, most: int
) -> tuple[Ints, bool]:
    """Return a route from m to one of the sorted `goals` along falling labels, without regard to ties.

    The second value is True if the route reaches a goal within `most` cells.
    """
    offsets = offsets_of(width)
    path = np.empty(most, dtype=np.int64)
    for count in range(most):
        path[count] = m
        if is_goal(goals, m):
            return path[: count + 1], True
        best = np.inf
        onward = -1
        for k in range(8):
            through = label[m + offsets[k]] + (0.0 if k < 4 else extra)
            if through < best:
                best = through
                onward = m + offsets[k]
        if onward < 0:
            break
        m = onward
    return path[:0], False


def least_cost_outside(
    from_start: Floats,
    rows: int,
    cols: int,
    label: Floats,
    old_straight: Floats,
    width: int,
    top: int,
    left: int,
    area_rows: int,
    valid_below: float,
    rate: float,
) -> float:
    """Return a lower bound on the cost of every route that leaves a box between the start and a goal.

    `from_start` is the cost to each cell of the box, (rows, cols) padded and flat. The corner of the box is
    cell (top, left) of the area. `label` and `old_straight` are older labels and costs of the whole area, of
    `area_rows` rows and width - 2 columns. Labels below `valid_below`, times `rate`, are lower bounds.
    """
    best = np.inf
    box_width = cols + 2
    for row in range(1, rows + 1):
        inner = (row > 1 or top == 0) and (row < rows or top + rows == area_rows)
        step = max(cols - 1, 1) if inner else 1
        for col in range(1, cols + 1, step):
            on_side = (col == 1 and left > 0) or (col == cols and left + cols < width - 2)
            if inner and not on_side:
                continue
            in_box = row * box_width + col
            in_area = (row + top) * width + col + left
            to_go = rate * (min(label[in_area], valid_below) - old_straight[in_area])
            if from_start[in_box] < np.inf:
                best = min(best, from_start[in_box] + to_go)
    return best
