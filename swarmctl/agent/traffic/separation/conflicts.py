"""Pairs in conflict among many flights."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, closest, intervals
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory


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
    found, around = [], (0.0, limits.horizontal_m, limits.horizontal_m, limits.vertical_m)
    boxes = {uav: Bounds.of(flight).wider(around) for uav, flight in flights.items()}
    for uav, other in combinations(sorted(flights), 2):
        if not flights[other].may_meet(boxes[uav]):
            continue
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
