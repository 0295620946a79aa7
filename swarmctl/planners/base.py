"""What a planner is asked and what it answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell


class BadProblem(ValueError):
    """The question makes no sense."""


class Unreachable(ValueError):
    """No way leads from the start to a goal."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Find the best way from `start` to one of `goals`. Raises BadProblem where that is no question."""

    exposure: NDArray[np.float64]
    """P_s, shape (rows, cols), not negative; an infinite one is a wall that nobody may enter, nor pass its
    corner diagonally; a start in a wall may be left in any direction"""
    start: Cell
    goals: tuple[Cell, ...]
    w: float
    """distance anxiety in [0, 1]: 0 is the shortest route, 1 the least exposed one"""
    # ERRATUM: a paragraph of the paper's results swaps the two ("for w = 0 the paths with least ...
    # probability sums, but with maximum distances"). Eq. 5 and section 3 decide.
    psi_per_cell: float
    """ψ, what one cell of way costs"""

    def __post_init__(self) -> None:
        check_field(self.exposure, self.goals, self.w, self.psi_per_cell)
        check_cell("start", self.start, self.exposure)


@dataclass(frozen=True, slots=True)
class Route:
    """Neighbouring cells from the start to a goal, both included, and what they add up to."""

    cells: tuple[Cell, ...]
    cost: float
    """what the planner made least; for `dijkstra` the sum of Eq. 5 over the route"""
    length_cells: float
    exposure_sum: float
    """ΣP_s without the start cell"""
    safety_factor: float
    """∏(1 − P_s) without the start cell"""


class Planner(Protocol):
    """What a module in `PLANNERS` has to offer."""

    @property
    def Params(self) -> Any:  # noqa: N802 - it is a class, found in a module
        """A frozen dataclass that can be made without arguments."""

    def plan(self, problem: Problem, params: Any, /) -> Route:
        """The best route by this planner's measure. Raises Unreachable."""


def eq5_route(problem: Problem, cells: Sequence[Cell]) -> Route:
    """A route with its cost by Eq. 5, summed over its edges."""
    length = measures.length_cells(cells)
    total = measures.exposure_sum(problem.exposure, cells)
    cost = (1.0 - problem.w) * problem.psi_per_cell * length + problem.w * total  # Eq. 5
    return Route(tuple(cells), cost, length, total, measures.safety_factor(problem.exposure, cells))


def check_field(exposure: NDArray[np.float64], goals: Sequence[Cell], w: float, psi_per_cell: float) -> None:
    """Raises BadProblem where Eq. 5 has no meaning."""
    if exposure.ndim != 2 or exposure.size == 0:
        raise BadProblem(f"exposure of shape {exposure.shape}: expected (rows, cols), both at least 1")
    bad = ~(exposure >= 0.0)
    if bad.any():
        row, col = (int(index) for index in np.argwhere(bad)[0])
        raise BadProblem(f"exposure of cell ({row}, {col}) is {exposure[row, col]}: expected 0 or more")
    if not 0.0 <= w <= 1.0:
        raise BadProblem(f"distance anxiety w = {w}: expected 0 (shortest route) to 1 (least exposed)")
    if not (math.isfinite(psi_per_cell) and psi_per_cell >= 0.0):
        raise BadProblem(f"ψ = {psi_per_cell} per cell: expected a finite number, 0 or more")
    if not goals:
        raise BadProblem("no goal: expected at least one cell")
    for goal in goals:
        check_cell("goal", goal, exposure)


def check_cell(what: str, cell: Cell, exposure: NDArray[np.float64]) -> None:
    """Raises BadProblem where a cell is outside the area."""
    rows, cols = exposure.shape
    if not (0 <= cell[0] < rows and 0 <= cell[1] < cols):
        raise BadProblem(
            f"{what} {cell} is outside the area: expected row 0..{rows - 1} and column 0..{cols - 1}"
        )
