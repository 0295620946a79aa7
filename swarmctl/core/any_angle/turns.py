"""Turns of a vehicle that cannot turn on the spot: arcs that touch both legs of a corner (fillets).

Such a vehicle turns before the corner, so that the arc ends on the next leg. For a turn by the angle θ the
arc of radius r begins and ends r · tan(θ/2) from the corner.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.core.any_angle.track import GridPoint

ARC_ERROR = 0.005
"""greatest distance between an arc and its straight pieces [cells]"""
SAME_POINT = 1e-9
"""distance below which two points of a track are one point [cells]"""


def tangent_length(before: GridPoint, corner: GridPoint, after: GridPoint, radius: float) -> float:
    """Return the distance between a corner and the ends of its arc, in the unit of points and `radius`.

    The distance is 0 for `radius` 0, and otherwise infinite for a turn by 180°.
    """
    (ix, iy), (ox, oy) = _vector(before, corner), _vector(corner, after)
    cross, dot = ix * oy - iy * ox, ix * ox + iy * oy
    product = math.hypot(ix, iy) * math.hypot(ox, oy)
    if cross == 0.0 and (dot > 0.0 or radius == 0.0):
        return 0.0
    # tan(θ/2) = sin θ / (1 + cos θ)
    return radius * abs(cross) / (product + dot) if product + dot > 1e-12 * product else math.inf


def arc(before: GridPoint, corner: GridPoint, after: GridPoint, radius: float) -> list[GridPoint]:
    """Return points on the arc of a corner, from the leg `before`–`corner` to the leg `corner`–`after`.

    `radius` is in the unit of the points. A corner without a turn, or with `radius` 0, stays one point.
    """
    away = tangent_length(before, corner, after, radius)
    if away == 0.0:
        return [corner]
    (ix, iy), (ox, oy) = _unit(before, corner), _unit(corner, after)
    side = math.copysign(1.0, ix * oy - iy * ox)  # 1: left, -1: right
    begin_x, begin_y = corner[0] - away * ix, corner[1] - away * iy
    centre_x, centre_y = begin_x - side * radius * iy, begin_y + side * radius * ix
    turn = math.atan2(ix * oy - iy * ox, ix * ox + iy * oy)
    # The middle of a chord over the angle δ is r (1 − cos δ/2) from its arc.
    n = max(1, math.ceil(abs(turn) / (2.0 * math.acos(max(1.0 - ARC_ERROR / radius, 0.0)))))
    points = []
    for k in range(n + 1):
        cosine, sine = math.cos(turn * k / n), math.sin(turn * k / n)
        x, y = begin_x - centre_x, begin_y - centre_y
        points.append((centre_x + cosine * x - sine * y, centre_y + sine * x + cosine * y))
    return points


def rounded(points: Sequence[GridPoint], radius: float) -> tuple[list[GridPoint], list[int]]:
    """Return the points of a track with arcs for corners, and the leg of each piece between two points.

    The first half of an arc belongs to the leg before the corner. Two arcs without a straight piece between
    them share a point.
    """
    if len(points) < 2:
        return list(points), []
    ends: list[tuple[GridPoint, int]] = []
    for leg, (before, corner, after) in enumerate(zip(points, points[1:], points[2:], strict=False)):
        turn = arc(before, corner, after, radius)
        middle = 1 + (len(turn) - 1) // 2
        ends += [(point, leg if k < middle else leg + 1) for k, point in enumerate(turn)]
    flown, legs = [points[0]], []
    for point, leg in ends:
        if math.dist(flown[-1], point) > SAME_POINT:
            flown.append(point)
            legs.append(leg)
    if legs and math.dist(flown[-1], points[-1]) <= SAME_POINT:
        flown.pop()
        legs.pop()
    return [*flown, points[-1]], [*legs, len(points) - 2]


def _vector(a: GridPoint, b: GridPoint) -> GridPoint:
    return b[0] - a[0], b[1] - a[1]


def _unit(a: GridPoint, b: GridPoint) -> GridPoint:
    length = math.dist(a, b)
    return (b[0] - a[0]) / length, (b[1] - a[1]) / length
