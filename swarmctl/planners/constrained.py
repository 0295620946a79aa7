"""The least exposed of all routes within a bound on length: a resource-constrained shortest path.

A search over w misses this route if the route lies inside the convex hull of the routes of all w.
The search has two steps:

1. Bracket the bound as in `time_bound`. The result is a route within the bound, and a price of length λ. At
   this price every route costs at least the field's cost. So the least exposure is at least the field's cost
   − λ · bound (the Lagrangian bound).
2. Set labels from the start, the most promising first. Skip the labels that the Lagrangian bound rules out
   (`kernels.labels`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import bounds, kernels
from swarmctl.planners.base import BadProblem, Problem, Route, checked_count, is_open, route_of
from swarmctl.planners.envelope import Envelope, SummedRoute

SMALL_GAP = 0.02
"""gap between the bounds on the least exposure, as a share; for a smaller gap labels are the faster method"""


USES_W = False
NEEDS_MACHINE_CODE = False
KEEPS_LONGEST = True
KEEPS_SHORTEST = False


class Params(msgspec.Struct, frozen=True):
    """The effort of the search."""

    max_labels: int | None = 4_000_000
    """greatest number of labels of about 50 bytes each; 0 or None: no limit"""

    def __post_init__(self) -> None:
        if self.max_labels is not None:
            checked_count("max_labels", self.max_labels)


def plan(problem: Problem, params: Params) -> Route:
    """Return the least exposed route within the upper bound on length; among equal routes the shortest.

    w and ψ have no influence. `cost` is ΣP_s, and `lower_bound` equals `cost`.
    If `max_labels` are used up, the route is the best so far, and its `lower_bound` may be less. Raises
    Unreachable, BoundTooTight with the shortest route, and BadProblem for a lower bound on length.
    """
    if problem.min_length_cells > 0.0:
        # The least exposed route above a length would fly loops. That search is as hard as a longest path.
        raise BadProblem(
            f"the problem asks for a route of at least {problem.min_length_cells:g} cells, but planner "
            "constrained keeps an upper bound only; use time_bound for an arrival window, or fly slower"
        )
    if problem.start in problem.goals:
        return replace(route_of(problem, (problem.start,), 0.0), lower_bound=0.0)
    envelope = Envelope(problem)
    greatest = bounds.window(problem)[1]
    if math.isinf(greatest):
        return _route(envelope, envelope.search(0.0)[0].cells)
    shortest, to_length = envelope.search(math.inf)
    if shortest.length_cells > greatest:
        raise bounds.shortest_too_long(problem, _route(envelope, shortest.cells))
    bracket = envelope.bracket(shortest, greatest, SMALL_GAP)
    if bracket.field is None:
        return _route(envelope, bracket.short.cells)
    to_go = kernels.ToGo.of(to_length, None, bracket.field, bracket.price)
    return _search_by_labels(envelope, bracket.short, to_go, params)


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """Return ΣP_s; infinite through a wall or out of the bounds on length."""
    if not (is_open(problem, cells) and bounds.keeps(problem, cells)):
        return math.inf
    return measures.exposure_sum(problem.exposure, cells)


def _search_by_labels(envelope: Envelope, best: SummedRoute, to_go: kernels.ToGo, params: Params) -> Route:
    """Return the least exposed route that labels find, or `best` if labels find no route."""
    problem = envelope.problem
    greatest = bounds.window(problem)[1]
    found = kernels.label_search(
        envelope.passable,
        problem.start,
        problem.goals,
        to_go,
        longest_cells=greatest,
        below_exposure=best.exposure_sum,
        whole_front=False,
        max_labels=params.max_labels or 0,
    )
    route = _route(envelope, found.routes[-1] if found.routes else best.cells)
    proved = max(found.least_open - to_go.price * greatest, 0.0)
    return replace(route, lower_bound=min(route.cost, proved))


def _route(envelope: Envelope, cells: tuple[Cell, ...]) -> Route:
    """Return a route of these cells, with the exposure as its cost and its lower bound."""
    exposure = measures.exposure_sum(envelope.problem.exposure, cells)
    route = route_of(envelope.problem, cells, exposure)
    return replace(route, searched=tuple(envelope.searched), lower_bound=exposure)
