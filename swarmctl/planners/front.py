"""The Pareto front of length and exposure: every route that no other route beats in both.

The routes that some w finds are the corners of the front's convex hull (`envelope`). All other routes between
two neighbours lie in a triangle: on or above the line that joins the two, below and left of the opposite
corner. Labels find these routes (`kernels.labels`). The bound of the labels is the field that proved the two
to be neighbours (the two-phase method of Ulungu and Teghem 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from swarmctl.planners import bounds, kernels
from swarmctl.planners.base import BadProblem, Problem, Route, eq5_route
from swarmctl.planners.envelope import SummedRoute, Sweep

MAX_LABELS = 20_000_000
"""default limit of labels over all triangles; a label takes 50 bytes"""


@dataclass(frozen=True, slots=True)
class Front:
    """Routes from short and exposed to long and safe.

    Two points count as the same if they differ by rounding only: lengths by less than LENGTH_TIE, or
    exposures by a share of less than REL_TIE at each step.
    """

    routes: tuple[Route, ...]
    """one route for each point, by length; `cost` is Eq. 5 at the problem's w"""
    supported: tuple[bool, ...]
    """True for the routes that some w > 0 finds: the corners of the front's convex hull. A route on an edge
    of the hull is no corner: at the only w at which it is the cheapest, a shorter route costs the same."""
    w_ranges: tuple[tuple[float, float] | None, ...]
    """Range of w in [0, 1] at which `dijkstra` returns the route; None if no w finds the route. At the common
    w of two ranges `dijkstra` returns the shorter route, at w = 0 any of the shortest routes. If ψ = 0, only
    the two ends have a range."""
    complete: bool
    """False if the limit on labels was reached: `routes` may lack routes that are not supported"""


def pareto_front(problem: Problem, *, max_labels: int | None = None) -> Front:
    """Return all non-dominated points (length, ΣP_s) within the bounds on length, with a route each.

    `max_labels` limits the labels (None: MAX_LABELS; 0: no limit). Raises Unreachable, and BoundTooTight if
    no point is within the bounds.
    """
    budget = MAX_LABELS if max_labels is None else max_labels
    if budget < 0:
        raise BadProblem(f"max_labels = {budget}: expected 0 or more")
    sweep = Sweep(problem)
    if problem.start in problem.goals:
        return _front(sweep, _Points(SummedRoute((problem.start,), 0.0, 0.0)))
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
        points.inside += [sweep.summed(cells) for cells in found.routes]
        points.complete = points.complete and math.isinf(found.least_open)
    return _front(sweep, points)


@dataclass(slots=True)
class _Points:
    """The points found so far."""

    safest: SummedRoute
    edges: list[tuple[SummedRoute, SummedRoute, float]] = field(default_factory=list)
    """neighbours and the price of length at which they cost the same"""
    inside: list[SummedRoute] = field(default_factory=list)
    """routes that no w finds"""
    complete: bool = True


def _front(sweep: Sweep, points: _Points) -> Front:
    """Return the points within the bounds, by length."""
    problem = sweep.problem
    least, greatest = bounds.window(problem)
    ranges: dict[SummedRoute, tuple[float, float]] = {}
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
    problem: Problem, shortest: SummedRoute, route: SummedRoute, weights: tuple[float, float] | None
) -> tuple[float, float] | None:
    """Return the range of w of a route; if ψ = 0, all prices of length between the ends fall on w = 0."""
    if problem.psi_per_cell == 0.0 and weights == (0.0, 0.0) and route != shortest:
        return None
    return weights
