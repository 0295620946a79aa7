"""Who is about to come too near to whom in flight, and who of them gives way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from swarmctl.agent.traffic.separation.approach import Approach, Limits, closest, intervals
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory
from swarmctl.core.frames import StateShared

AvoidanceAction = Literal["hold", "climb", "none"]

CLEAR_FACTOR = 1.5
"""An alarm ends when nobody comes within so many times the limits …"""
CLEAR_FOR_S = 2.0
"""… for so long."""
HEIGHT_MARGIN = 1.2
"""Who climbs keeps so many times the vertical limit: neither holds its height to the metre."""


DEFAULT_LIMITS = Limits(10.0, 3.0)


@dataclass(frozen=True, slots=True)
class SeparationRules:
    """How far vehicles keep from each other, and what is done where they would not."""

    limits: Limits = DEFAULT_LIMITS
    look_ahead_s: float = 10.0
    action: AvoidanceAction = "hold"


DEFAULT_SEPARATION = SeparationRules()


@dataclass(frozen=True, slots=True)
class NeighbourReport:
    """Another vehicle as it told of itself."""

    state: StateShared
    at_s: float
    """by the clock of the vehicle that heard it"""


@dataclass(frozen=True, slots=True)
class NeighbourIntent:
    """The flight that another vehicle has told it is on or is about to begin."""

    flight: Trajectory
    """by the clock and in the plane of the vehicle that heard it, up above the sea"""
    bounds: Bounds
    may_change: bool
    """it could give way"""
    said_s: float
    around_m: tuple[float, float] = (0.0, 0.0)
    """it is somewhere within this of that flight, over ground and in height"""
    on_ground: bool = False
    """it is about to take off"""

    def limits(self, limits: Limits) -> Limits:
        """What is to be kept from that flight, so that `limits` are kept from the vehicle."""
        horizontal_m, vertical_m = self.around_m
        return Limits(limits.horizontal_m + horizontal_m, limits.vertical_m + vertical_m)


@dataclass(frozen=True, slots=True)
class ProximityAlarm:
    """Another vehicle that will be too close."""

    other: int
    approach: Approach
    """as last predicted, by the vehicle's own clock"""
    clear_since_s: float | None = None
    """since when that is predicted no more"""


def update_alarms(
    alarms: Sequence[ProximityAlarm],
    own: Trajectory,
    others: Mapping[int, Trajectory],
    rules: SeparationRules,
    now_s: float,
) -> tuple[ProximityAlarm, ...]:
    """The alarms from now on, by system id. `others` are those heard of late, as they are predicted.

    One is raised at once, and ends with hysteresis: else it would come and go with every metre of error.
    """
    before = {alarm.other: alarm for alarm in alarms}
    wide = Limits(CLEAR_FACTOR * rules.limits.horizontal_m, CLEAR_FACTOR * rules.limits.vertical_m)
    after, mine = [], Bounds.of(own)
    for uav in sorted({*others, *before}):
        other, known = others.get(uav), before.get(uav)
        limits = rules.limits if known is None else wide
        if other is not None and _is_near(mine, other, limits) and intervals(own, other, limits):
            at = closest(own, other, rules.limits)
            assert at is not None
            after.append(ProximityAlarm(uav, at))
        elif known is not None:
            since_s = now_s if known.clear_since_s is None else known.clear_since_s
            if now_s - since_s < CLEAR_FOR_S:
                after.append(ProximityAlarm(uav, known.approach, since_s))
    return tuple(after)


def _is_near(mine: Bounds, other: Trajectory, limits: Limits) -> bool:
    reach = (0.0, limits.horizontal_m, limits.horizontal_m, limits.vertical_m)
    return mine.is_within(Bounds.of(other), reach)


def gives_way_by_id(uav: int, other: int) -> bool:
    """Of two vehicles exactly one gives way, without a word: the one with the higher system id."""
    return uav > other


Priority = tuple[bool, int]
"""whether a vehicle may change its plan, and its system id"""


def gives_way_to(one: Priority, other: Priority) -> bool:
    """Of two vehicles whose plans meet exactly one gives way, if either can: who may change its plan to who
    may not, else the one with the higher system id. A system id is known to all, and no two have the same."""
    (may, uav), (may_too, than) = one, other
    return may and (not may_too or gives_way_by_id(uav, than))


def clear_height_m(height_m: float, others_m: Sequence[float], limits: Limits) -> float:
    """The lowest height at or above `height_m` that keeps clear of others' heights [m]."""
    keeps_m = HEIGHT_MARGIN * limits.vertical_m
    for other_m in sorted(others_m):
        if abs(other_m - height_m) < keeps_m:
            height_m = other_m + keeps_m
    return height_m
