"""Least distance between any two vehicles in the air, updated with each position."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from dataclasses import dataclass, field

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, nearest, too_close
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Segment

MAX_GAP_S = 3.0
"""Greatest time between two positions that are joined to a segment [s]."""

VehiclePair = tuple[int, int]
"""system ids, the lower first"""


@dataclass(slots=True)
class _Track:
    last_s: float
    here: LocalPoint
    segments: deque[Segment] = field(default_factory=deque)
    """segments of the last MAX_GAP_S, in order"""
    lengths_m: deque[float] = field(default_factory=deque)
    reach_m: float = 0.0
    """length of the stored segments [m]"""

    def add(self, segment: Segment, length_m: float) -> None:
        """Store a segment, and drop the segments that ended MAX_GAP_S before it."""
        self.segments.append(segment)
        self.lengths_m.append(length_m)
        while self.segments[0].end_s < segment.end_s - MAX_GAP_S:
            self.segments.popleft()
            self.lengths_m.popleft()
        self.reach_m = math.fsum(self.lengths_m)


class FlownSeparation:
    """Least distance so far (`nearest`) and its pair (`between`); flights are straight between positions."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._tracks: dict[int, _Track] = {}
        self.nearest: PairDistance | None = None
        self.between: VehiclePair | None = None
        self.too_close_s: defaultdict[VehiclePair, float] = defaultdict(float)
        """time below both limits [s], by pair"""

    def add_position(self, uav: int, t_s: float, here: LocalPoint) -> bool:
        """Add the position of a vehicle in the air; return whether the least distance has decreased."""
        track = self._tracks.get(uav)
        if track is None:
            track = self._tracks[uav] = _Track(t_s, here)
        if t_s <= track.last_s:
            return False
        segment = Segment(track.last_s, t_s, track.here, here)
        track.last_s, track.here = t_s, here
        if segment.end_s - segment.begin_s > MAX_GAP_S:
            return False
        length_m = math.dist(segment.a, segment.b)
        track.add(segment, length_m)
        is_nearer = [self._compare(uav, other, segment) for other in self._within_reach(uav, here, length_m)]
        return any(is_nearer)

    def _within_reach(self, uav: int, here: LocalPoint, length_m: float) -> list[int]:
        """Return the vehicles whose segments may be closer than the least distance or the limits."""
        limits = self._limits
        least_m = math.inf if self.nearest is None else self.nearest.distance_m
        near_m = max(least_m, math.hypot(limits.horizontal_m, limits.vertical_m)) + length_m
        return [
            other
            for other, track in self._tracks.items()
            if math.dist(here, track.here) <= near_m + track.reach_m and other != uav
        ]

    def _compare(self, uav: int, other: int, segment: Segment) -> bool:
        """Compare a new segment with another vehicle's; return whether the least distance has decreased."""
        pair, is_nearer = (min(uav, other), max(uav, other)), False
        for theirs in reversed(self._tracks[other].segments):
            if theirs.end_s <= segment.begin_s:
                break
            at = nearest(segment, theirs)
            if at is None:
                continue
            if self.nearest is None or at.distance_m < self.nearest.distance_m:
                self.nearest, self.between, is_nearer = at, pair, True
            if times := too_close(segment, theirs, self._limits):
                self.too_close_s[pair] += times[1] - times[0]
        return is_nearer
