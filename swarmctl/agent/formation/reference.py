"""The route of a group as a smooth curve, and the greatest speed at each distance along it. Pure.

The route is a polyline. Each corner is averaged over a window before and after it, with the weights of a
triangle: the point over a short window, so that the curve stays near the route, and the heading over a
window that grows with the shape, so that the outermost place moves at a bounded speed. With y the distance
from a corner in units of its window L, the corner turns the direction by its angle times

    (1 − y)² / 2 before the corner, 1 − (1 − y)² / 2 after it,

and its turn for each metre is (1 − y) / L. So direction and turn have no jump, whatever the corners are.
Several corners in one window add. The window for the point is shorter near an end of the route, so that the
curve begins and ends exactly where the route does.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate, pairwise
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.planar import PlanarPoint, by_heading
from swarmctl.core.track_position import StraightLegs

LEAST_WINDOW_M = 15.0
"""Least window of the heading [m]."""
WINDOW_OF_RADIUS = 2.0
"""Window of the heading in units of the shape's radius: in a turn of 90° the outermost place moves up to
1.8 times as fast as the reference point, before the speed is reduced."""
CORNER_M = 15.0
"""Window of the point: a corner of 90° is cut by 3.5 m [m]."""
SLOWEST_M_S = 0.5
"""Least speed before the end of the route, so that no turn stops a group [m/s]."""
AS_GOOD_AS_BACK_RAD = 1e-6
"""A corner that differs less from 180° turns to the right, for every member in the same way."""
LEAST_LEG_M = 1e-6
"""A shorter leg is no leg [m]."""
_SAMPLES = 8
_STEPS = 8


class Pose(NamedTuple):
    """The reference at one distance along the route."""

    east_m: float
    north_m: float
    heading_rad: float
    """heading of the shape, clockwise from north; continuous, so it may be outside −π to π"""
    slope_east: float
    """change of `east_m` for each metre along the route"""
    slope_north: float
    turn_rad_m: float
    """change of the heading for each metre along the route [rad/m]"""
    s_m: float
    """distance along the route [m]"""

    def at(self, forward_m: float, right_m: float) -> PlanarPoint:
        """Return the position of an offset from the reference point, (east, north) [m]."""
        east_m, north_m = by_heading((forward_m, right_m), self.heading_rad)
        return self.east_m + east_m, self.north_m + north_m


Piece = tuple[float, float, float, float, float, float, float, float, float, float, float]
"""east, north and their first three derivatives by the distance; heading and its first two"""


def window_for(radius_m: float) -> float:
    """Return the window of the heading for a shape of this radius [m]."""
    return max(LEAST_WINDOW_M, WINDOW_OF_RADIUS * radius_m)


class Reference(msgspec.Struct, frozen=True, eq=False):
    """A route as a smooth curve."""

    points_m: tuple[PlanarPoint, ...]
    """waypoints (east, north) [m]"""
    legs: StraightLegs
    knots_m: tuple[float, ...]
    """distances between which the curve is one polynomial"""
    pieces: tuple[Piece, ...]

    @classmethod
    def over(cls, points_m: tuple[PlanarPoint, ...], window_m: float) -> Reference:
        """Return the curve of a route.

        window_m: window of the heading before and after a corner [m] (`window_for`)

        Raises ValueError for a route without a point.
        """
        if not points_m:
            raise ValueError("a route without a point: expected at least one")
        points = [points_m[0]]
        points += [b for a, b in pairwise(points_m) if math.dist(a, b) > LEAST_LEG_M]
        if len(points) == 1:
            points *= 2
        legs = StraightLegs.over(points)
        return cls(points_m, legs, *_pieces(legs, window_m))

    @property
    def length_m(self) -> float:
        return self.legs.at_m[-1]

    def at(self, s_m: float) -> Pose:
        """Return the reference at a distance along the route; before and past the route its ends."""
        s_m = min(max(s_m, 0.0), self.legs.at_m[-1])
        k = min(bisect_right(self.knots_m, s_m), len(self.pieces)) - 1
        h = s_m - self.knots_m[k]
        e, e1, e2, e3, n, n1, n2, n3, chi, chi1, chi2 = self.pieces[k]
        return Pose(
            e + h * (e1 + h * (0.5 * e2 + h * e3 / 6.0)),
            n + h * (n1 + h * (0.5 * n2 + h * n3 / 6.0)),
            chi + h * (chi1 + 0.5 * h * chi2),
            e1 + h * (e2 + 0.5 * h * e3),
            n1 + h * (n2 + 0.5 * h * n3),
            chi1 + h * chi2,
            s_m,
        )

    def bends(
        self, at_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return |dχ/ds|, |d²χ/ds²| and |d²p/ds²| at distances along the route."""
        pieces = np.array(self.pieces)
        k = np.clip(np.searchsorted(self.knots_m, at_m, side="right") - 1, 0, len(pieces) - 1)
        h, (_, _, e2, e3, _, _, n2, n3, _, chi1, chi2) = at_m - np.array(self.knots_m)[k], pieces[k].T
        return np.abs(chi1 + h * chi2), np.abs(chi2), np.hypot(e2 + h * e3, n2 + h * n3)

    def project(self, point: PlanarPoint, near_m: float, reach_m: float) -> float:
        """Return the distance along the route of the place nearest to a point, at most `reach_m` from
        `near_m` [m]."""
        low, high = max(near_m - reach_m, 0.0), min(near_m + reach_m, self.length_m)
        low = min(low, high)
        step = (high - low) / _SAMPLES
        at = min((low + k * step for k in range(_SAMPLES + 1)), key=lambda s: self._distance_m(point, s))
        low, high = max(low, at - step), min(high, at + step)
        for _ in range(_STEPS):
            pose = self.at(at)
            ahead_m = (point[0] - pose.east_m) * pose.slope_east + (
                point[1] - pose.north_m
            ) * pose.slope_north
            squared = pose.slope_east**2 + pose.slope_north**2
            moved = min(max(at + ahead_m / max(squared, 0.25), low), high)
            if abs(moved - at) < 1e-3:
                return moved
            at = moved
        return at

    def locate(self, point: PlanarPoint) -> float:
        """Return the distance along the route of the place nearest to a point, on the whole route [m]."""
        return self.project(point, self.legs.locate(point).along_m, CORNER_M)

    def _distance_m(self, point: PlanarPoint, s_m: float) -> float:
        pose = self.at(s_m)
        return math.hypot(point[0] - pose.east_m, point[1] - pose.north_m)


