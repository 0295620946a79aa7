"""The field of a large area by compiled kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels import buckets, descent
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.field import Field
from swarmctl.planners.kernels.lattice import Floats, Ints, offsets_of

NO_LENGTHS = np.empty(0)


class LargeField(Field):
    """A field whose memory can be used for another search."""

    def __init__(self, rows: int, cols: int) -> None:
        super().__init__(rows, cols)
        size = (rows + 2) * (cols + 2)
        self.w = 0.0
        self.step = 0.0
        self.straight = np.empty(size)
        self.label = np.empty(size)
        self.goals = np.empty(0, dtype=np.int64)
        self.greatest, self.has_walls = 0.0, False
        """greatest finite cost of a straight step, and True if there are walls"""
        self.span = 1.0
        """width of a bucket of the search"""
        self._lengths: list[Floats] = []
        """At most one array of known lengths of routes [cells]. `path_from` removes the array during its
        work, because threads may share a field."""

    def cost(self) -> Floats:
        cost = compiled(descent.costs)(
            self.label, self.step, self.extra, self.straight, self.rows, self.cols, self.has_walls
        )
        cost[self.goals // self.width - 1, self.goals % self.width - 1] = 0.0
        cost.flags.writeable = False
        return cost

    def cost_of(self, cell: Cell) -> float:
        m = self.index(cell)
        if descent.is_goal(self.goals, m):
            return 0.0
        offsets = offsets_of(self.width)
        return compiled(descent.cost_of)(self.label, self.step, self.extra, self.straight, offsets, m)

    def path_from(self, start: Cell) -> Ints:
        try:
            length = self._lengths.pop()
        except IndexError:
            length = NO_LENGTHS
        path, length = compiled(descent.descend)(
            self.label, self.step, self.extra, self.straight, self.has_walls, self.width, self.goals,
            self.index(start), length,
        )  # fmt: skip
        self._lengths[:] = [length]
        return np.stack(np.divmod(path, self.width), axis=1) - 1

    def search(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> None:
        """Compute the field for P_s of shape (rows, cols), without checks."""
        seeds = self._begin_search(exposure, goals, w, psi_per_cell)
        self._write_straight(exposure, self.straight)
        highest = float(exposure.max())
        self.has_walls = math.isinf(highest)
        if self.has_walls:
            highest = float(exposure.max(where=np.isfinite(exposure), initial=0.0))
        self.greatest = w * highest + self.step
        self.span = buckets.span_of(self.straight, self.greatest)
        self._lengths.clear()
        self.label.fill(np.inf)
        self.label[self.goals] = seeds
        self._spread(self.label, self.goals)

    def labels_from(self, start: Cell) -> Floats:
        """Return the least cost from `start`, which is no wall, to each cell: padded and flat."""
        labels = np.full(self.label.size, np.inf)
        m = self.index(start)
        labels[m] = 0.0
        self._spread(labels, np.array([m]))
        return labels

    def spread_lowered(self, cells: Ints, until: float) -> Ints:
        """Spread lowered labels of `cells`, least first, up to `until`; return the cells not spread yet."""
        return self._spread(self.label, cells, until)

    def _spread(self, label: Floats, seeds: Ints, until: float = np.inf) -> Ints:
        return buckets.settle(
            label, self.straight, self.extra, self.width, seeds, self.span, self.has_walls, until
        )


def spread_large(
    exposure: Floats,
    goals: Sequence[Cell],
    w: float,
    psi_per_cell: float,
    *,
    into: Field | None = None,
) -> LargeField:
    """Return the field by Eq. 5 for P_s of shape (rows, cols), by compiled kernels, without checks.

    `into` is an older, unused field. A large field of the same shape is overwritten to save memory.
    """
    rows, cols = exposure.shape
    if not isinstance(into, LargeField) or (into.rows, into.cols) != (rows, cols):
        into = LargeField(rows, cols)
    into.search(compilable(exposure), goals, w, psi_per_cell)
    return into


def compilable(exposure: Floats) -> Floats:
    """Return the array, or a contiguous and writeable copy, as the compiled kernels require."""
    return np.require(exposure, dtype=np.float64, requirements=["C", "W"])
