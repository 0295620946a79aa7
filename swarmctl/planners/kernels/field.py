"""The least cost from every cell to a goal, and the cheapest routes.

The label of a cell is its cost to go plus w·P_s of the cell. Labels are the least fixed point of

    label[m] = min over neighbours n of (label[n] + extra, if the step is diagonal) + straight[m]

with `straight` the cost of a straight step into a cell, and `extra` the additional cost of a diagonal step.
Rounded additions are monotone, so every search finds the same fixed point, bit for bit. The methods for small
areas (`small_field`) and for large areas (`large_field`) therefore give equal fields.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence

import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.lattice import ROOT2, Floats, Ints

SMALL_CELLS = 64 * 64
"""Largest area searched without machine code [cells]. One field of this size takes about 3 ms, a planner with
bounds about 30 ms. The compiler would take 10 s."""
MAX_FLOAT = np.finfo(np.float64).max


def is_small(n_cells: int) -> bool:
    """Return whether an area of this size is searched without machine code."""
    return n_cells <= SMALL_CELLS


class Field(abc.ABC):
    """The labels of `rows` × `cols` cells, and their costs and routes. The arrays are padded and flat."""

    w: float
    step: float
    """cost of a straight step without the exposure of the entered cell: (1 − w)·ψ"""
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
        """Return the least cost from every cell to a goal, (rows, cols), read-only."""

    @abc.abstractmethod
    def cost_of(self, cell: Cell) -> float:
        """Return the least cost from a cell to a goal; infinite without a route."""

    @abc.abstractmethod
    def path_from(self, start: Cell) -> Ints:
        """Return the route from a start of finite cost to a goal, as rows and columns, (n, 2)."""

    def route_from(self, start: Cell) -> tuple[Cell, ...]:
        """Return the route from a start of finite cost to a goal, both included."""
        rows, cols = self.path_from(start).T.tolist()
        return tuple(zip(rows, cols, strict=True))

    def matches(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> bool:
        """Return whether a new search with these arguments would give this field."""
        return (
            self.w == w
            and self.step == (1.0 - w) * psi_per_cell
            and exposure.shape == (self.rows, self.cols)
            and np.array_equal(self.goals, self._flat(goals))
            and np.array_equal(self.straight, self._write_straight(exposure, np.empty(self.straight.size)))
        )

    def _write_straight(self, exposure: Floats, straight: Floats) -> Floats:
        """Write the costs of straight steps for P_s of shape (rows, cols), in place, and return them."""
        padded = straight.reshape(self.rows + 2, self.width)
        padded[0] = padded[-1] = padded[:, 0] = padded[:, -1] = np.inf
        inner = padded[1:-1, 1:-1]
        with np.errstate(invalid="ignore"):
            np.multiply(exposure, self.w, out=inner)
        straight += self.step
        if self.w == 0.0:
            inner[np.isinf(exposure)] = np.inf
        return straight

    def _begin_search(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> Floats:
        """Store `w`, `step` and `goals`; return the labels of the goals."""
        self.w, self.step, self.goals = w, (1.0 - w) * psi_per_cell, self._flat(goals)
        at_goals = exposure[self.goals // self.width - 1, self.goals % self.width - 1]
        return np.where(np.isinf(at_goals), np.inf, w * np.minimum(at_goals, MAX_FLOAT))

    def _flat(self, goals: Sequence[Cell]) -> Ints:
        return np.array(sorted({self.index(goal) for goal in goals}), dtype=np.int64)
