"""A long route for a vehicle that is early: the least exposed route found within a window of lengths.

The search begins with the least exposed route within the upper bound, as in `constrained`. If this route is
too short, the planner tries detours over one cell, and if none is within the window, over two cells. A detour
joins the best routes to the cell and from the cell to a goal, by Eq. 5 at w = 1/2 and ψ = mean exposure. The
answer is the least exposed detour within the window that passes no cell twice. A better route may exist.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import bounds, constrained, kernels
from swarmctl.planners.base import Problem, Route, route_of

USES_W = False
NEEDS_MACHINE_CODE = False
KEEPS_LONGEST = True
KEEPS_SHORTEST = True

N_DETOURS, N_PAIRED = 400, 25
"""greatest number of cells, evenly over the area, for detours over one cell, and over two cells"""
SEARCH = constrained.Params(max_labels=200_000)


class Params(msgspec.Struct, frozen=True):
    """No parameters."""


def plan(problem: Problem, _params: Params) -> Route:
    """Return the least exposed route found within both bounds on length; `w` and ψ have no influence.

    Raises Unreachable, and BoundTooTight with the longest route found below the lower bound, or with the
    shortest route if all routes are above the upper bound.
    """
    nearest = constrained.plan(replace(problem, min_length_cells=0.0), SEARCH)
    if bounds.keeps(problem, nearest.cells):
        return nearest
    detours = _Detours(problem)
    for routes in (detours.over_one, detours.over_two):
        best: Route | None = None
        for cells in routes():
            found = route_of(problem, cells, measures.exposure_sum(problem.exposure, cells))
            if bounds.keeps(problem, cells):
                if best is None or (found.cost, found.length_cells) < (best.cost, best.length_cells):
                    best = found
            elif nearest.length_cells < found.length_cells < problem.min_length_cells:
                nearest = found
        if best is not None:
            return best
    raise bounds.none_between(problem, "no detour over one or two cells", nearest)


measure = constrained.measure


class _Detours:
    """Routes without repeated cells from the start to a goal, over one or two chosen cells."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._passable = problem, problem.passable
        finite = self._passable[np.isfinite(self._passable)]
        self._price = float(finite.mean()) if finite.size and finite.mean() > 0.0 else 1.0
        self._to_goals = self._field_to(problem.goals)
        self._to_start = self._field_to((problem.start,))

    def over_one(self) -> Iterator[tuple[Cell, ...]]:
        for over in self._cells(N_DETOURS):
            to_cell = reversed(self._to_start.route_from(over))
            yield from _if_simple((*to_cell, *self._to_goals.route_from(over)[1:]))

    def over_two(self) -> Iterator[tuple[Cell, ...]]:
        cells = list(self._cells(N_PAIRED))
        for second in cells:
            to_second, onward = self._field_to((second,)), self._to_goals.route_from(second)
            for first in cells:
                if first != second and not math.isinf(to_second.cost_of(first)):
                    to_first = reversed(self._to_start.route_from(first))
                    yield from _if_simple((*to_first, *to_second.route_from(first)[1:], *onward[1:]))

    def _field_to(self, goals: Sequence[Cell]) -> kernels.Field:
        return kernels.spread(self._passable, goals, 0.5, self._price)

    def _cells(self, most: int) -> Iterator[Cell]:
        """Yield at most `most` cells that a route can pass, evenly over the area with its edges."""
        rows, cols = self._passable.shape
        n = math.isqrt(most)
        ends = {self._problem.start, *self._problem.goals}
        for row in sorted({round(r) for r in np.linspace(0, rows - 1, min(n, rows))}):
            for col in sorted({round(c) for c in np.linspace(0, cols - 1, min(n, cols))}):
                over = (row, col)
                if over in ends or not math.isfinite(self._passable[over]):
                    continue
                if not (math.isinf(self._to_goals.cost_of(over)) or math.isinf(self._to_start.cost_of(over))):
                    yield over


def _if_simple(cells: tuple[Cell, ...]) -> Iterator[tuple[Cell, ...]]:
    """Yield the route if it passes no cell twice."""
    if len(set(cells)) == len(cells):
        yield cells
