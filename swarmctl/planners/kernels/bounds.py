"""Lower bounds from an older field of the whole area, for the search of a box in the area."""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.descent import is_goal
from swarmctl.planners.kernels.lattice import Floats, Ints, offsets_of


def compare(
    exposure: Floats, w: float, step: float, straight: Floats, stride: int, max_cells: int
) -> tuple[float, Ints, Floats]:
    """Compare the new costs, from P_s of shape (rows, cols), with the old costs in `straight`.

    Return a ratio, the cells whose new cost is less than ratio · old cost, and the new costs of these cells.
    The ratio is the least new cost / old cost of a sample, every `stride`-th cell, and at most 1. So a common
    drift of all costs lowers no cell. The ratio is 0 if there are more than `max_cells` such cells.
    """
    rows, cols = exposure.shape
    width = cols + 2
    ratio = 1.0
    for sample in range(0, rows * cols, stride):
        row = sample // cols
        col = sample - row * cols
        old_cost = straight[(row + 1) * width + col + 1]
        if 0.0 < old_cost < np.inf:
            ratio = min(ratio, (w * exposure[row, col] + step) / old_cost)
    fallen = np.empty(max_cells, dtype=np.int64)
    costs = np.empty(max_cells)
    size = 0
    limit = ratio * (1.0 - 1e-12)
    for row in range(rows):
        base = (row + 1) * width + 1
        n_fallen = 0
        for col in range(cols):
            n_fallen += w * exposure[row, col] + step < limit * straight[base + col]
        if n_fallen == 0:
            continue
        if size + n_fallen > max_cells:
            return 0.0, fallen[:0], costs[:0]
        for col in range(cols):
            cost = w * exposure[row, col] + step
            if cost < limit * straight[base + col]:
                fallen[size] = base + col
                costs[size] = cost
                size += 1
    return ratio, fallen[:size], costs[:size]


def descend_roughly(
    label: Floats, extra: float, width: int, goals: Ints, m: int, max_cells: int
) -> tuple[Ints, bool]:
    """Return a rough route from m to one of the sorted `goals`: each step goes to the least label.

    The route ignores ties and corners of walls. The second value is False, and the route empty, if no goal
    is reached within `max_cells` cells.
    """
    offsets = offsets_of(width)
    path = np.empty(max_cells, dtype=np.int64)
    for count in range(max_cells):
        path[count] = m
        if is_goal(goals, m):
            return path[: count + 1], True
        best = np.inf
        next_cell = -1
        for k in range(8):
            through = label[m + offsets[k]] + (0.0 if k < 4 else extra)
            if through < best:
                best = through
                next_cell = m + offsets[k]
        if next_cell < 0:
            break
        m = next_cell
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
    ratio: float,
) -> float:
    """Return a lower bound on the cost of all routes from the start to a goal that leave a box.

    `from_start` is the cost to each cell of the box, (rows, cols) padded and flat. The box's first cell is
    cell (top, left) of the area. `label` and `old_straight` are older labels and costs of the whole area, of
    `area_rows` rows and width - 2 columns. `ratio` · min(label, `valid_below`) is a valid lower bound.
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
            to_go = ratio * (min(label[in_area], valid_below) - old_straight[in_area])
            if from_start[in_box] < np.inf:
                best = min(best, from_start[in_box] + to_go)
    return best
