"""A route that takes its time: the least exposed within a window of lengths, if need be longer than any that
a w finds.

Within the upper bound the least exposed route is found as by `constrained`. Where that is too short, ways
over one cell in between are tried, and over two: the best way there and the best way on, by Eq. 5 at a
middling price of length. Of those that fit and cross themselves nowhere it is the least exposed; nobody
proves that there is no better one, for the longest path is a hard problem. For vehicles that are early.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import bounds, constrained, kernels
from swarmctl.planners.base import Problem, Route, is_open, route_of

USES_W = False

MOST_TRIED, PAIRS_OF = 400, 25
"""cells in between, evenly over the area; and of those that are tried by twos"""


@dataclass(frozen=True, slots=True)
class Params:
    """How long to search."""

    max_labels: int = 200_000
    """as of `constrained`"""


def plan(problem: Problem, params: Params) -> Route:
    """The least exposed route found within both bounds on length; w and ψ do not matter.

    Raises Unreachable; BoundTooTight with the route that misses the bounds least.
    """
    upper = replace(problem, min_length_cells=0.0)
    nearest = constrained.plan(upper, constrained.Params(max_labels=params.max_labels))
    if bounds.keeps(problem, nearest.cells):
        return nearest
    between = _Between(problem)
    for ways in (between.over_one, between.over_two):
        best: Route | None = None
        for cells in ways():
            found = route_of(problem, cells, measures.exposure_sum(problem.exposure, cells))
            if bounds.keeps(problem, cells):
                if best is None or (found.cost, found.length_cells) < (best.cost, best.length_cells):
                    best = found
            elif nearest.length_cells < found.length_cells < problem.min_length_cells:
                nearest = found
        if best is not None:
            return best
    raise bounds.none_between(problem, "no route over one or two cells in between", nearest)


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """ΣP_s; infinite through a wall and where it does not keep the bounds on length."""
    if not (is_open(problem, cells) and bounds.keeps(problem, cells)):
        return math.inf
    return measures.exposure_sum(problem.exposure, cells)


class _Between:
    """Ways from the start to a goal over cells in between, each the best there and the best on; those that
    cross themselves nowhere."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._passable = problem, problem.passable
        finite = self._passable[np.isfinite(self._passable)]
        self._price = float(finite.mean()) if finite.size and finite.mean() > 0.0 else 1.0
        self._on = self._to(problem.goals)
        self._back = self._to((problem.start,))

    def over_one(self) -> Iterator[tuple[Cell, ...]]:
        for over in self._cells(MOST_TRIED):
            yield from _simple((*reversed(self._back.run_down(over)), *self._on.run_down(over)[1:]))

    def over_two(self) -> Iterator[tuple[Cell, ...]]:
        cells = list(self._cells(PAIRS_OF))
        for second in cells:
            to_second, on = self._to((second,)), self._on.run_down(second)
            for first in cells:
                if first != second and not math.isinf(to_second.cost_of(first)):
                    there = (*reversed(self._back.run_down(first)), *to_second.run_down(first)[1:])
                    yield from _simple((*there, *on[1:]))

    def _to(self, goals: Sequence[Cell]) -> kernels.Field:
        return kernels.spread(self._passable, goals, 0.5, self._price)

    def _cells(self, most: int) -> Iterator[Cell]:
        """Evenly over the area, of those that lie between; both edges among them."""
        rows, cols = self._passable.shape
        n = math.isqrt(most)
        ends = {self._problem.start, *self._problem.goals}
        for row in sorted({round(r) for r in np.linspace(0, rows - 1, min(n, rows))}):
            for col in sorted({round(c) for c in np.linspace(0, cols - 1, min(n, cols))}):
                over = (row, col)
                if over in ends or not math.isfinite(self._passable[over]):
                    continue
                if not (math.isinf(self._on.cost_of(over)) or math.isinf(self._back.cost_of(over))):
                    yield over


def _simple(cells: tuple[Cell, ...]) -> Iterator[tuple[Cell, ...]]:
    if len(set(cells)) == len(cells):
        yield cells
