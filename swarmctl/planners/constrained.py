"""The least exposed route of all within a bound on length: a resource-constrained shortest path.

No w need find it, for it may lie inside the convex hull of what w finds. First the bound is bracketed as in
`time_bound`, which brings a route within it and a price of length λ at which every route costs at least what
the field says, so that the least exposure is at least the field's cost − λ · bound (the Lagrangian bound).
Then labels that this bound does not rule out are set from the start, the most promising first
(`kernels.labels`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import bounds, kernels
from swarmctl.planners.base import BadProblem, Problem, Route, is_open, route_of
from swarmctl.planners.envelope import Summed, Sweep

ENOUGH = 0.02
"""A gap between the bounds of this share is closed faster by labels than by one more search."""


USES_W = False


@dataclass(frozen=True, slots=True)
class Params:
    """How long to search."""

    max_labels: int | None = 4_000_000
    """labels made at most, some 50 bytes each; 0 or none: as many as it takes"""

    def __post_init__(self) -> None:
        if self.max_labels is not None and self.max_labels < 0:
            raise ValueError(f"max_labels = {self.max_labels}: expected 0 or more")


def plan(problem: Problem, params: Params) -> Route:
    """The least exposed route within the upper bound on length, of equals the shortest; w and ψ do not
    matter.

    `cost` is ΣP_s, `lower_bound` equals it; when `max_labels` are spent the route is the best so far and its
    bound may be less. Raises Unreachable, BoundTooTight with the shortest route, and BadProblem for a lower
    bound on length.
    """
    if problem.min_length_cells > 0.0:
        # The least exposed of the routes longer than something would fly loops, and to find it is as hard as
        # to find a longest path.
        raise BadProblem(
            f"a route of at least {problem.min_length_cells:g} cells: constrained keeps an upper bound only; "
            "take time_bound for an arrival window, or fly slower"
        )
    if problem.start in problem.goals:
        return route_of(problem, (problem.start,), 0.0)
    sweep = Sweep(problem)
    greatest = bounds.window(problem)[1]
    if math.isinf(greatest):
        return _route(sweep, sweep.search(0.0)[0].cells)
    shortest, to_length = sweep.search(math.inf)
    if shortest.length_cells > greatest:
        raise bounds.shortest_too_long(problem, _route(sweep, shortest.cells))
    bracket = sweep.bracket(shortest, greatest, ENOUGH)
    if bracket.field is None:
        return _route(sweep, bracket.short.cells)
    to_go = kernels.ToGo.of(to_length, None, bracket.field, bracket.price)
    return _label(sweep, bracket.short, to_go, params)


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """ΣP_s; infinite through a wall and where it does not keep the bounds on length."""
    if not (is_open(problem, cells) and bounds.keeps(problem, cells)):
        return math.inf
    return measures.exposure_sum(problem.exposure, cells)


def _label(sweep: Sweep, best: Summed, to_go: kernels.ToGo, params: Params) -> Route:
    """What labels find that is less exposed than the best so far, or this one."""
    problem = sweep.problem
    greatest = bounds.window(problem)[1]
    found = kernels.label_search(
        sweep.passable,
        problem.start,
        problem.goals,
        to_go,
        longest_cells=greatest,
        below=best.exposure_sum,
        whole=False,
        max_labels=params.max_labels or 0,
    )
    route = _route(sweep, found.ways[-1] if found.ways else best.cells)
    proved = max(found.least_open - to_go.price * greatest, 0.0)
    return replace(route, lower_bound=min(route.cost, proved))


def _route(sweep: Sweep, cells: tuple[Cell, ...]) -> Route:
    """The route with nothing less exposed than it."""
    exposure = measures.exposure_sum(sweep.problem.exposure, cells)
    route = route_of(sweep.problem, cells, exposure)
    return replace(route, searched=tuple(sweep.searched), lower_bound=exposure)
