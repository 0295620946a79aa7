"""The field of the cost that is still to come, from every cell to the nearest goal.

A cell's label is the cost of the way from it plus what entering it costs, so that a neighbour's cost is the
label and the length of the step between. Labels are the least fixed point of

    label[m] = min over n (label[n], + extra if diagonal) + straight[m]

where `straight` is what a straight step into a cell costs and `extra` what a diagonal one costs more.
Rounded additions are monotone, so this fixed point is one and the same bit for bit, whatever finds it:
sweeps, buckets, or a repair of an older field.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels import buckets, descent, sweep
from swarmctl.planners.kernels.lattice import ROOT2, Bytes, Floats, Ints, offsets_of

NONE = np.empty(0)
MAX_FLOAT = np.finfo(np.float64).max


class Field:
    """Padded flat arrays of an area of `rows` × `cols` cells, and how to read them."""

    def __init__(self, rows: int, cols: int) -> None:
        size = (rows + 2) * (cols + 2)
        self.rows = rows
        self.cols = cols
        self.w = 0.0
        self.step = 0.0
        """what a straight step costs whatever it enters: (1 − w)·ψ"""
        self.straight: Floats = np.empty(size)
        self.label: Floats = np.empty(size)
        self.goals: Ints = np.empty(0, dtype=np.int64)
        """flat indices, sorted"""
        self.least, self.greatest, self.walls = 0.0, 0.0, False
        """of what a straight step costs, walls apart, and whether there are any"""
        self._lengths: list[Floats] = []
        """what was found out about the lengths of ways; who runs down takes it out meanwhile, so that threads
        that share a field do not meet in it"""
        self._waiting: Bytes = np.zeros(size, dtype=np.uint8)

    @property
    def width(self) -> int:
        return self.cols + 2

    @property
    def extra(self) -> float:
        """what a diagonal step costs more than a straight one"""
        return self.step * (ROOT2 - 1.0)

    def cost(self) -> Floats:
        """The least cost from every cell, (rows, cols), read-only; worked out anew."""
        cost = descent.costs(
            self.label, self.step, self.extra, self.straight, self.rows, self.cols, self.walls
        )
        cost[self.goals // self.width - 1, self.goals % self.width - 1] = 0.0
        cost.flags.writeable = False
        return cost

    def answers(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> bool:
        """Whether this is the field that `spread` would find for these."""
        asked = self.w == w and self.step == (1.0 - w) * psi_per_cell
        return (
            asked
            and exposure.shape == (self.rows, self.cols)
            and np.array_equal(self.goals, self._flat(goals))
            and sweep.is_prepared(exposure, w, self.step, self.straight)
        )

    def cost_of(self, cell: Cell) -> float:
        m = self.index(cell)
        if descent.is_goal(self.goals, m):
            return 0.0
        return float(
            descent.cost_of(self.label, self.step, self.extra, self.straight, offsets_of(self.width), m)
        )

    def run_down(self, start: Cell) -> tuple[Cell, ...]:
        """The cells from a start with a finite cost to a goal."""
        (path,) = self.run_down_all([start])
        rows, cols = path.T.tolist()
        return tuple(zip(rows, cols, strict=True))

    def run_down_all(self, starts: Sequence[Cell]) -> list[Ints]:
        """For each start, whose cost is finite, the cells to a goal: rows and columns, (n, 2)."""
        if not starts:
            return []
        try:
            length = self._lengths.pop()
        except IndexError:
            length = NONE
        path, ends, length = descent.run_down(
            self.label, self.step, self.extra, self.straight, self.walls, self.width, self.goals,
            np.array([self.index(start) for start in starts], dtype=np.int64), length,
        )  # fmt: skip
        self._lengths[:] = [length]
        return np.split(np.stack(np.divmod(path, self.width), axis=1) - 1, ends[:-1])

    def index(self, cell: Cell) -> int:
        return (cell[0] + 1) * self.width + cell[1] + 1

    def _flat(self, goals: Sequence[Cell]) -> Ints:
        return np.unique(np.array([self.index(goal) for goal in goals], dtype=np.int64))

    def become(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> None:
        """Becomes the field for P_s of shape (rows, cols); no checks."""
        self.w = w
        self.step = (1.0 - w) * psi_per_cell
        self.goals = self._flat(goals)
        self.least, self.greatest, self.walls = sweep.prepare(exposure, w, self.step, self.straight)
        self._lengths.clear()
        at_goals = exposure[self.goals // self.width - 1, self.goals % self.width - 1]
        self.label.fill(np.inf)
        self.label[self.goals] = np.where(np.isinf(at_goals), np.inf, w * np.minimum(at_goals, MAX_FLOAT))
        self._settle(self.label, self.goals)

    def labels_from(self, start: Cell) -> Floats:
        """What it costs to come to each cell from `start`, which is no wall: padded and flat."""
        labels = np.full(self.label.size, np.inf)
        m = self.index(start)
        labels[m] = 0.0
        self._settle(labels, np.array([m]))
        return labels

    def _settle(self, label: Floats, seeds: Ints) -> None:
        """Spreads labels from `seeds`, the only finite ones, until no neighbour betters any."""
        rows, cols, width, extra = self.rows, self.cols, self.width, self.extra
        # Outward from the seeds; where they lie apart the ways cross.
        seed_rows, seed_cols = seeds // width, seeds % width
        for first, end, way in ((int(seed_cols.min()), cols + 1, 1), (int(seed_cols.max()), 0, -1)):
            sweep.sweep_columns(label, self.straight, extra, self.walls, width, rows, first, end, way)
        for first, end, way in ((int(seed_rows.min()), rows + 1, 1), (int(seed_rows.max()), 0, -1)):
            sweep.sweep_rows(label, self.straight, extra, self.walls, width, cols, first, end, way)
        seeds = sweep.improvable(label, self.straight, extra, self.walls, rows, cols)
        self._correct(label, seeds, np.inf)

    def lower(self, cells: Ints, until: float) -> Ints:
        """Passes on the lowered labels of `cells`, least first, up to `until`; returns which still wait."""
        return self._correct(self.label, cells, until)

    def _correct(self, label: Floats, seeds: Ints, until: float) -> Ints:
        waiting: Ints = buckets.correct(
            label, self.straight, self.extra, self.width, seeds,
            self.least, self.greatest, self.walls, self._waiting, until,
        )  # fmt: skip
        return waiting


def spread(
    exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float, *, into: Field | None = None
) -> Field:
    """The cost-to-go field by Eq. 5 for P_s of shape (rows, cols); no checks.

    `into` is an older field of the same shape that is not needed any more: its memory is used again.
    """
    rows, cols = exposure.shape
    if into is None or (into.rows, into.cols) != (rows, cols):
        into = Field(rows, cols)
    into.become(compilable(exposure), goals, w, psi_per_cell)
    return into


def compilable(exposure: Floats) -> Floats:
    """The array, or a copy of the one kind that the kernels are compiled for: contiguous and writeable."""
    return np.require(exposure, dtype=np.float64, requirements=["C", "W"])


def extent(exposure: Floats) -> tuple[int, float]:
    """How many values are NaN or negative, and the greatest finite one."""
    n_bad, greatest = sweep.extent(compilable(exposure))
    return int(n_bad), float(greatest)


def warm_up() -> None:
    """Compiles the kernels or loads them from the cache: no vehicle shall wait for a compiler in flight."""
    uneven = np.zeros((5, 5))
    uneven[1::2, 1] = uneven[2, 3] = 1.0
    extent(uneven)
    for exposure in (uneven, np.where(uneven > 0.0, np.inf, 0.0)):
        found = spread(exposure, [(4, 4)], 1.0, 1.0)
        found.run_down((0, 0))
        found.cost()
