"""Trajectories: straight segments between points with times."""

from __future__ import annotations

import math
import operator
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from functools import cached_property

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.planar import PlanarPoint, share_of_leg
from swarmctl.core.vehicle import BRAKING_M_S2, VERTICAL_ACCELERATION_M_S2

LocalPoint = tuple[float, float, float]
"""east, north, up [m]"""
Boxes = NDArray[np.float64]
"""(segments, 8): least time [s], east, north and up [m] of each segment, then the greatest values"""

DRIFT_M_S = 0.8
"""Horizontal speed below which a vehicle drifts in the wind, and comes back to its place [m/s]."""
LEAST_GAP_S = 0.1
"""Least time between two points of a stop [s]."""


class Segment(msgspec.Struct, frozen=True):
    """Flight at constant velocity from `a` at `begin_s` to `b` at `end_s`."""

    begin_s: float
    end_s: float
    a: LocalPoint
    b: LocalPoint

    def at(self, t_s: float) -> LocalPoint:
        """Return the position at `t_s`, a time within the segment."""
        share = (t_s - self.begin_s) / (self.end_s - self.begin_s)
        (ae, an, au), (be, bn, bu) = self.a, self.b
        return ae + share * (be - ae), an + share * (bn - an), au + share * (bu - au)


class Trajectory(msgspec.Struct, frozen=True, dict=True):
    """A vehicle's flight from `times_s[0]` to `times_s[-1]`. At other times the vehicle has no conflicts."""

    times_s: tuple[float, ...]
    """strictly increasing"""
    points: tuple[LocalPoint, ...]
    """one for each time, finite"""

    def checked(self) -> Trajectory:
        """Return this flight, after a check that it can be compared with others.

        Raises ValueError for unequal numbers, times that do not increase, and values that are not finite.
        """
        if len(self.times_s) != len(self.points):
            raise ValueError(
                f"{len(self.times_s)} times for {len(self.points)} points: expected equal numbers"
            )
        # A sum is finite only if each number is.
        if not math.isfinite(sum(self.times_s) + sum(map(sum, self.points))):
            raise ValueError("a time or a coordinate is not finite: expected seconds and metres")
        if any(map(operator.le, self.times_s[1:], self.times_s)):
            raise ValueError("times do not increase: expected each to be later than the previous one")
        return self

    def segments(self) -> Iterator[Segment]:
        return map(self.segment, range(len(self.times_s) - 1))

    def segment(self, i: int) -> Segment:
        return Segment(self.times_s[i], self.times_s[i + 1], self.points[i], self.points[i + 1])

    @cached_property
    def boxes(self) -> Boxes:
        """The bounding boxes of the segments in time and space."""
        points = np.array([(t, *point) for t, point in zip(self.times_s, self.points, strict=True)])
        boxes = np.empty((max(len(points) - 1, 0), 8))
        if len(boxes):
            np.minimum(points[:-1], points[1:], out=boxes[:, :4])
            np.maximum(points[:-1], points[1:], out=boxes[:, 4:])
        return boxes

    def may_meet(self, box: Bounds) -> bool:
        """Return whether the flight may come into a box: a quick test by the segments in the box's time."""
        (from_s, *least), (until_s, *most) = box.least, box.most
        first = max(bisect_right(self.times_s, from_s) - 1, 0)
        points = self.points[first : bisect_left(self.times_s, until_s) + 1]
        if not points or self.times_s[0] > until_s or self.times_s[-1] < from_s:
            return False
        return all(
            min(along) <= high and max(along) >= low
            for along, low, high in zip(zip(*points, strict=True), least, most, strict=True)
        )

    def at(self, t_s: float) -> LocalPoint | None:
        """Return the position at `t_s`; None before and after the flight."""
        if not self.times_s or not self.times_s[0] <= t_s <= self.times_s[-1]:
            return None
        if t_s == self.times_s[-1]:
            return self.points[-1]
        i = bisect_right(self.times_s, t_s)
        return Segment(self.times_s[i - 1], self.times_s[i], self.points[i - 1], self.points[i]).at(t_s)

    def since(self, t_s: float) -> Trajectory | None:
        """Return the part from `t_s` on; None if the flight ends before `t_s`."""
        at = self.at(t_s)
        if at is None:
            return self if self.times_s and t_s < self.times_s[0] else None
        i = bisect_right(self.times_s, t_s)
        return Trajectory((t_s, *self.times_s[i:]), (at, *self.points[i:]))

    @property
    def moves_from_s(self) -> float:
        """Time at which the vehicle leaves the first point; the start of the flight if it never does."""
        first_moved = next((i for i, point in enumerate(self.points) if point != self.points[0]), 1)
        return self.times_s[first_moved - 1]

    @property
    def ends_in_hold(self) -> bool:
        """True if the vehicle stays at the last point."""
        return len(self.points) > 1 and self.points[-1] == self.points[-2]

    def lasting(self, until_s: float) -> Trajectory:
        """Return the flight until `until_s`; a flight that ends earlier stays at its last point."""
        n, at = bisect_left(self.times_s, until_s), self.at(until_s)
        last = self.points[-1] if at is None else at
        return Trajectory((*self.times_s[:n], until_s), (*self.points[:n], last))

    def nearest(self, point: PlanarPoint) -> LocalPoint:
        """Return the place of the flight that is nearest to (east, north) [m] over ground."""

        def on(leg: Segment) -> LocalPoint:
            share = share_of_leg(point, leg.a[:2], leg.b[:2])
            return leg.at(leg.begin_s + share * (leg.end_s - leg.begin_s))

        places = map(on, self.segments())
        return min(places, key=lambda at: math.dist(point, at[:2]), default=self.points[0])

    def later(self, seconds: float) -> Trajectory:
        """Return the same flight, shifted in time."""
        return Trajectory(tuple([t + seconds for t in self.times_s]), self.points)

    def holding(self, for_s: float) -> Trajectory:
        """Return the flight with a stay of `for_s` at its last point."""
        return self.lasting(self.times_s[-1] + for_s)

    def then(self, other: Trajectory) -> Trajectory:
        """Return this flight and then `other`, which begins at 0 s at the last point of this flight."""
        times_s = [self.times_s[-1] + t for t in other.times_s[1:]]
        return Trajectory((*self.times_s, *times_s), (*self.points, *other.points[1:]))

    def after(self, here: LocalPoint, seconds: float) -> Trajectory:
        """Return a flight that begins `here` at 0 s, and goes on by this flight `seconds` later."""
        return Trajectory((0.0, *[t + seconds for t in self.times_s]), (here, *self.points))

    def thinned(self, within_m: float) -> Trajectory:
        """Return the flight without points that it passes anyway, within `within_m` on each axis."""
        kept = [0]
        (e0, n0, u0), t0 = self.points[0], self.times_s[0]
        # Least and greatest velocities east, north, up with which the flight passes all points since then.
        least_e = least_n = least_u = -math.inf
        most_e = most_n = most_u = math.inf
        for i in range(1, len(self.points)):
            (e, n, u), t = self.points[i], self.times_s[i]
            while True:  # once, or again from a kept point
                per_s = 1.0 / (t - t0)
                ve, vn, vu = (e - e0) * per_s, (n - n0) * per_s, (u - u0) * per_s
                if least_e <= ve <= most_e and least_n <= vn <= most_n and least_u <= vu <= most_u:
                    break
                kept.append(i - 1)
                (e0, n0, u0), t0 = self.points[i - 1], self.times_s[i - 1]
                least_e = least_n = least_u = -math.inf
                most_e = most_n = most_u = math.inf
            by = within_m * per_s
            least_e, least_n, least_u = max(least_e, ve - by), max(least_n, vn - by), max(least_u, vu - by)
            most_e, most_n, most_u = min(most_e, ve + by), min(most_n, vn + by), min(most_u, vu + by)
        kept.append(len(self.points) - 1)
        return Trajectory(tuple([self.times_s[i] for i in kept]), tuple([self.points[i] for i in kept]))

    def higher(self, by_m: float) -> Trajectory:
        """Return the same flight, shifted in height."""
        points = tuple([(east_m, north_m, up_m + by_m) for east_m, north_m, up_m in self.points])
        return Trajectory(self.times_s, points)


