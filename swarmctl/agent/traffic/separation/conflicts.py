"""Pairs in conflict among many flights."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, closest, intervals
from swarmctl.agent.traffic.separation.trajectory import Segment, Trajectory


class PairConflict(msgspec.Struct, frozen=True):
    """Two vehicles that will be too close; `uav` has the lower system id."""

    uav: int
    other: int
    begin_s: float
    end_s: float
    """end of the last conflict of the pair [s]"""
    closest: PairDistance


def conflicts(flights: Mapping[int, Trajectory], limits: Limits) -> tuple[PairConflict, ...]:
    """Return all pairs in conflict at some time, soonest first."""
    found = []
    for uav, other in sorted(_near_pairs(flights, limits)):
        times = intervals(flights[uav], flights[other], limits)
        at = closest(flights[uav], flights[other], limits) if times else None
        if at is not None:
            found.append(PairConflict(uav, other, times[0][0], times[-1][1], at))
    return tuple(sorted(found, key=lambda conflict: (conflict.begin_s, conflict.uav, conflict.other)))


class CrossingCounts(msgspec.Struct, frozen=True):
    """Number of pairs of flights that are closer than the horizontal limit at the same time."""

    predicted: int
    by_height: int
    """pairs that height separates"""


def count_crossings(flights: Mapping[int, Trajectory], limits: Limits) -> CrossingCounts:
    over_ground = conflicts(flights, Limits(limits.horizontal_m, math.inf))
    return CrossingCounts(len(over_ground), len(over_ground) - len(conflicts(flights, limits)))


def _near_pairs(flights: Mapping[int, Trajectory], limits: Limits) -> set[tuple[int, int]]:
    """Return the pairs that have segments at the same time, with boxes within the limits of each other."""
    segments = [(segment, uav) for uav, flight in flights.items() for segment in flight.segments()]
    segments.sort(key=lambda item: (item[0].begin_s, item[1]))
    pairs: set[tuple[int, int]] = set()
    active: list[tuple[Segment, int]] = []
    for segment, uav in segments:
        active = [item for item in active if item[0].end_s >= segment.begin_s]
        for earlier, other in active:
            pair = (min(uav, other), max(uav, other))
            if uav != other and pair not in pairs and _are_near(segment, earlier, limits):
                pairs.add(pair)
        active.append((segment, uav))
    return pairs


def _are_near(one: Segment, other: Segment, limits: Limits) -> bool:
    within_m = (limits.horizontal_m, limits.horizontal_m, limits.vertical_m)
    ends = zip(one.a, one.b, other.a, other.b, within_m, strict=True)
    return all(min(a, b) - near <= max(c, d) and min(c, d) - near <= max(a, b) for a, b, c, d, near in ends)
