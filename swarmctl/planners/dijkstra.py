"""The paper's planner: the route of least Eq. 5, C_mn = (1 − w)·ψ·d_mn + w·P_s(n).

With gains the cost is C_mn = (1 − w)·ψ·d_mn + max(0, w·P_s(n) − gain(n)) (`benevolence`).

The field of the cost to go is spread backwards from the goals, and the route runs down the field (the paper's
hill climbing). One field serves every start. `planners.PLANNERS` names all planners; `base.Planner` is their
interface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import (
    Problem,
    Route,
    Unreachable,
    checked_cell,
    checked_field,
    eq5_cost,
    is_open,
    route_of,
)
from swarmctl.planners.pool import Pool
from swarmctl.planners.replan import Replanner

USES_W = True
NEEDS_MACHINE_CODE = False
KEEPS_LONGEST = False
KEEPS_SHORTEST = False


class Params(msgspec.Struct, frozen=True):
    """No parameters: w and ψ are part of the problem."""


class CostToGo(msgspec.Struct, frozen=True, eq=False):
    """The least cost by Eq. 5 from every cell to the nearest goal."""

    cost: NDArray[np.float64]
    """(rows, cols); infinite if no route leads to a goal"""
    _field: kernels.Field

    def cells_from(self, start: Cell) -> tuple[Cell, ...]:
        """Return the route from `start` to a goal, both included.

        A vehicle that has followed the route to a cell gets the same remaining route from that cell. Raises
        BadProblem if the start is outside the area, Unreachable if no route leads to a goal.
        """
        return self._field.route_from(self._checked(start))

    def paths_from(self, starts: Sequence[Cell]) -> list[NDArray[np.int64]]:
        """Return the routes of a whole swarm: for each start the (row, col) of its cells, shape (n, 2).

        Raises as `cells_from` does.
        """
        return [self._field.path_from(cell) for cell in [self._checked(start) for start in starts]]

    def _checked(self, start: Cell) -> Cell:
        cell = checked_cell("start", start, self.cost)
        if math.isinf(self.cost[cell]):
            raise Unreachable(f"no route leads from {cell} to a goal: walls lie between")
        return cell


def plan(problem: Problem, _params: Params) -> Route:
    """Return the route of least cost by Eq. 5; among equal costs the shortest, then by a fixed rule.

    Earlier searches for the same goals and weights make the search faster, and do not change the route.
    """
    exposure = problem.less_gain(problem.passable)  # cells above the maximum exposure are walls here
    search = _search_again if exposure.size >= LARGE_AREA_CELLS else _search_all
    try:
        return route_of(problem, search(problem, exposure))
    except Unreachable:
        raise problem.unreachable() from None


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """Return Σ C_mn (Eq. 5); infinite through a wall."""
    return eq5_cost(problem, cells) if is_open(problem, cells) else math.inf


LARGE_AREA_CELLS = 100_000
"""smallest number of cells of an area that is replanned in a box around the old route (`replan`)"""
MAX_KEPT_CELLS = 8_000_000
"""greatest number of cells of such areas in memory, some 40 bytes each"""

_fields: Pool[kernels.Field] = Pool()
_replanners: Pool[Replanner] = Pool()


def _search_all(problem: Problem, exposure: NDArray[np.float64]) -> tuple[Cell, ...]:
    """Search the whole area, or descend in the last field if it matches the problem.

    Vehicles with one goal and one belief ask for the same field one after the other.
    """
    asked = exposure, problem.goals, problem.w
    taken = _fields.take_all()
    field = taken[-1] if taken else None
    if field is None or not field.matches(*asked, problem.psi_per_cell):
        field = kernels.spread(*asked, problem.psi_per_cell, into=field)
    try:
        if math.isinf(field.cost_of(problem.start)):
            raise problem.unreachable()
        return field.route_from(problem.start)
    finally:
        _fields.put([field], lambda _: 1, max_total=1)


def _search_again(problem: Problem, exposure: NDArray[np.float64]) -> tuple[Cell, ...]:
    """Search around the old route, if an earlier search had these goals and weights; else search the area."""
    key = exposure.shape, problem.goals, problem.w, problem.psi_per_cell
    taken = _replanners.take_all()
    planner = next((kept for kept in taken if kept.problem_key == key), None)
    _replanners.put([kept for kept in taken if kept is not planner], Replanner.size, MAX_KEPT_CELLS)
    if planner is None:
        planner = Replanner(exposure, problem.goals, problem.w, problem.psi_per_cell)
    else:
        planner.renew(exposure)
    try:
        return planner.route(problem.start)
    finally:
        _replanners.put([planner], Replanner.size, MAX_KEPT_CELLS)


def cost_to_go(
    exposure: NDArray[np.float64], goals: Sequence[Cell], w: float, psi_per_cell: float
) -> CostToGo:
    """Return the whole field for P_s of shape (rows, cols), for all starts. Raises BadProblem."""
    array, cells = checked_field(exposure, goals, w, psi_per_cell)
    field = kernels.spread(array, cells, w, psi_per_cell)
    return CostToGo(field.cost(), field)
