"""The paper's planner: the route of least Eq. 5, C_mn = (1 − w)·ψ·d_mn + w·P_s(n).

A field of the cost that is still to come is spread backwards from the goals, and the route runs down it (the
paper's hill climbing). One field serves every start.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import (
    Problem,
    Route,
    Unreachable,
    check_cell,
    check_field,
    eq5_cost,
    eq5_route,
    is_open,
)


@dataclass(frozen=True, slots=True)
class Params:
    """Nothing to choose: w and ψ are part of the problem."""


@dataclass(frozen=True, slots=True, eq=False)
class CostToGo:
    """The least cost by Eq. 5 from every cell to the nearest goal."""

    cost: NDArray[np.float64]
    """(rows, cols); infinite where no way leads to a goal"""
    _field: kernels.Field

    def cells_from(self, start: Cell) -> tuple[Cell, ...]:
        """The route from `start` to a goal, both included; any tail of it is the route from where it begins.

        Raises BadProblem where the start is outside the area, Unreachable where no way leads to a goal.
        """
        self._check(start)
        return self._field.run_down(start)

    def paths_from(self, starts: Sequence[Cell]) -> list[NDArray[np.int64]]:
        """The routes of a whole swarm at once: for each start the (row, col) of its cells, shape (n, 2).

        Raises as `cells_from` does.
        """
        for start in starts:
            self._check(start)
        return self._field.run_down_all(starts)

    def _check(self, start: Cell) -> None:
        check_cell("start", start, self.cost)
        if math.isinf(self.cost[start]):
            raise Unreachable(f"no way leads from {start} to a goal: walls of infinite exposure lie between")


def plan(problem: Problem, _params: Params) -> Route:
    """The route of least cost by Eq. 5; among equals the shortest, and among these always the same."""
    field = _field_of(problem)
    try:
        if math.isinf(field.cost_of(problem.start)):
            raise problem.unreachable()
        return eq5_route(problem, field.run_down(problem.start))
    finally:
        _kept.append(field)


_kept: deque[kernels.Field] = deque(maxlen=2)
"""The last fields: vehicles with one goal and one belief ask one after the other for the same, and what is
not asked for again leaves its memory to the next. Who uses a field takes it out meanwhile, so that threads do
not meet in one. Whether it is found here or not, the answer is the same."""


def _field_of(problem: Problem) -> kernels.Field:
    """The field of the problem: one that was kept, or a new one in the memory of the oldest."""
    asked = np.ascontiguousarray(problem.passable, dtype=np.float64), problem.goals, problem.w
    taken = [_kept.popleft() for _ in range(len(_kept))]
    found = next((field for field in taken if field.answers(*asked, problem.psi_per_cell)), None)
    spare = taken[0] if found is None and len(taken) == _kept.maxlen else None
    _kept.extend(field for field in taken if field is not found and field is not spare)
    return found or kernels.spread(*asked, problem.psi_per_cell, into=spare)


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """Σ C_mn (Eq. 5); infinite through a wall."""
    return eq5_cost(problem, cells) if is_open(problem, cells) else math.inf


def cost_to_go(
    exposure: NDArray[np.float64], goals: Sequence[Cell], w: float, psi_per_cell: float
) -> CostToGo:
    """The whole field for P_s of shape (rows, cols), for all vehicles with these goals. Raises BadProblem."""
    check_field(exposure, goals, w, psi_per_cell)
    field = kernels.spread(exposure, goals, w, psi_per_cell)
    return CostToGo(field.unpadded_cost(), field)
