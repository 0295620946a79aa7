"""A first guess of the whole field, nearly always right nearly everywhere, at a fraction of a search's price.

A route is monotone most of the way: it gains rows, or columns, without giving one back. All such routes are
found by carrying labels outward from the goals once by columns and once by rows, each column (row) served
from the one before and then along itself, up and down. That is a few additions a cell, in the order of
memory, with no queue and no branch to guess wrong. What is left, routes that turn back, `buckets` puts
right.

Where there are walls, diagonal steps past their corners are left out as in `squeezes`; asking for it costs a
quarter of the time, so there are two loops each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from swarmctl.planners.kernels.lattice import Floats, Ints, offered


@njit(nogil=True, cache=True)
def extent(exposure: Floats) -> tuple[int, float]:
    """How many values are NaN or negative, and the greatest finite one."""
    n_bad, greatest = 0, 0.0
    rows, cols = exposure.shape
    for row in range(rows):
        for col in range(cols):
            p_s = exposure[row, col]
            n_bad += not p_s >= 0.0
            greatest = max(greatest, p_s if p_s < np.inf else 0.0)
    return n_bad, greatest


@njit(nogil=True, cache=True)
def prepare(exposure: Floats, w: float, step: float, straight: Floats) -> tuple[float, float, bool]:
    """Writes what a straight step into each cell costs, (rows, cols) into the padded flat `straight`.

    Returns the least and the greatest finite of them, and whether there are walls.
    """
    rows, cols = exposure.shape
    width = cols + 2
    straight[:width] = np.inf
    straight[(rows + 1) * width :] = np.inf
    least, greatest, n_walls = np.inf, 0.0, 0
    for row in range(rows):
        base = (row + 1) * width + 1
        straight[base - 1] = np.inf
        straight[base + cols] = np.inf
        for col in range(cols):
            p_s = exposure[row, col]
            cost = w * p_s + step if p_s < np.inf else np.inf  # a wall stays one for w = 0 too
            straight[base + col] = cost
            least = min(least, cost)
            finite = cost if cost < np.inf else 0.0
            greatest = max(greatest, finite)
            n_walls += cost == np.inf
    return least, greatest, n_walls > 0


@njit(nogil=True, cache=True)
def is_prepared(exposure: Floats, w: float, step: float, straight: Floats) -> bool:
    """Whether `straight` is what `prepare` would write."""
    rows, cols = exposure.shape
    for row in range(rows):
        base = (row + 1) * (cols + 2) + 1
        for col in range(cols):
            p_s = exposure[row, col]
            if straight[base + col] != (w * p_s + step if p_s < np.inf else np.inf):
                return False
    return True


@njit(nogil=True, cache=True)
def sweep_columns(
    label: Floats,
    straight: Floats,
    extra: float,
    walls: bool,
    width: int,
    rows: int,
    first: int,
    end: int,
    way: int,
) -> None:
    """Carries labels from column to column, `first` up to `end` in the direction `way` (1 or -1)."""
    for col in range(first, end, way):
        before = col - way
        lower, middle = label[before], label[width + before]
        carried = np.inf
        for row in range(1, 1 if walls else rows + 1):
            here = row * width + col
            upper = label[here + width - way]
            from_before = min(min(lower, upper) + extra, middle)
            lower, middle = middle, upper
            carried = min(label[here], min(from_before, carried) + straight[here])
            label[here] = carried
        for row in range(1, rows + 1 if walls else 1):
            here = row * width + col
            beside = straight[here - way]
            low = _past(label[here - way - width], beside, straight[here - width])
            high = _past(label[here - way + width], beside, straight[here + width])
            from_before = min(min(low, high) + extra, label[here - way])
            carried = min(label[here], min(from_before, carried) + straight[here])
            label[here] = carried
        carried = np.inf
        for row in range(rows, 0, -1):
            here = row * width + col
            carried = min(label[here], carried + straight[here])
            label[here] = carried


@njit(nogil=True, cache=True)
def sweep_rows(
    label: Floats,
    straight: Floats,
    extra: float,
    walls: bool,
    width: int,
    cols: int,
    first: int,
    end: int,
    way: int,
) -> None:
    """Carries labels from row to row, `first` up to `end` in the direction `way` (1 or -1)."""
    for row in range(first, end, way):
        base = row * width
        before = base - way * width
        if walls:
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


@njit(nogil=True, cache=True)
def improvable(label: Floats, straight: Floats, extra: float, walls: bool, rows: int, cols: int) -> Ints:
    """The cells whose label any neighbour betters, with the better label put in."""
    width = cols + 2
    counts = np.zeros(rows + 1, dtype=np.int64)
    for row in range(1, rows + 1):
        count = 0
        if walls:
            for here in range(row * width + 1, row * width + cols + 1):
                count += (
                    _offered_past_walls(label, straight, extra, width, here) + straight[here] < label[here]
                )
        else:
            for here in range(row * width + 1, row * width + cols + 1):
                count += offered(label, extra, width, here) + straight[here] < label[here]
        counts[row] = count
    found = np.empty(counts.sum(), dtype=np.int64)
    better = np.empty(found.size)
    size = 0
    for row in range(1, rows + 1):
        if counts[row] == 0:
            continue
        for here in range(row * width + 1, row * width + cols + 1):
            if walls:
                served = _offered_past_walls(label, straight, extra, width, here)
            else:
                served = offered(label, extra, width, here)
            served += straight[here]
            if served < label[here]:
                found[size] = here
                better[size] = served
                size += 1
    label[found] = better
    return found


@njit(nogil=True, cache=True)
def _offered_past_walls(label: Floats, straight: Floats, extra: float, width: int, here: int) -> float:
    """As `offered`, where diagonal steps may be closed."""
    west, east = straight[here - 1], straight[here + 1]
    south, north = straight[here - width], straight[here + width]
    low = min(_past(label[here - width - 1], west, south), _past(label[here - width + 1], east, south))
    high = min(_past(label[here + width - 1], west, north), _past(label[here + width + 1], east, north))
    near = min(label[here - 1], label[here + 1], label[here - width], label[here + width])
    return float(min(near, min(low, high) + extra))


@njit(nogil=True, cache=True)
def _past(label: float, beside: float, other: float) -> float:
    """The label of a diagonal neighbour, which serves nobody past the corner of a wall."""
    return label if beside < np.inf and other < np.inf else np.inf
