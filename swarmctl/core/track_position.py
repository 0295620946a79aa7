"""A track of straight legs on a local plane, and positions on it in metres along the track. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise

import msgspec

from swarmctl.core.planar import PlanarPoint

EQUALLY_NEAR_M = 1e-6
"""Difference in distance below which two legs count as equally near [m]."""


class TrackPosition(msgspec.Struct, frozen=True):
    """The place on a track that is nearest to a point."""

    along_m: float
    """distance along the track from its first point [m]"""
    cross_track_m: float
    """distance of the point from that place [m]"""
    leg: int
    """index of the leg; leg i leads from point i to point i + 1"""


class StraightLegs(msgspec.Struct, frozen=True):
    """A track over two points or more."""

    points: tuple[PlanarPoint, ...]
    at_m: tuple[float, ...]
    """distance along the track to each point [m]"""

    @classmethod
    def over(cls, points: Sequence[PlanarPoint]) -> StraightLegs:
        legs_m = (math.dist(a, b) for a, b in pairwise(points))
        return cls(tuple(points), tuple(accumulate(legs_m, initial=0.0)))

    def locate(self, point: PlanarPoint, since_m: float = 0.0, until_m: float = math.inf) -> TrackPosition:
        """Return the place nearest to a point, among the places from `since_m` to `until_m` along the track.

        Of equally near legs the first one counts, so that a corner stays ahead until it is passed.
        """
        nearest, since_m = None, min(since_m, self.at_m[-1])
        until_m = max(until_m, since_m)
        for leg in range(max(bisect_left(self.at_m, since_m) - 1, 0), len(self.points) - 1):
            begin_m, end_m = self.at_m[leg], self.at_m[leg + 1]
            if begin_m > until_m:
                break
            (ax, ay), (bx, by) = self.points[leg], self.points[leg + 1]
            leg_m = end_m - begin_m
            flown_m = ((point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)) / leg_m if leg_m else 0.0
            flown_m = min(max(flown_m, since_m - begin_m, 0.0), leg_m, until_m - begin_m)
            share = flown_m / leg_m if leg_m else 0.0
            away_m = math.dist(point, (ax + share * (bx - ax), ay + share * (by - ay)))
            if nearest is None or away_m < nearest.cross_track_m - EQUALLY_NEAR_M:
                nearest = TrackPosition(begin_m + flown_m, away_m, leg)
        assert nearest is not None  # a leg has the place at `since_m`
        return nearest

    def point_at(self, along_m: float) -> PlanarPoint:
        """Return the point at a distance along the track, between both ends."""
        leg = min(max(bisect_right(self.at_m, along_m) - 1, 0), len(self.points) - 2)
        leg_m = self.at_m[leg + 1] - self.at_m[leg]
        share = min(max((along_m - self.at_m[leg]) / leg_m, 0.0), 1.0) if leg_m else 0.0
        (ax, ay), (bx, by) = self.points[leg : leg + 2]
        return ax + share * (bx - ax), ay + share * (by - ay)
