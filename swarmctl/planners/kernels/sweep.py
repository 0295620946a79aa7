"""A first estimate of a field in which length counts, exact nearly everywhere, in a part of a search's time.

Most parts of a route are monotone: the rows, or the columns, never turn back. Sweeps find all monotone
routes. Sweeps carry labels outward from the goals, first by columns and then by rows. Each column (row) takes
labels from the previous column (row), and then passes labels along its cells in both directions. A sweep
needs no queue, and a few additions for each cell. Afterwards `buckets` corrects the labels of routes that
turn back.

Diagonal steps past the corners of walls are excluded as in `cuts_corner`. That check takes a quarter of the
time, so areas without walls have loops of their own.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.lattice import Floats, Ints, min_neighbour_label


def sweep_columns(
    label: Floats,
    straight: Floats,
    extra: float,
    has_walls: bool,
    width: int,
    rows: int,
    first: int,
    end: int,
    direction: int,
) -> None:
    """Carry labels from column to column, from `first` up to `end`, in `direction` (1 or -1)."""
    for col in range(first, end, direction):
        before = col - direction
        lower, middle = label[before], label[width + before]
        carried = np.inf
        for row in range(1, 1 if has_walls else rows + 1):
            here = row * width + col
            upper = label[here + width - direction]
            from_before = min(min(lower, upper) + extra, middle)
            lower, middle = middle, upper
            carried = min(label[here], min(from_before, carried) + straight[here])
            label[here] = carried
        for row in range(1, rows + 1 if has_walls else 1):
            here = row * width + col
            beside = straight[here - direction]
            low = _past(label[here - direction - width], beside, straight[here - width])
            high = _past(label[here - direction + width], beside, straight[here + width])
            from_before = min(min(low, high) + extra, label[here - direction])
            carried = min(label[here], min(from_before, carried) + straight[here])
            label[here] = carried
        carried = np.inf
        for row in range(rows, 0, -1):
            here = row * width + col
            carried = min(label[here], carried + straight[here])
            label[here] = carried


def sweep_rows(
    label: Floats,
    straight: Floats,
    extra: float,
    has_walls: bool,
    width: int,
    cols: int,
    first: int,
    end: int,
    direction: int,
) -> None:
    """Carry labels from row to row, from `first` up to `end`, in `direction` (1 or -1)."""
    for row in range(first, end, direction):
        base = row * width
        before = base - direction * width
        if has_walls:
            for col in range(1, cols + 1):
                beside = straight[before + col]
                low = _past(label[before + col - 1], beside, straight[base + col - 1])
                high = _past(label[before + col + 1], beside, straight[base + col + 1])
                from_before = min(min(low, high) + extra, label[before + col]) + straight[base + col]
                label[base + col] = min(label[base + col], from_before)
        else:
            for col in range(1, cols + 1):
                diagonal = min(label[before + col - 1], label[before + col + 1]) + extra
                from_before = min(diagonal, label[before + col]) + straight[base + col]
                label[base + col] = min(label[base + col], from_before)
        carried = np.inf
        for here in range(base + 1, base + cols + 1):
            carried = min(label[here], carried + straight[here])
            label[here] = carried
        carried = np.inf
        for here in range(base + cols, base, -1):
            carried = min(label[here], carried + straight[here])
            label[here] = carried


def improve(label: Floats, straight: Floats, extra: float, has_walls: bool, rows: int, cols: int) -> Ints:
    """Improve each label once by its neighbours; return the cells of the improved labels."""
    width = cols + 2
    counts, total = np.empty(rows + 1, dtype=np.int64), 0
    for row in range(1, rows + 1):
        count = 0
        if has_walls:
            for here in range(row * width + 1, row * width + cols + 1):
                count += (
                    _least_reachable_label(label, straight, extra, width, here) + straight[here] < label[here]
                )
        else:
            for here in range(row * width + 1, row * width + cols + 1):
                count += min_neighbour_label(label, extra, width, here) + straight[here] < label[here]
        counts[row] = count
        total += count
    found, better = np.empty(total, dtype=np.int64), np.empty(total)
    size = 0
    for row in range(1, rows + 1):
        if counts[row] == 0:
            continue
        for here in range(row * width + 1, row * width + cols + 1):
            if has_walls:
                improved = _least_reachable_label(label, straight, extra, width, here)
            else:
                improved = min_neighbour_label(label, extra, width, here)
            improved += straight[here]
            if improved < label[here]:
                found[size] = here
                better[size] = improved
                size += 1
    for i in range(total):
        label[found[i]] = better[i]
    return found


def _least_reachable_label(label: Floats, straight: Floats, extra: float, width: int, here: int) -> float:
    """Return `min_neighbour_label` without the steps that pass the corner of a wall."""
    west, east = straight[here - 1], straight[here + 1]
    south, north = straight[here - width], straight[here + width]
    low = min(_past(label[here - width - 1], west, south), _past(label[here - width + 1], east, south))
    high = min(_past(label[here + width - 1], west, north), _past(label[here + width + 1], east, north))
    near = min(label[here - 1], label[here + 1], label[here - width], label[here + width])
    return float(min(near, min(low, high) + extra))


def _past(label: float, beside: float, other: float) -> float:
    """Return the label of a diagonal neighbour; infinite past the corner of a wall."""
    return label if beside < np.inf and other < np.inf else np.inf