class Bounds(msgspec.Struct, frozen=True):
    """Bounding box of a flight in time and space."""

    least: tuple[float, float, float, float]
    """time, east, north, up [s, m]"""
    most: tuple[float, float, float, float]

    @classmethod
    def of(cls, flight: Trajectory) -> Bounds:
        east_m, north_m, up_m = zip(*flight.points, strict=True)
        return cls(
            (flight.times_s[0], min(east_m), min(north_m), min(up_m)),
            (flight.times_s[-1], max(east_m), max(north_m), max(up_m)),
        )

    def wider(self, reach: tuple[float, float, float, float]) -> Bounds:
        """Return the box enlarged by `reach` on each side."""
        (t0, e0, n0, u0), (t1, e1, n1, u1) = self.least, self.most
        t, e, n, u = reach
        return Bounds((t0 - t, e0 - e, n0 - n, u0 - u), (t1 + t, e1 + e, n1 + n, u1 + u))

    def later(self, seconds: float) -> Bounds:
        """Return the same box, shifted in time."""
        return Bounds((self.least[0] + seconds, *self.least[1:]), (self.most[0] + seconds, *self.most[1:]))

    def joined(self, other: Bounds) -> Bounds:
        """Return the box around both boxes."""
        (t0, e0, n0, u0), (t1, e1, n1, u1) = self.least, other.least
        (t2, e2, n2, u2), (t3, e3, n3, u3) = self.most, other.most
        least = (min(t0, t1), min(e0, e1), min(n0, n1), min(u0, u1))
        return Bounds(least, (max(t2, t3), max(e2, e3), max(n2, n3), max(u2, u3)))

    def meets(self, other: Bounds) -> bool:
        """Return whether two boxes have a common point: a cheap first test."""
        low, high, least, most = self.least, self.most, other.least, other.most
        # Most vehicles fly at other heights, so the heights come first.
        return (
            (low[3] <= most[3] and least[3] <= high[3])
            and (low[0] <= most[0] and least[0] <= high[0])
            and (low[1] <= most[1] and least[1] <= high[1])
            and (low[2] <= most[2] and least[2] <= high[2])
        )