class SpeedProfile(msgspec.Struct, frozen=True, eq=False, dict=True):
    """The greatest speed of the reference point at each distance along a route."""

    step_m: float
    speeds_m_s: tuple[float, ...]
    length_m: float

    @cached_property
    def _times_s(self) -> tuple[float, ...]:
        """Time at which the reference point is at each sample, at full speed [s]."""
        takes_s = (_time_s(a, b, self.step_m) for a, b in pairwise(self.speeds_m_s))
        return tuple(accumulate(takes_s, initial=0.0))

    @classmethod
    def of(
        cls,
        reference: Reference,
        radius_m: float,
        cruise_m_s: float,
        max_speed_m_s: float,
        acceleration_m_s2: float,
        end_m: float = math.inf,
        ways: Sequence[tuple[float, float, Reference]] = (),
    ) -> SpeedProfile:
        """Return the speeds at which a shape of this radius follows the reference.

        No place is faster than `max_speed_m_s`. In a turn a place accelerates by at most half of
        `acceleration_m_s2`, because an autopilot follows a velocity that changes faster only metres behind.
        The speed changes by at most half of it, too, and it is 0 from `end_m` on, or at the end of the route.

        ways: stretches of the route on which a place follows a curve of its own, with begin and end [m];
            there half of the members' reserve of speed is left, because ways are long
        """
        n = max(int(reference.length_m / 2.0), 1) + 1
        at_m = np.linspace(0.0, reference.length_m, n)
        turn, change, bend = reference.bends(at_m)
        fastest = np.minimum(cruise_m_s, max_speed_m_s / (1.0 + radius_m * turn))
        pull = bend + radius_m * (change + turn**2)
        squared = np.minimum(fastest**2, 0.5 * acceleration_m_s2 / np.maximum(pull, 1e-9))
        for since_m, until_m, curve in ways:
            ratio, on_way = curve.length_m / (until_m - since_m), (since_m <= at_m) & (at_m <= until_m)
            _, _, bend = curve.bends((at_m[on_way] - since_m) * ratio)
            most = 0.5 * (cruise_m_s + max_speed_m_s) / max(ratio, 1e-9)
            limit = np.minimum(most**2, 0.5 * acceleration_m_s2 / np.maximum(bend * ratio**2, 1e-9))
            squared[on_way] = np.minimum(squared[on_way], limit)
        squared[at_m >= min(end_m, reference.length_m)] = 0.0
        gained = acceleration_m_s2 * at_m  # v² grows by 2·(a/2)·s
        squared = np.minimum.accumulate((squared + gained)[::-1])[::-1] - gained
        squared = np.minimum.accumulate(squared - gained) + gained
        speeds = np.maximum(np.sqrt(np.maximum(squared, 0.0)), min(SLOWEST_M_S, cruise_m_s))
        return cls(reference.length_m / (n - 1), tuple(speeds.tolist()), reference.length_m)

    def at(self, s_m: float) -> float:
        """Return the greatest speed at a distance along the route [m/s]; 0 from the end on."""
        # Each predicted second of a flight in a group comes here several times; `max` and `min` take longer.
        s_m = s_m if s_m > 0.0 else 0.0
        if s_m >= self.length_m:
            return 0.0
        place = s_m / self.step_m
        k, last = int(place), len(self.speeds_m_s) - 2
        k = last if k > last else k
        share = place - k
        return (1.0 - share) * self.speeds_m_s[k] + share * self.speeds_m_s[k + 1]

    def ahead(self, s_m: float, speed_m_s: float, for_s: float) -> tuple[float, float]:
        """Return distance and speed after a time, if the speed stays the same share of the profile's.

        So a group that is told late expects the turns of its route, not a straight line.
        """
        if for_s <= 0.0:
            return s_m, speed_m_s
        limit_m_s = self.at(s_m)
        share = min(speed_m_s / limit_m_s, 1.0) if limit_m_s > 0.0 else 0.0
        if share <= 0.0:
            return min(s_m, self.length_m), 0.0
        s_m = s_m if s_m > 0.0 else 0.0
        k = min(int(s_m / self.step_m), len(self._times_s) - 2)
        at_s = (
            self._times_s[k] + _time_s(self.speeds_m_s[k], limit_m_s, s_m - k * self.step_m) + share * for_s
        )
        k = bisect_right(self._times_s, at_s) - 1
        if k > len(self._times_s) - 2:
            return self.length_m, 0.0
        # Between two samples the speed is a straight line over the distance, so it grows exponentially.
        begin_m_s, in_s = self.speeds_m_s[k], at_s - self._times_s[k]
        growth = (self.speeds_m_s[k + 1] - begin_m_s) / self.step_m
        grown = math.expm1(growth * in_s) / growth if growth else in_s
        return k * self.step_m + begin_m_s * grown, share * (begin_m_s + growth * begin_m_s * grown)


