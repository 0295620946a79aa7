"""Proximity alarms in flight, and data on other vehicles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, closest, intervals
from swarmctl.agent.traffic.separation.clash import HEIGHT_TOLERANCE_M
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory
from swarmctl.core.frames import StateShared
from swarmctl.core.records import replace

AvoidanceAction = Literal["hold", "climb", "none"]

CLEAR_FACTOR = 1.5
"""Multiple of the limits that the prediction has to keep before an alarm ends."""
CLEAR_FOR_S = 2.0
"""Time for which the prediction has to keep CLEAR_FACTOR before an alarm ends [s]."""
MAX_REPORT_AGE_S = 5.0
"""Greatest age of a state from which another vehicle's position is predicted [s]."""
HEIGHT_MARGIN = 1.2
"""Multiple of the vertical limit that a new height keeps, because vehicles do not hold a height exactly."""

DEFAULT_LIMITS = Limits(10.0, 3.0)


class SeparationRules(msgspec.Struct, frozen=True):
    """Separation limits of the vehicles, and the evasive action."""

    limits: Limits = DEFAULT_LIMITS
    look_ahead_s: float = 10.0
    action: AvoidanceAction = "hold"


DEFAULT_SEPARATION = SeparationRules()


class NeighbourReport(msgspec.Struct, frozen=True):
    """Last state received from another vehicle."""

    state: StateShared
    at_s: float
    """time of the state by the clock of the receiving vehicle [s]"""
    position_m: LocalPoint
    """reported position in the local frame of the area, height above the sea [m]"""

    def is_recent(self, now_s: float) -> bool:
        """Return whether a position can still be predicted from this state."""
        return 0.0 <= now_s - self.at_s <= MAX_REPORT_AGE_S

    def hears(self, uav: int) -> bool:
        """Return whether the other vehicle acknowledges receiving the states of `uav`."""
        return uav in self.state.hears


class NeighbourIntent(msgspec.Struct, frozen=True):
    """Last intent received from another vehicle: its present or next flight."""

    flight: Trajectory
    """times of the receiver's vehicle clock, local frame of the area, heights above the sea"""
    bounds: Bounds
    """bounds of the flight, with its uncertainty"""
    may_change: bool
    """True if the vehicle can change its plan"""
    sent_s: float
    uncertainty_m: tuple[float, float] = (0.0, 0.0)
    """uncertainty of the flight, horizontal and vertical [m]"""
    on_ground: bool = False
    """True if the vehicle is about to take off"""
    landing: Trajectory | None = None
    """the flight with its landing; None if `flight` is the whole flight"""

    may_be_late: bool = False
    """True if the vehicle may have stopped anywhere on its flight, and may go on at any time"""

    straight: Trajectory | None = None
    """flight straight on for some seconds, if the vehicle is off its intent; else None"""

    def and_straight_on(self, straight: Trajectory) -> NeighbourIntent:
        """Return the intent of a vehicle off its intent, which may also fly straight on."""
        return replace(self, straight=straight, bounds=self.bounds.joined(Bounds.of(straight)))

    def straight_on(self) -> NeighbourIntent:
        """Return the flight straight on, as an intent."""
        assert self.straight is not None
        return replace(
            self,
            flight=self.straight,
            straight=None,
            landing=None,
            uncertainty_m=(0.0, 0.0),
            may_be_late=False,
        )

    def of_silent_vehicle(self, heard_s: float, until_s: float) -> NeighbourIntent | None:
        """Return the intent of a vehicle that is not heard any more since `heard_s`, for a time `until_s`.

        The vehicle flies and lands as announced, or stops on the way. The result is None if it has landed.
        """
        flight = self.landing or self.flight
        if flight.ends_in_hold:
            flight = flight.lasting(max(until_s, flight.times_s[-1]))
        ahead, (away_m, up_m) = flight.since(heard_s), self.uncertainty_m
        if ahead is None or len(ahead.times_s) < 2:
            return None
        bounds = Bounds.of(ahead).wider((math.inf, away_m, away_m, up_m))
        return replace(self, flight=ahead, bounds=bounds, may_change=False, landing=None, may_be_late=True)

    def may_meet(self, box: Bounds) -> bool:
        """Return whether the flight as announced may come into a box: a quick test."""
        return box.meets(self.bounds) and (any(self.uncertainty_m) or self.flight.may_meet(box))

    def limits(self, limits: Limits) -> Limits:
        """Return `limits` enlarged by the uncertainty of the flight."""
        horizontal_m, vertical_m = self.uncertainty_m
        return Limits(limits.horizontal_m + horizontal_m, limits.vertical_m + vertical_m)


class ProximityAlarm(msgspec.Struct, frozen=True):
    """A prediction that another vehicle comes too close."""

    other: int
    approach: PairDistance
    """last prediction, by the vehicle's own clock"""
    is_close: bool = True
    """True while the limits, less the accuracy of heights, are predicted to be broken"""
    clear_since_s: float | None = None
    """time since which the wider limits are predicted to be kept [s]; None while they are not"""


def update_alarms(
    alarms: Sequence[ProximityAlarm],
    own: Trajectory,
    others: Mapping[int, Trajectory],
    rules: SeparationRules,
    now_s: float,
) -> tuple[ProximityAlarm, ...]:
    """Return the updated alarms, in order of system id.

    `others`: predicted trajectories of the vehicles that sent a state recently; vehicles that stay outside
    `alarm_bounds` may be missing. Heights count with HEIGHT_TOLERANCE_M, as in `clash`. An alarm begins at
    once and ends with hysteresis, so that position errors do not toggle the alarm.
    """
    before = {alarm.other: alarm for alarm in alarms}
    wide = _wide(rules)
    near = Limits(rules.limits.horizontal_m, max(rules.limits.vertical_m - HEIGHT_TOLERANCE_M, 0.0))
    after = []
    for uav in sorted({*others, *before}):
        other, known = others.get(uav), before.get(uav)
        is_close = other is not None and bool(intervals(own, other, near))
        if other is not None and (is_close or (known is not None and intervals(own, other, wide))):
            at = closest(own, other, rules.limits)
            assert at is not None
            after.append(ProximityAlarm(uav, at, is_close))
        elif known is not None:
            since_s = now_s if known.clear_since_s is None else known.clear_since_s
            if now_s - since_s < CLEAR_FOR_S:
                after.append(ProximityAlarm(uav, known.approach, False, since_s))
    return tuple(after)


def alarm_bounds(own: Bounds, rules: SeparationRules) -> Bounds:
    """Return the bounds of the space in which another vehicle may begin an alarm, or keep one."""
    wide = _wide(rules)
    return own.wider((0.0, wide.horizontal_m, wide.horizontal_m, wide.vertical_m))


def _wide(rules: SeparationRules) -> Limits:
    limits = rules.limits
    return Limits(CLEAR_FACTOR * limits.horizontal_m, CLEAR_FACTOR * limits.vertical_m)


def clear_height_m(height_m: float, others_m: Sequence[float], limits: Limits) -> float:
    """Return the lowest height at or above `height_m` that is clear of others' heights [m]."""
    margin_m = HEIGHT_MARGIN * limits.vertical_m
    for other_m in sorted(others_m):
        if abs(other_m - height_m) < margin_m:
            height_m = other_m + margin_m
    return height_m
