"""The field of the cost to go: from every cell to the nearest goal.

A cell's label is the cost from it to a goal plus the cost of entering it. A neighbour's cost is then the
label and the length of the step between. Labels are the least fixed point of

    label[m] = min over n (label[n], + extra if diagonal) + straight[m]

with `straight` the cost of a straight step into a cell, and `extra` the additional cost of a diagonal step.
Rounded additions are monotone, so every search finds the same fixed point, bit for bit. The methods for small
areas (`small_field`) and for large ones (`large_field`) therefore give equal fields.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence

import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.lattice import ROOT2, Floats, Ints

SMALL_CELLS = 64 * 64
"""Areas of at most this size are searched without machine code. At this size one field takes some 3 ms, and a
planner with bounds some 30 ms: too little to wait 20 s for a compiler."""
MAX_FLOAT = np.finfo(np.float64).max


def is_small(n_cells: int) -> bool:
    """Return whether an area of this size is searched without machine code."""
    return n_cells <= SMALL_CELLS


class Field(abc.ABC):
    """The labels of an area of `rows` × `cols` cells, as padded flat arrays, and how to read them."""

    w: float
    step: float
    """cost of a straight step, without what it enters: (1 − w)·ψ"""
    goals: Ints
    """flat indices, sorted"""
    straight: Floats
    """cost of a straight step into each cell; infinite in walls and in the padding"""
    label: Floats

    def __init__(self, rows: int, cols: int) -> None:
        self.rows, self.cols = rows, cols

    @property
    def width(self) -> int:
        """Length of a row with its padding."""
        return self.cols + 2

    @property
    def extra(self) -> float:
        """Additional cost of a diagonal step."""
        return self.step * (ROOT2 - 1.0)

    def index(self, cell: Cell) -> int:
        """Return the flat index of a cell."""
        return (cell[0] + 1) * self.width + cell[1] + 1

    @abc.abstractmethod
    def cost(self) -> Floats:
        """Return the least cost from every cell, (rows, cols), read-only."""

    @abc.abstractmethod
    def cost_of(self, cell: Cell) -> float:
        """Return the least cost from a cell; infinite if no route leads to a goal."""

    @abc.abstractmethod
    def run_down_all(self, starts: Sequence[Cell]) -> list[Ints]:
        """Return, for each start of finite cost, the cells to a goal: rows and columns, (n, 2)."""

    def run_down(self, start: Cell) -> tuple[Cell, ...]:
        """Return the cells from a start of finite cost to a goal."""
        (path,) = self.run_down_all([start])
        rows, cols = path.T.tolist()
        return tuple(zip(rows, cols, strict=True))

    def answers(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> bool:
        """Return whether `spread` would find this field for these arguments."""
        return (
            self.w == w
            and self.step == (1.0 - w) * psi_per_cell
            and exposure.shape == (self.rows, self.cols)
            and np.array_equal(self.goals, self._flat(goals))
            and self._is_of(exposure)
        )

    @abc.abstractmethod
    def _is_of(self, exposure: Floats) -> bool:
        """Return whether `straight` follows from this P_s of the field's shape."""

    def _ask(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> Floats:
        """Store goals and weights; return the labels of the goals before the search."""
        self.w, self.step, self.goals = w, (1.0 - w) * psi_per_cell, self._flat(goals)
        at_goals = exposure[self.goals // self.width - 1, self.goals % self.width - 1]
        return np.where(np.isinf(at_goals), np.inf, w * np.minimum(at_goals, MAX_FLOAT))

    def _flat(self, goals: Sequence[Cell]) -> Ints:
        return np.unique(np.array([self.index(goal) for goal in goals], dtype=np.int64))