def _time_s(begin_m_s: float, end_m_s: float, way_m: float) -> float:
    """Return the time of a way on which the speed is a straight line over the distance [s]."""
    change = end_m_s - begin_m_s
    if abs(change) < 1e-6 * begin_m_s:
        return way_m / begin_m_s
    return way_m * math.log(end_m_s / begin_m_s) / change


def _directions(legs: StraightLegs) -> tuple[tuple[float, float, float], ...]:
    directions: list[tuple[float, float, float]] = []
    for (ax, ay), (bx, by) in pairwise(legs.points):
        length_m = math.hypot(bx - ax, by - ay)
        east, north = ((bx - ax) / length_m, (by - ay) / length_m) if length_m else (0.0, 0.0)
        heading = math.atan2(east, north)
        if directions:
            before = directions[-1][2]
            turn = math.remainder(heading - before, 2.0 * math.pi)
            heading = before + (abs(turn) if abs(turn) > math.pi - AS_GOOD_AS_BACK_RAD else turn)
        directions.append((east, north, heading))
    return tuple(directions)


def _pieces(legs: StraightLegs, window_m: float) -> tuple[tuple[float, ...], tuple[Piece, ...]]:
    """Return the knots of the curve, and the polynomial after each knot.

    The values at the knots are sums over the corners near them. Between two knots d²p/ds² and dχ/ds are
    straight lines, so their values at the knots give all coefficients.
    """
    directions, length_m = np.array(_directions(legs)), legs.at_m[-1]
    corners_m, changes = np.array(legs.at_m[1:-1]), np.diff(directions, axis=0)
    windows_m = np.minimum(CORNER_M, np.minimum(corners_m, length_m - corners_m))
    around = (corners_m, *(corners_m + k * w for k in (-1, 1) for w in (windows_m, window_m)))
    knots = np.unique(np.clip(np.concatenate([[0.0, length_m], *around]), 0.0, length_m))
    knots = np.append(knots[:-1][np.diff(knots) > LEAST_LEG_M], length_m) if length_m else np.zeros(2)
    knots[0] = 0.0
    legs_at = np.clip(np.searchsorted(legs.at_m, knots, side="right") - 1, 0, len(directions) - 1)
    slope, heading = directions[legs_at, :2], directions[legs_at, 2]
    point = np.array(legs.points)[legs_at] + (knots - np.array(legs.at_m)[legs_at])[:, None] * slope
    bend, turn = np.zeros_like(point), np.zeros_like(knots)
    for at_m, near_m, change in zip(corners_m, windows_m, changes, strict=True):
        for of_m, is_heading in ((near_m, False), (window_m, True)):
            near = slice(*np.searchsorted(knots, (at_m - of_m, at_m + of_m)))
            away = knots[near] - at_m
            rest = np.maximum(1.0 - np.abs(away) / of_m, 0.0)
            turned = np.where(away < 0.0, 0.5, -0.5) * rest**2
            if is_heading:
                heading[near] += change[2] * turned
                turn[near] += change[2] * rest / of_m
            else:
                point[near] += np.outer(of_m * rest**3 / 6.0, change[:2])
                slope[near] += np.outer(turned, change[:2])
                bend[near] += np.outer(rest / of_m, change[:2])
    gaps = np.maximum(np.diff(knots), 1e-9)[:, None]
    third, second = np.diff(bend, axis=0) / gaps, np.diff(turn)[:, None] / gaps
    east, north = (np.column_stack([x[:-1, k] for x in (point, slope, bend)]) for k in (0, 1))
    table = np.hstack([east, third[:, :1], north, third[:, 1:], heading[:-1, None], turn[:-1, None], second])
    return tuple(knots[:-1].tolist()), tuple(map(tuple, table.tolist()))
