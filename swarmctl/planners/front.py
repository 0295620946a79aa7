"""The whole front of length against exposure: every route that no other beats in both.

The routes that some w finds are the corners of the front's convex hull (`envelope`). Between two neighbours
of them all other routes lie in a triangle, on or above the line that joins the two and below and left of the
corner opposite; labels find them there (`kernels.labels`), with the field of the search that showed the two
to be neighbours as the bound (the two-phase method of Ulungu and Teghem 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from swarmctl.planners import bounds, kernels
from swarmctl.planners.base import BadProblem, Problem, Route, eq5_route
from swarmctl.planners.envelope import Summed, Sweep

MAX_LABELS = 20_000_000
"""made at most where nothing else is said, over all triangles together; one takes 50 bytes"""


@dataclass(frozen=True, slots=True)
class Front:
    """Routes from short and exposed to long and safe.

    Points that differ by rounding alone are one: lengths by less than LENGTH_TIE, or exposures by less than a
    part REL_TIE at each step of the way.
    """

    routes: tuple[Route, ...]
    """one a point, by length; `cost` is Eq. 5 at the problem's w"""
    supported: tuple[bool, ...]
    """whether some w > 0 finds it: a corner of the front's convex hull. A route on an edge of the hull is
    none: at the only w at which it is the cheapest a shorter one costs the same, and is taken."""
    w_ranges: tuple[tuple[float, float] | None, ...]
    """from which to which w in [0, 1] `dijkstra` gives it; None if at none. At the w where two ranges meet it
    gives the shorter route; at w = 0 any of the shortest ones. Where ψ = 0, no w finds more than the two
    ends."""
    complete: bool
    """False if the labels were spent: every supported route is here, and of the others some"""


def pareto_front(problem: Problem, *, max_labels: int | None = None) -> Front:
    """All non-dominated points (length, ΣP_s) within the problem's bounds on length, with a route each.

    `max_labels` is the budget (none: MAX_LABELS; 0: as many as it takes). Raises Unreachable, and
    BoundTooTight where no point is within the bounds.
    """
    budget = MAX_LABELS if max_labels is None else max_labels
    if budget < 0:
        raise BadProblem(f"max_labels = {budget}: expected 0 or more")
    sweep = Sweep(problem)
    if problem.start in problem.goals:
        return _front(sweep, _Points(Summed((problem.start,), 0.0, 0.0)))
    window = bounds.window(problem)
    short, to_length = sweep.search(math.inf)
    if short.length_cells > window[1]:
        raise bounds.shortest_too_long(problem, eq5_route(problem, short.cells))
    long, to_exposure = sweep.search(0.0)
    points = _Points(long)
    labels = 0
    for edge in sweep.edges(short, long, window):
        points.edges.append((edge.short, edge.long, edge.price))
        if budget and labels >= budget:
            points.complete = False
            continue
        found = kernels.label_search(
            sweep.passable,
            problem.start,
            problem.goals,
            kernels.ToGo.of(to_length, to_exposure, edge.field, edge.price),
            longest_cells=min(edge.long.length_cells - 2.0 * kernels.LENGTH_TIE, window[1]),
            below=edge.short.exposure_sum,
            whole=True,
            max_labels=budget - labels if budget else 0,
        )
        labels += found.labels
        points.inside += [sweep.summed(cells) for cells in found.ways]
        points.complete = points.complete and math.isinf(found.least_open)
    return _front(sweep, points)


@dataclass(slots=True)
class _Points:
    """What was found so far."""

    safest: Summed
    edges: list[tuple[Summed, Summed, float]] = field(default_factory=list)
    """neighbours and the price of length where they cost the same"""
    inside: list[Summed] = field(default_factory=list)
    """routes that no w finds"""
    complete: bool = True


def _front(sweep: Sweep, points: _Points) -> Front:
    """The points within the bounds, by length."""
    problem = sweep.problem
    least, greatest = bounds.window(problem)
    ranges: dict[Summed, tuple[float, float]] = {}
    for short, long, price in points.edges:
        ranges[short] = (ranges.get(short, (0.0, 1.0))[0], sweep.weight(price))
        ranges[long] = (sweep.weight(price), 1.0)
    ranges = ranges or {points.safest: (0.0, 1.0)}
    everything = sorted([*ranges, *points.inside], key=lambda route: route.length_cells)
    kept = [route for route in everything if least <= route.length_cells <= greatest]
    if not kept and points.complete:
        nearest = min(everything, key=lambda r: max(least - r.length_cells, r.length_cells - greatest))
        raise bounds.none_between(problem, "no route of the front", eq5_route(problem, nearest.cells))
    return Front(
        tuple(eq5_route(problem, route.cells) for route in kept),
        tuple(route in ranges for route in kept),
        tuple(_w_range(problem, everything[0], route, ranges.get(route)) for route in kept),
        points.complete,
    )


def _w_range(
    problem: Problem, shortest: Summed, route: Summed, weights: tuple[float, float] | None
) -> tuple[float, float] | None:
    """Between two weights; where ψ = 0 all prices of length between the ends fall on w = 0."""
    if problem.psi_per_cell == 0.0 and weights == (0.0, 0.0) and route != shortest:
        return None
    return weights