def until_landing(flight: Trajectory) -> Trajectory:
    """Return the flight up to its final vertical descent; the whole flight if the descent has begun."""
    n = _n_before_landing(flight.points)
    return flight if n < 2 or n == len(flight.points) else Trajectory(flight.times_s[:n], flight.points[:n])


def landing_start_s(flight: Trajectory) -> float:
    """Return the start of the final vertical descent [s], or the end of a flight that has no such descent."""
    return flight.times_s[_n_before_landing(flight.points) - 1]


def _n_before_landing(points: tuple[LocalPoint, ...]) -> int:
    n = len(points)
    while n > 1 and _is_vertical_descent(points[n - 2], points[n - 1]):
        n -= 1
    return n


def _is_vertical_descent(a: LocalPoint, b: LocalPoint) -> bool:
    return b[2] < a[2] and math.dist(a[:2], b[:2]) < 1.0


def extrapolate(here: LocalPoint, velocity_m_s: LocalPoint, from_s: float, for_s: float) -> Trajectory:
    """Return the straight flight from `here` at a velocity (east, north, up) [m/s] for `for_s` seconds.

    A horizontal speed below DRIFT_M_S counts as 0.
    """
    (e, n, u), (ve, vn, vu) = here, velocity_m_s
    if math.hypot(ve, vn) < DRIFT_M_S:
        ve = vn = 0.0
    return Trajectory((from_s, from_s + for_s), (here, (e + ve * for_s, n + vn * for_s, u + vu * for_s)))


def brake(
    here: LocalPoint,
    velocity_m_s: LocalPoint,
    from_s: float,
    reacts_s: float = 0.0,
    brakes_m_s2: float = BRAKING_M_S2,
) -> Trajectory:
    """Return the flight of a copter that brakes from a velocity (east, north, up) [m/s], up to its stop.

    The braking begins `reacts_s` after `from_s`. A climb or descent ends by VERTICAL_ACCELERATION_M_S2.
    The flight has points at the begin, in the middle and at the end of braking, and at the end of a climb.
    """
    (e, n, u), (ve, vn, vu) = here, velocity_m_s
    level_s, vertical_s = math.hypot(ve, vn) / brakes_m_s2, abs(vu) / VERTICAL_ACCELERATION_M_S2
    times_s, points = [from_s], [here]
    for braked_s in sorted((0.0, 0.5 * level_s, level_s, vertical_s)):
        at_s = from_s + reacts_s + braked_s
        if at_s < from_s + LEAST_GAP_S:
            continue
        if len(times_s) > 1 and at_s < times_s[-1] + LEAST_GAP_S:
            times_s.pop()
            points.pop()
        along_s, up_s = (
            reacts_s + _at_speed_s(level_s, braked_s),
            reacts_s + _at_speed_s(vertical_s, braked_s),
        )
        times_s.append(at_s)
        points.append((e + ve * along_s, n + vn * along_s, u + vu * up_s))
    return Trajectory(tuple(times_s), tuple(points))


def _at_speed_s(braking_s: float, after_s: float) -> float:
    """Return the time [s] in which full speed covers the distance that a braking covers in `after_s`."""
    braked_s = min(after_s, braking_s)
    return braked_s - 0.5 * braked_s * braked_s / braking_s if braking_s > 0.0 else 0.0
