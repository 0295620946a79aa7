"""The paper's search under a time bound (Figure 7): among the routes over all w in [0, 1] that keep it, the
one of least exposure, or of least distance.

The planner sees a bound on length, which at the vehicle's speed is one on time, or a window of lengths, which
is one of arrival. The routes over all w are the corners of a lower envelope (`envelope` says which count);
they get longer and less exposed from w = 0 to w = 1, so the answer is a neighbour of the bound, and each
search says which w to try next. What was searched is in `Route.searched`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import bounds
from swarmctl.planners.base import Problem, Route, is_open, route_of
from swarmctl.planners.envelope import Summed, Sweep

# DEVIATION: the paper searches "in the space of w" without saying how. A list of values of w would miss
# routes that only values between them find; here no w is left out.


USES_W = False


@dataclass(frozen=True, slots=True)
class Params:
    """What is made least among the routes that keep the bounds."""

    minimise: Literal["exposure", "distance"] = "exposure"


def plan(problem: Problem, params: Params) -> Route:
    """The best route that keeps the bounds on length; `w` of the problem does not matter.

    Raises Unreachable; BoundTooTight where no route over all w keeps the bounds.
    """
    if problem.start in problem.goals:
        return _checked(problem, params, [Summed((problem.start,), 0.0, 0.0)], Sweep(problem))
    sweep = Sweep(problem)
    candidates = _exposure_least if params.minimise == "exposure" else _distance_least
    return _checked(problem, params, candidates(sweep, *bounds.window(problem)), sweep)


def measure(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    """ΣP_s, or the length [cells]; infinite through a wall and where it does not keep the bounds."""
    if not (is_open(problem, cells) and bounds.keeps(problem, cells)):
        return math.inf
    return _sum(problem, cells, params)


def _exposure_least(sweep: Sweep, _least: float, greatest: float) -> list[Summed]:
    """The longest route within the upper bound, and the one beyond it."""
    if math.isinf(greatest):
        return [sweep.search(0.0)[0]]
    shortest, _ = sweep.search(math.inf)
    if shortest.length_cells > greatest:
        return [shortest]
    bracket = sweep.bracket(shortest, greatest)
    return [bracket.short] if bracket.long is None else [bracket.short, bracket.long]


def _distance_least(sweep: Sweep, least: float, greatest: float) -> list[Summed]:
    """The shortest route within the lower bound, and the one before it."""
    shortest, _ = sweep.search(math.inf)
    if shortest.length_cells > greatest:
        return [shortest]
    if shortest.length_cells >= least:  # of these the least exposed
        return [sweep.bracket(shortest, shortest.length_cells).short]
    bracket = sweep.bracket(shortest, math.nextafter(least, 0.0))
    return [bracket.short] if bracket.long is None else [bracket.long, bracket.short]


def _checked(problem: Problem, params: Params, candidates: list[Summed], sweep: Sweep) -> Route:
    """Of the candidates the one that keeps the bounds; else the error with the one that misses them least."""
    least, greatest = bounds.window(problem)

    def missed_by(route: Summed) -> float:
        return max(least - route.length_cells, route.length_cells - greatest, 0.0)

    best = min(candidates, key=missed_by)
    route = route_of(problem, best.cells, _sum(problem, best.cells, params))
    route = replace(route, searched=tuple(sweep.searched))
    if missed_by(best) == 0.0:
        return route
    if len(candidates) == 1 and best.length_cells > greatest:
        raise bounds.shortest_too_long(problem, route)
    raise bounds.none_between(problem, "no route that a w finds", route)


def _sum(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    if params.minimise == "distance":
        return measures.length_cells(cells)
    return measures.exposure_sum(problem.exposure, cells)
