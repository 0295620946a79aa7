"""Clashes: conflicts between planned flights, with a tolerance in time.

Two flights clash if a position of one flight and a position of the other are too close (`approach.Limits`).
The times of the positions may differ by TIME_TOLERANCE_S. For two straight segments, the allowed pairs of
times form a convex polygon. So do the relative positions, and the distance of the polygon from the origin is
exact. A vehicle that may have stopped on its flight may be late by any time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import msgspec
import numpy as np

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.other_vehicles import Others
from swarmctl.agent.traffic.separation.trajectory import Segment, Trajectory
from swarmctl.core.planar import contains, distance_to_leg

TIME_TOLERANCE_S = 2.0
"""Greatest deviation between the times of two vehicles [s]: one second each, because a vehicle with a greater
deviation sends a new intent."""
HEIGHT_TOLERANCE_M = 0.3
"""Accuracy of held and reported heights [m]: plans at exactly the vertical limit do not clash."""

_Times = tuple[float, float]
"""(time of the first vehicle, time of the second vehicle) [s]"""
_DIRECTIONS = tuple((math.cos(k * math.tau / 8), math.sin(k * math.tau / 8)) for k in range(8))
"""eight unit vectors"""


class Clash(msgspec.Struct, frozen=True):
    """A clash with another vehicle's flight."""

    other: int
    at_s: float
    """earliest time at which the own vehicle is too close [s]"""


def find_clashes(own: Trajectory, others: Others, limits: Limits) -> tuple[Clash, ...]:
    """Return the clashes of a flight with `others` as announced or predicted, soonest first."""
    if not others:
        return ()
    uavs = list(others)
    pairs = [
        (known.flight, known.limits(limits), math.inf if known.may_be_late else TIME_TOLERANCE_S)
        for known in others.values()
    ]
    first_s: dict[int, float] = {}
    for i, k, j in _near_segments(own, pairs):
        uav, (flight, pair_limits, late_s) = uavs[k], pairs[k]
        if first_s.get(uav, math.inf) <= own.times_s[i]:
            continue  # the clash of an earlier segment is sooner
        at_s = _first_clash_s(own.segment(i), flight.segment(j), pair_limits, late_s)
        if at_s is not None:
            first_s[uav] = min(first_s.get(uav, math.inf), at_s)
    return tuple(sorted((Clash(*found) for found in first_s.items()), key=lambda c: (c.at_s, c.other)))


def _near_segments(
    own: Trajectory, others: Sequence[tuple[Trajectory, Limits, float]]
) -> Iterator[tuple[int, int, int]]:
    """Yield (own segment, other flight, its segment) of segments whose boxes are within the limits.

    Each other flight has its limits, and the greatest time by which it may be late [s].
    """
    counts = [len(flight.boxes) for flight, _, _ in others]
    reach = np.array([(late_s, at.horizontal_m, at.horizontal_m, at.vertical_m) for _, at, late_s in others])
    reach = np.repeat(reach, counts, axis=0)
    one, other = own.boxes[:, None], np.concatenate([flight.boxes for flight, _, _ in others])
    near = one[..., :4] - reach <= other[:, 4:]
    reach[:, 0] = TIME_TOLERANCE_S
    near &= other[:, :4] - reach <= one[..., 4:]
    flight_of = [(k, j) for k, count in enumerate(counts) for j in range(count)]
    for i, at in np.argwhere(near.all(axis=2)).tolist():
        yield i, *flight_of[at]


def _first_clash_s(a: Segment, b: Segment, limits: Limits, late_s: float) -> float | None:
    """Return the approximate time at which `a` is first too close to `b` [s]; None if they do not clash.

    `b` may be early by up to TIME_TOLERANCE_S, and late by up to `late_s`.
    """
    (ve, vn, vu), (we, wn, wu) = _velocity(a), _velocity(b)
    (ae, an, au), (be, bn, bu) = a.a, b.a
    a_s, b_s, near_m, limit_m = (
        a.begin_s,
        b.begin_s,
        limits.vertical_m - HEIGHT_TOLERANCE_M,
        limits.horizontal_m,
    )
    times: Sequence[_Times] = ((a_s, b_s), (a.end_s, b_s), (a.end_s, b.end_s), (a_s, b.end_s))
    times = _clip(times, [late_s - t + u for t, u in times])
    times = _clip(times, [TIME_TOLERANCE_S + t - u for t, u in times])
    times = _clip(times, [near_m - (au + (t - a_s) * vu - bu - (u - b_s) * wu) for t, u in times])
    times = _clip(times, [near_m + (au + (t - a_s) * vu - bu - (u - b_s) * wu) for t, u in times])
    if not times:
        return None
    apart = [
        (ae + (t - a_s) * ve - be - (u - b_s) * we, an + (t - a_s) * vn - bn - (u - b_s) * wn)
        for t, u in times
    ]
    if _distance_m(apart) >= limit_m:
        return None
    # An octagon around the circle of the limit: at this time the distance is at most 8 % above the limit.
    for east, north in _DIRECTIONS:
        inside = [limit_m - east * e - north * n for e, n in apart]
        if min(inside) < 0.0:
            times = _clip(times, inside) or times
            apart = [
                (ae + (t - a_s) * ve - be - (u - b_s) * we, an + (t - a_s) * vn - bn - (u - b_s) * wn)
                for t, u in times
            ]
    return min(times)[0]


def _velocity(segment: Segment) -> tuple[float, float, float]:
    lasts_s = segment.end_s - segment.begin_s
    (east_m, north_m, up_m), (to_east_m, to_north_m, to_up_m) = segment.a, segment.b
    return (to_east_m - east_m) / lasts_s, (to_north_m - north_m) / lasts_s, (to_up_m - up_m) / lasts_s


def _clip(corners: Sequence[_Times], inside: Sequence[float]) -> Sequence[_Times]:
    """Return the part of a convex polygon in which a linear function is not negative.

    `inside` has the function's values at the corners.
    """
    if not inside or min(inside) >= 0.0:
        return corners
    kept: list[_Times] = []
    for i, corner in enumerate(corners):
        before, value, last = corners[i - 1], inside[i], inside[i - 1]
        if (value < 0.0) != (last < 0.0):
            share = last / (last - value)
            kept.append(
                (before[0] + share * (corner[0] - before[0]), before[1] + share * (corner[1] - before[1]))
            )
        if value >= 0.0:
            kept.append(corner)
    return kept


def _distance_m(polygon: Sequence[tuple[float, float]]) -> float:
    """Return the distance from the origin to a convex polygon, which may be flat."""
    if len(polygon) > 2 and contains(polygon, (0.0, 0.0)):
        return 0.0
    return min(distance_to_leg((0.0, 0.0), a, b) for a, b in pairwise((*polygon, polygon[0])))
