"""Least distance between any two vehicles in the air, updated with each position."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from dataclasses import dataclass, field

import numpy as np

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, nearest, too_close
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Segment

MAX_GAP_S = 3.0
"""Greatest time between two positions that are joined to a segment [s]."""

_ONES = np.ones(3)

VehiclePair = tuple[int, int]
"""system ids, the lower first"""


@dataclass(slots=True)
class _Track:
    last_s: float
    here: LocalPoint
    row: int
    """index of the vehicle in the arrays of `FlownSeparation`"""
    segments: deque[Segment] = field(default_factory=deque)
    """segments of the last MAX_GAP_S, in order"""
    lengths_m: deque[float] = field(default_factory=deque)


class FlownSeparation:
    """Least distance so far (`nearest`) and its pair (`between`); flights are straight between positions."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._tracks: dict[int, _Track] = {}
        self._uavs: list[int] = []
        """system id of each row"""
        self._here = np.empty((0, 3))
        self._reach_m = np.empty(0)
        """length of the stored segments of each vehicle [m]"""
        self.nearest: PairDistance | None = None
        self.between: VehiclePair | None = None
        self.too_close_s: defaultdict[VehiclePair, float] = defaultdict(float)
        """time below both limits [s], by pair"""

    def add_position(self, uav: int, t_s: float, here: LocalPoint) -> bool:
        """Add the position of a vehicle in the air; return whether the least distance has decreased."""
        track = self._tracks.get(uav)
        if track is None:
            track = self._tracks[uav] = _Track(t_s, here, len(self._uavs))
            self._uavs.append(uav)
            self._here = np.vstack((self._here, np.full(3, math.inf)))
            self._reach_m = np.append(self._reach_m, 0.0)
        if t_s <= track.last_s:
            return False
        segment, self._here[track.row] = Segment(track.last_s, t_s, track.here, here), here
        track.last_s, track.here = t_s, here
        if segment.end_s - segment.begin_s > MAX_GAP_S:
            return False
        length_m = math.dist(segment.a, segment.b)
        self._store(track, segment, length_m)
        is_nearer = [self._compare(uav, other, segment) for other in self._within_reach(track.row, length_m)]
        return any(is_nearer)

    def _store(self, track: _Track, segment: Segment, length_m: float) -> None:
        track.segments.append(segment)
        track.lengths_m.append(length_m)
        while track.segments[0].end_s < segment.end_s - MAX_GAP_S:
            track.segments.popleft()
            track.lengths_m.popleft()
        self._reach_m[track.row] = math.fsum(track.lengths_m)

    def _within_reach(self, row: int, length_m: float) -> list[int]:
        """Return the vehicles whose segments may be closer than the least distance or the limits."""
        limits = self._limits
        least_m = math.inf if self.nearest is None else self.nearest.distance_m
        near_m = max(least_m, math.hypot(limits.horizontal_m, limits.vertical_m)) + length_m
        away_m = self._here - self._here[row]
        away_m *= away_m
        (rows,) = (away_m @ _ONES <= (near_m + self._reach_m) ** 2).nonzero()
        return [self._uavs[i] for i in rows.tolist() if i != row]

    def _compare(self, uav: int, other: int, segment: Segment) -> bool:
        """Compare a new segment with another vehicle's; return whether the least distance has decreased."""
        pair, is_nearer = (min(uav, other), max(uav, other)), False
        for theirs in self._tracks[other].segments:
            if theirs.end_s <= segment.begin_s:
                continue
            at = nearest(segment, theirs)
            if at is None:
                continue
            if self.nearest is None or at.distance_m < self.nearest.distance_m:
                self.nearest, self.between, is_nearer = at, pair, True
            if times := too_close(segment, theirs, self._limits):
                self.too_close_s[pair] += times[1] - times[0]
        return is_nearer
