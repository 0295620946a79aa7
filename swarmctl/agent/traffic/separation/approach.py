"""Closest approach of two flights, exact because flights are straight between their points."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator
from typing import NamedTuple

import msgspec

from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Segment, Trajectory

ROUNDING = 1e-9
"""Greatest rounding error of a share of the limits."""


class Limits(msgspec.Struct, frozen=True):
    """Separation limits: two vehicles are too close while both distances are below the limits."""

    horizontal_m: float
    vertical_m: float

    def share(self, horizontal_m: float, vertical_m: float) -> float:
        """Return the greater of the two distances as shares of their limits; below 1: too close."""
        return max(horizontal_m / self.horizontal_m, vertical_m / self.vertical_m)


class PairDistance(msgspec.Struct, frozen=True):
    """Distances of two vehicles at one time."""

    t_s: float
    horizontal_m: float
    vertical_m: float

    @property
    def distance_m(self) -> float:
        return math.hypot(self.horizontal_m, self.vertical_m)


class _RelativeMotion(NamedTuple):
    """Motion of one vehicle relative to another while both fly straight; `at` and `velocity` in m and m/s."""

    begin_s: float
    lasts_s: float
    at: LocalPoint
    velocity: LocalPoint

    def distance_at(self, tau_s: float) -> PairDistance:
        e, n, u = (x + v * tau_s for x, v in zip(self.at, self.velocity, strict=True))
        return PairDistance(self.begin_s + tau_s, math.hypot(e, n), abs(u))

    def squared_distance(self) -> tuple[float, float, float]:
        """Return (a, b, c) of the squared horizontal distance a·τ² + b·τ + c."""
        (e, n, _), (ve, vn, _) = self.at, self.velocity
        return ve * ve + vn * vn, 2.0 * (e * ve + n * vn), e * e + n * n


def closest(a: Trajectory, b: Trajectory, limits: Limits) -> PairDistance | None:
    """Return the first distances with the least share of the limits; None if the flights share no time."""
    found, least = None, math.inf
    for part in _relative_motions(a, b):
        if _least_possible_share(part, limits) - ROUNDING >= least:
            continue
        at = _closest(part, limits)
        if (share := limits.share(at.horizontal_m, at.vertical_m)) < least:
            found, least = at, share
    return found


def nearest(a: Segment, b: Segment) -> PairDistance | None:
    """Return the distances at the least straight-line distance; None if the segments share no time."""
    part = _relative_motion(a, b)
    if part is None:
        return None
    a2, b1, _ = part.squared_distance()
    u, vu = part.at[2], part.velocity[2]
    a2, b1 = a2 + vu * vu, b1 + 2.0 * u * vu
    tau_s = -b1 / (2.0 * a2) if a2 > 0.0 else 0.0
    return part.distance_at(min(max(tau_s, 0.0), part.lasts_s))


def intervals(a: Trajectory, b: Trajectory, limits: Limits) -> tuple[tuple[float, float], ...]:
    """Return the intervals in which two flights are too close, as (from, until) [s], in order."""
    merged: list[tuple[float, float]] = []
    for part in _relative_motions(a, b):
        found = _too_close(part, limits)
        if found is None:
            continue
        if merged and found[0] <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(merged[-1][1], found[1])
        else:
            merged.append(found)
    return tuple(merged)


def too_close(a: Segment, b: Segment, limits: Limits) -> tuple[float, float] | None:
    """Return the interval in which two segments are too close: (from, until) [s]; None if they never are."""
    part = _relative_motion(a, b)
    return None if part is None else _too_close(part, limits)


def _relative_motions(a: Trajectory, b: Trajectory) -> Iterator[_RelativeMotion]:
    """Yield the relative motion over the common time, split at the turns of either flight."""
    if len(a.times_s) < 2 or len(b.times_s) < 2:
        return
    begin_s = max(a.times_s[0], b.times_s[0])
    i, j = _segment_at(a, begin_s), _segment_at(b, begin_s)
    while i < len(a.times_s) - 1 and j < len(b.times_s) - 1:
        part = _motion(a.times_s[i : i + 2], a.points[i : i + 2], b.times_s[j : j + 2], b.points[j : j + 2])
        if part is None:
            return
        yield part
        if a.times_s[i + 1] <= b.times_s[j + 1]:
            i += 1
        else:
            j += 1


def _segment_at(flight: Trajectory, t_s: float) -> int:
    """Return the index of the first segment that ends at `t_s` or later."""
    return max(bisect_left(flight.times_s, t_s) - 1, 0)


def _relative_motion(a: Segment, b: Segment) -> _RelativeMotion | None:
    return _motion((a.begin_s, a.end_s), (a.a, a.b), (b.begin_s, b.end_s), (b.a, b.b))


def _motion(
    a_s: tuple[float, ...], a: tuple[LocalPoint, ...], b_s: tuple[float, ...], b: tuple[LocalPoint, ...]
) -> _RelativeMotion | None:
    """Return the relative motion of two segments, each given by its two times and points.

    Nearly every comparison of flights comes here, so it makes no objects on the way.
    """
    (a0_s, a1_s), (b0_s, b1_s) = a_s, b_s
    begin_s, end_s = max(a0_s, b0_s), min(a1_s, b1_s)
    if end_s < begin_s:
        return None
    ((ae, an, au), (ae1, an1, au1)), ((be, bn, bu), (be1, bn1, bu1)) = a, b
    a_lasts_s, b_lasts_s = a1_s - a0_s, b1_s - b0_s
    a_share, b_share = (begin_s - a0_s) / a_lasts_s, (begin_s - b0_s) / b_lasts_s
    ade, adn, adu, bde, bdn, bdu = ae1 - ae, an1 - an, au1 - au, be1 - be, bn1 - bn, bu1 - bu
    at = (
        (ae + a_share * ade) - (be + b_share * bde),
        (an + a_share * adn) - (bn + b_share * bdn),
        (au + a_share * adu) - (bu + b_share * bdu),
    )
    velocity = (
        ade / a_lasts_s - bde / b_lasts_s,
        adn / a_lasts_s - bdn / b_lasts_s,
        adu / a_lasts_s - bdu / b_lasts_s,
    )
    return _RelativeMotion(begin_s, end_s - begin_s, at, velocity)


def _closest(part: _RelativeMotion, limits: Limits) -> PairDistance:
    """Return the distances with the least share of the limits.

    The share is the greater of two convex functions. Its minimum is at an end, at the minimum of either
    function, or at a crossing of both.
    """
    a2, b1, c = part.squared_distance()
    u, vu = part.at[2], part.velocity[2]
    h2, v2 = limits.horizontal_m**2, limits.vertical_m**2
    at = [0.0, part.lasts_s]
    at += [-b1 / (2.0 * a2)] if a2 > 0.0 else []
    at += [-u / vu] if vu != 0.0 else []
    at += _roots(a2 / h2 - vu * vu / v2, b1 / h2 - 2.0 * u * vu / v2, c / h2 - u * u / v2)
    (e, n, _), (ve, vn, _) = part.at, part.velocity
    _, tau_s = min(
        (limits.share(math.hypot(e + ve * tau_s, n + vn * tau_s), abs(u + vu * tau_s)), tau_s)
        for tau_s in at
        if 0.0 <= tau_s <= part.lasts_s
    )
    return part.distance_at(tau_s)


def _least_possible_share(part: _RelativeMotion, limits: Limits) -> float:
    """Return a share of the limits that the motion does not go below: quicker than `_closest`."""
    (e, n, u), (ve, vn, vu) = part.at, part.velocity
    horizontal_m = math.hypot(e, n) - part.lasts_s * math.hypot(ve, vn)
    return limits.share(horizontal_m, abs(u) - part.lasts_s * abs(vu))


def _too_close(part: _RelativeMotion, limits: Limits) -> tuple[float, float] | None:
    a2, b1, c = part.squared_distance()
    u, vu = part.at[2], part.velocity[2]
    low, high = 0.0, part.lasts_s
    if a2 > 0.0:
        roots = _roots(a2, b1, c - limits.horizontal_m**2)
        if not roots:
            return None
        low, high = max(low, min(roots)), min(high, max(roots))
    elif c >= limits.horizontal_m**2:
        return None
    if vu != 0.0:
        ends = sorted(((limits.vertical_m - u) / vu, (-limits.vertical_m - u) / vu))
        low, high = max(low, ends[0]), min(high, ends[1])
    elif abs(u) >= limits.vertical_m:
        return None
    return (part.begin_s + low, part.begin_s + high) if low < high else None


def _roots(a: float, b: float, c: float) -> list[float]:
    """Return the real roots of a·τ² + b·τ + c."""
    if a == 0.0:
        return [-c / b] if b != 0.0 else []
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return []
    # Computing both roots from q avoids a difference of nearly equal numbers.
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return [q / a, c / q] if q != 0.0 else [0.0]
