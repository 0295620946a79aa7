"""The paper's search under a time bound (Figure 7): the route of least exposure or distance over all w.

The problem has a bound on length, or a window of lengths. At the vehicle's speed these are a time bound, or
an arrival window. The routes over all w in [0, 1] form a lower envelope (`envelope`). From w = 0 to w = 1 the
routes get longer and less exposed. So the best route is next to a bound. Each search gives the next w to try;
`Route.searched` lists all searches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import msgspec

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import bounds
from swarmctl.planners.base import Problem, Route, is_open, route_of
from swarmctl.planners.envelope import Envelope, SummedRoute

# DEVIATION: the paper searches "in the space of w" without a method. A list of values of w would miss the
# routes of the values between; this search covers every w.

USES_W = False
NEEDS_MACHINE_CODE = False
KEEPS_LONGEST = True
KEEPS_SHORTEST = True


class Params(msgspec.Struct, frozen=True):
    """The measure to minimise among the routes that keep the bounds."""

    minimise: Literal["exposure", "distance"] = "exposure"


def plan(problem: Problem, params: Params) -> Route:
    """Return the best route that keeps the bounds on length; the problem's `w` has no influence.

    Raises Unreachable, and BoundTooTight if no route over all w keeps the bounds.
    """
    if problem.start in problem.goals:
        return _checked(problem, params, [SummedRoute((problem.start,), 0.0, 0.0)], Envelope(problem))
    envelope = Envelope(problem)
    candidates = _least_exposed if params.minimise == "exposure" else _shortest
    return _checked(problem, params, candidates(envelope, *bounds.window(problem)), envelope)


def measure(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    """Return ΣP_s, or the length [cells]; infinite through a wall or out of the bounds."""
    if not (is_open(problem, cells) and bounds.keeps(problem, cells)):
        return math.inf
    return _sum(problem, cells, params)


def _least_exposed(envelope: Envelope, _least: float, greatest: float) -> list[SummedRoute]:
    """Return the longest route of the envelope within the upper bound, and the next longer route."""
    if math.isinf(greatest):
        return [envelope.search(0.0)[0]]
    shortest, _ = envelope.search(math.inf)
    if shortest.length_cells > greatest:
        return [shortest]
    bracket = envelope.bracket(shortest, greatest)
    return [bracket.short] if bracket.long is None else [bracket.short, bracket.long]


def _shortest(envelope: Envelope, least: float, greatest: float) -> list[SummedRoute]:
    """Return the shortest route of the envelope that reaches the lower bound, and the next shorter route."""
    shortest, _ = envelope.search(math.inf)
    if shortest.length_cells > greatest:
        return [shortest]
    if shortest.length_cells >= least:  # several routes may be as short: take the least exposed
        return [envelope.bracket(shortest, shortest.length_cells).short]
    bracket = envelope.bracket(shortest, math.nextafter(least, 0.0))
    return [bracket.short] if bracket.long is None else [bracket.long, bracket.short]


def _checked(problem: Problem, params: Params, candidates: list[SummedRoute], envelope: Envelope) -> Route:
    """Return the candidate that keeps the bounds. Raises BoundTooTight with the nearest candidate."""
    least, greatest = bounds.window(problem)

    def missed_by(route: SummedRoute) -> float:
        return max(least - route.length_cells, route.length_cells - greatest, 0.0)

    best = min(candidates, key=missed_by)
    route = route_of(problem, best.cells, _sum(problem, best.cells, params))
    route = replace(route, searched=tuple(envelope.searched))
    if missed_by(best) == 0.0:
        return route
    if len(candidates) == 1 and best.length_cells > greatest:
        raise bounds.shortest_too_long(problem, route)
    raise bounds.none_between(problem, "no route for any w", route)


def _sum(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    if params.minimise == "distance":
        return measures.length_cells(cells)
    return measures.exposure_sum(problem.exposure, cells)
