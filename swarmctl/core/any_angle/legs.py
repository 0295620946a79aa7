"""Length, exposure and clearance of many straight legs between the cells of a route at once.

Legs run from centre to centre, so their crossings of grid lines and corners are computed in integers.
"""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.any_angle.track import CORNER_LENGTH, WALL_MARGIN, Floats, ThreatMap

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

N_MEASURES = 5
"""rows of a table of measures: length [cells]; ∫P_s ds and ∫−ln(1 − P_s) ds; ΣP_s and Σ−ln(1 − P_s) over the
cells entered after the first"""
INTEGRAL, ENTERED = 1, 3
"""row numbers of ∫P_s ds and of ΣP_s"""


class LegMeasures(msgspec.Struct, frozen=True, eq=False):
    """Measures of n legs."""

    measures: Floats
    """(N_MEASURES, n)"""
    clear: Bools
    """(n,): True for a leg that enters no wall after its first cell, and keeps WALL_MARGIN from corners of
    walls"""


def measure_legs(threat: ThreatMap, begins: Ints, ends: Ints) -> LegMeasures:
    """Return the measures of n straight legs from `begins` to `ends`, (n, 2) rows and columns of cells."""
    delta = ends - begins
    order = np.argsort(-np.abs(delta).max(axis=1), kind="stable")
    walk = _Walk(begins[order], delta[order])
    n = len(order)
    fields = np.stack([threat.p_s, threat.hazard])
    integral, entered, clear = np.zeros((2, n)), np.zeros((2, n)), np.ones(n, dtype=bool)
    for k in range(int(walk.major[0]) + 1 if n else 0):
        # Each step along the longer axis of a leg is a strip, in which the leg crosses one or two cells.
        m = int(np.count_nonzero(walk.major >= k))
        low, high, q_in, q_out = walk.strip(k, m)
        two = q_out > q_in
        cut = np.where(two, (2 * q_out - 1) * walk.major[:m] / np.maximum(2 * walk.minor[:m], 1), high)
        legs = np.arange(m)
        first, second = walk.cells(k, q_in, legs), walk.cells(k, q_out, legs)
        integral[:, :m] += fields[:, *first] * (cut - low) + fields[:, *second] * (high - cut)
        entered[:, :m] += (fields[:, *first] if k else 0.0) + np.where(two, fields[:, *second], 0.0)
        clear[:m] &= ~(threat.blocked[second] & (two | (k > 0)))
        clear[:m] &= ~threat.blocked[first] if k else True
        clear[:m] &= ~_grazes(threat, walk, k, m)
    measures = np.empty((N_MEASURES, n))
    measures[:, order] = np.concatenate(
        (walk.length[None], integral * (walk.length / np.maximum(walk.major, 1)), entered)
    )
    is_clear = np.empty(n, dtype=bool)
    is_clear[order] = clear
    return LegMeasures(measures, is_clear)


class _Walk:
    """Legs in steps along their longer axes: after k steps a leg is k · minor / major cells to the side."""

    def __init__(self, begins: Ints, delta: Ints) -> None:
        steps = np.abs(delta)
        self.major, self.minor = steps.max(axis=1), steps.min(axis=1)
        self.length: Floats = np.hypot(self.major, self.minor)
        self._begins, self._sign = begins, np.sign(delta)
        self._is_row_major = steps[:, 0] >= steps[:, 1]

    def strip(self, k: int, m: int) -> tuple[Floats, Floats, Ints, Ints]:
        """Return start and end of strip k [steps] and the entry and exit cells, for the first m legs.

        Entry and exit are numbers of cells to the side of the start. A leg over a corner continues in the
        diagonal cell.
        """
        major, minor = self.major[:m], self.minor[:m]
        low = np.full(m, max(k - 0.5, 0.0))
        high = np.minimum(k + 0.5, major)
        q_in = (minor * (2 * k - 1) + major) // (2 * major) if k else np.zeros(m, dtype=np.int64)
        q_out = np.where(k < major, (minor * (2 * k + 1) + major - 1) // (2 * np.maximum(major, 1)), minor)
        return low, high, q_in, q_out

    def cells(self, k: int, aside: Ints, legs: Ints) -> tuple[Ints, Ints]:
        """Return rows and columns of `legs` after k steps and `aside` cells to the side."""
        begins, sign, is_row_major = self._begins[legs], self._sign[legs], self._is_row_major[legs]
        rows = begins[:, 0] + sign[:, 0] * np.where(is_row_major, k, aside)
        cols = begins[:, 1] + sign[:, 1] * np.where(is_row_major, aside, k)
        return rows, cols


def _grazes(threat: ThreatMap, walk: _Walk, k: int, m: int) -> Bools:
    """Return a flag for each leg: it comes too near a corner of a wall between strips k and k + 1."""
    major, minor = walk.major[:m], walk.minor[:m]
    crossing = minor * (2 * k + 1) + major
    corner = (crossing + major) // (2 * np.maximum(major, 1))
    off = np.abs(crossing - corner * 2 * major) / (2.0 * np.maximum(walk.length[:m], 1.0))
    near = np.flatnonzero((off <= WALL_MARGIN + CORNER_LENGTH) & (k < major))
    grazes = np.zeros(m, dtype=bool)
    for strip in (k, k + 1):
        for aside in (corner[near] - 1, corner[near]):
            is_begin = (aside == 0) if strip == 0 else np.zeros(len(near), dtype=bool)
            grazes[near] |= threat.blocked[walk.cells(strip, aside, near)] & ~is_begin
    return grazes
