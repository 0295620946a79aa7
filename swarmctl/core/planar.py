"""Polygons and straight legs on a local plane. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, dist, sin

MIN_CORNER_OFFSET_M = 0.01
"""Least distance of a corner from the line between the neighbouring corners [m]. Without this limit, rounding
adds corners on straight edges, and autopilots store few corners."""

PlanarPoint = tuple[float, float]
"""(east, north) [m]"""


def by_heading(offset: PlanarPoint, heading_rad: float) -> PlanarPoint:
    """Return an offset (forward, right) as (east, north), or (east, north) as (forward, right).

    The heading is clockwise from north [rad]. Both ways are the same reflection.
    """
    (a, b), sin_heading, cos_heading = offset, sin(heading_rad), cos(heading_rad)
    return a * sin_heading + b * cos_heading, a * cos_heading - b * sin_heading


def share_of_leg(point: PlanarPoint, a: PlanarPoint, b: PlanarPoint) -> float:
    """Return how far along the straight leg from a to b its nearest place to a point is: 0 at a, 1 at b."""
    (ax, ay), (bx, by) = a, b
    squared = (bx - ax) ** 2 + (by - ay) ** 2
    share = ((point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)) / squared if squared else 0.0
    return min(max(share, 0.0), 1.0)


def distance_to_leg(point: PlanarPoint, a: PlanarPoint, b: PlanarPoint) -> float:
    """Return the distance from a point to the straight leg from a to b, in the unit of the points."""
    (ax, ay), (bx, by), share = a, b, share_of_leg(point, a, b)
    return dist(point, (ax + share * (bx - ax), ay + share * (by - ay)))


def distance_to_track(point: PlanarPoint, track: Sequence[PlanarPoint]) -> float:
    """Return the distance from a point to a track of one point or more, in the unit of the points."""
    legs = (distance_to_leg(point, a, b) for a, b in pairwise(track))
    return min(legs, default=dist(point, track[0]))


def padded_hull(points: Sequence[PlanarPoint], margin_m: float) -> tuple[PlanarPoint, ...]:
    """Return a convex polygon, counter-clockwise, with all points at least `margin_m` (to 1 cm) inside."""
    m = margin_m
    return convex_hull([(e + de, n + dn) for e, n in points for de in (-m, m) for dn in (-m, m)])


def convex_hull(points: Sequence[PlanarPoint]) -> tuple[PlanarPoint, ...]:
    """Return the convex hull, counter-clockwise, by Andrew's monotone chain.

    Points within MIN_CORNER_OFFSET_M of an edge are left out.
    """
    ordered = sorted(set(points))
    return (*_half_hull(ordered)[:-1], *_half_hull(ordered[::-1])[:-1])


def bounding_box(points: Sequence[PlanarPoint]) -> tuple[PlanarPoint, ...]:
    """Return the least rectangle along the axes around the points, counter-clockwise."""
    (west, east), (south, north) = ((min(values), max(values)) for values in zip(*points, strict=True))
    return (west, south), (east, south), (east, north), (west, north)


def _half_hull(ordered: Sequence[PlanarPoint]) -> list[PlanarPoint]:
    chain: list[PlanarPoint] = []
    for point in ordered:
        while len(chain) >= 2 and _is_redundant(chain[-1], chain[-2], point):
            chain.pop()
        chain.append(point)
    return chain


def _is_redundant(b: PlanarPoint, a: PlanarPoint, c: PlanarPoint) -> bool:
    """Return whether a, b, c turn right, or b is within MIN_CORNER_OFFSET_M of the leg a to c."""
    return _turn(a, b, c) <= 0.0 or distance_to_leg(b, a, c) <= MIN_CORNER_OFFSET_M


def _turn(a: PlanarPoint, b: PlanarPoint, c: PlanarPoint) -> float:
    """Return twice the signed area of a, b, c: positive for a turn to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def contains(polygon: Sequence[PlanarPoint], point: PlanarPoint) -> bool:
    """Return whether a point is inside a simple polygon, convex or not."""
    (e, n), (e1, n1), inside = point, polygon[-1], False
    for e2, n2 in polygon:
        if (n1 > n) != (n2 > n) and e < e1 + (n - n1) * (e2 - e1) / (n2 - n1):
            inside = not inside
        e1, n1 = e2, n2
    return inside


def stays_inside(polygon: Sequence[PlanarPoint], a: PlanarPoint, b: PlanarPoint) -> bool:
    """Return whether the straight leg from a to b neither leaves a simple polygon nor touches its border."""
    if not (contains(polygon, a) and contains(polygon, b)):
        return False
    return not any(_intersect(a, b, c, d) for c, d in _edges(polygon))


def crossing_sides(polygon: Sequence[PlanarPoint]) -> tuple[int, int] | None:
    """Return the first two sides that meet elsewhere than at a common corner; None for a simple polygon.

    The index of a side is the index of its first corner.
    """
    edges = _edges(polygon)
    for i, (a, b) in enumerate(edges):
        for j, (c, d) in enumerate(edges[i + 1 :], i + 1):
            if b == c and _folds_back(a, b, d):
                return i, j
            if a == d and _folds_back(c, a, b):
                return i, j
            if b != c and a != d and _intersect(a, b, c, d):
                return i, j
    return None


def _folds_back(before: PlanarPoint, corner: PlanarPoint, after: PlanarPoint) -> bool:
    """Return whether the leg after a corner lies on the leg before this corner."""
    in_e, in_n = corner[0] - before[0], corner[1] - before[1]
    ahead = in_e * (after[0] - corner[0]) + in_n * (after[1] - corner[1])
    return _turn(before, corner, after) == 0.0 and ahead <= 0.0


def _edges(polygon: Sequence[PlanarPoint]) -> list[tuple[PlanarPoint, PlanarPoint]]:
    return list(pairwise((*polygon, polygon[0])))


def _intersect(a: PlanarPoint, b: PlanarPoint, c: PlanarPoint, d: PlanarPoint) -> bool:
    turns = (_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b))
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    touching = zip(turns, ((a, b, c), (a, b, d), (c, d, a), (c, d, b)), strict=True)
    return any(turn == 0.0 and _between(*three) for turn, three in touching)


def _between(a: PlanarPoint, b: PlanarPoint, p: PlanarPoint) -> bool:
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def turning_points(points: Sequence[PlanarPoint]) -> list[PlanarPoint]:
    """Return the ends of a polyline and its corners, also those at which it turns back."""
    kept = list(points[:1])
    for point, after in pairwise(points[1:]):
        if distance_to_leg(point, kept[-1], after) > MIN_CORNER_OFFSET_M:
            kept.append(point)
    return [*kept, *points[1:][-1:]]
