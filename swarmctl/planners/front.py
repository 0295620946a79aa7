"""The Pareto front of length and exposure: the routes that no other route dominates.

The routes of the envelope are the corners of the front's convex hull (`envelope`). The other points of the
front between two neighbours lie in a triangle: on or above the line that joins the two, and below and left of
the opposite corner. Labels find these points (`kernels.labels`). The field of the search between the two
neighbours gives lower bounds for the labels (the two-phase method of Ulungu and Teghem 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import msgspec

from swarmctl.planners import bounds, kernels
from swarmctl.planners.base import Problem, Route, checked_count, route_of
from swarmctl.planners.envelope import Envelope, SummedRoute

MAX_LABELS = 20_000_000
"""default limit on the number of labels over all triangles; a label takes about 50 bytes"""


class Front(msgspec.Struct, frozen=True):
    """Routes from short and exposed to long and safe.

    Lengths that differ by less than LENGTH_TIE count as equal, and so do exposures that differ by a share of
    less than REL_TIE.
    """

    routes: tuple[Route, ...]
    """one route for each point, the shortest first; `cost` is Eq. 5 at the problem's w"""
    supported: tuple[bool, ...]
    """True for the corners of the front's convex hull: the routes that `dijkstra` returns at some w > 0 and
    some ψ > 0. A route on an edge of the hull is no corner."""
    w_ranges: tuple[tuple[float, float] | None, ...]
    """Range of w in [0, 1] at which `dijkstra` returns the route; None if there is no such w. At the common w
    of two ranges `dijkstra` returns the shorter route, at w = 0 any of the shortest routes. If ψ = 0, at most
    the two ends of the front have a range."""
    complete: bool
    """False if the limit on labels was reached: `routes` may lack unsupported routes"""


def pareto_front(problem: Problem, *, max_labels: int | None = None) -> Front:
    """Return all non-dominated points (length, ΣP_s) within the bounds on length, with a route each.

    `max_labels` limits the number of labels (None: MAX_LABELS; 0: no limit). Raises BadProblem for an invalid
    limit, Unreachable, and BoundTooTight if the complete front has no point within the bounds.
    """
    budget = MAX_LABELS if max_labels is None else checked_count("max_labels", max_labels)
    envelope = Envelope(problem)
    if problem.start in problem.goals:
        return _front(envelope, _Points(SummedRoute((problem.start,), 0.0, 0.0)))
    window = bounds.window(problem)
    short, to_length = envelope.search(math.inf)
    if short.length_cells > window[1]:
        raise bounds.shortest_too_long(problem, route_of(problem, short.cells))
    long, to_exposure = envelope.search(0.0)
    points = _Points(long)
    n_labels = 0
    for edge in envelope.edges(short, long, window):
        points.edges.append((edge.short, edge.long, edge.price))
        if budget and n_labels >= budget:
            points.complete = False
            continue
        found = kernels.label_search(
            envelope.passable,
            problem.start,
            problem.goals,
            kernels.ToGo.of(to_length, to_exposure, edge.field, edge.price),
            longest_cells=min(edge.long.length_cells - 2.0 * kernels.LENGTH_TIE, window[1]),
            below_exposure=edge.short.exposure_sum,
            whole_front=True,
            max_labels=budget - n_labels if budget else 0,
        )
        n_labels += found.n_labels
        points.unsupported += [envelope.summed(cells) for cells in found.routes]
        points.complete = points.complete and math.isinf(found.least_open)
    return _front(envelope, points)


@dataclass(slots=True)
class _Points:
    """The points found so far."""

    safest: SummedRoute
    edges: list[tuple[SummedRoute, SummedRoute, float]] = field(default_factory=list)
    """neighbours and the price of length at which they cost the same"""
    unsupported: list[SummedRoute] = field(default_factory=list)
    complete: bool = True


def _front(envelope: Envelope, points: _Points) -> Front:
    """Return the front of the points within the bounds, the shortest first."""
    problem = envelope.problem
    least, greatest = bounds.window(problem)
    ranges: dict[SummedRoute, tuple[float, float]] = {}
    for short, long, price in points.edges:
        ranges[short] = (ranges.get(short, (0.0, 1.0))[0], envelope.weight(price))
        ranges[long] = (envelope.weight(price), 1.0)
    ranges = ranges or {points.safest: (0.0, 1.0)}
    everything = sorted([*ranges, *points.unsupported], key=lambda route: route.length_cells)
    kept = [route for route in everything if least <= route.length_cells <= greatest]
    if not kept and points.complete:
        nearest = min(everything, key=lambda r: max(least - r.length_cells, r.length_cells - greatest))
        raise bounds.none_between(problem, "no route of the front", route_of(problem, nearest.cells))
    return Front(
        tuple(route_of(problem, route.cells) for route in kept),
        tuple(route in ranges for route in kept),
        tuple(_w_range(problem, everything[0], route, ranges.get(route)) for route in kept),
        points.complete,
    )


def _w_range(
    problem: Problem, shortest: SummedRoute, route: SummedRoute, weights: tuple[float, float] | None
) -> tuple[float, float] | None:
    """Return the range of w of a route. If ψ = 0, all prices of length above 0 have w = 0."""
    if problem.psi_per_cell == 0.0 and weights == (0.0, 0.0) and route != shortest:
        return None
    return weights
