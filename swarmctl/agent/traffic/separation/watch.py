"""The rules of separation, and proximity alarms in flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from swarmctl.agent.traffic.separation.approach import Limits, PairDistance, closest, intervals
from swarmctl.agent.traffic.separation.clash import HEIGHT_TOLERANCE_M
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory

AvoidanceAction = Literal["hold", "climb", "none"]

CLEAR_FACTOR = 1.5
"""Multiple of the limits that the prediction has to keep before an alarm ends."""
CLEAR_FOR_S = 2.0
"""Time for which the prediction has to keep CLEAR_FACTOR before an alarm ends [s]."""
HEIGHT_MARGIN = 1.2
"""Multiple of the vertical limit that a new height keeps, because vehicles do not hold a height exactly."""

DEFAULT_LIMITS = Limits(10.0, 3.0)


class SeparationRules(msgspec.Struct, frozen=True):
    """Separation limits of the vehicles, and the evasive action."""

    limits: Limits = DEFAULT_LIMITS
    look_ahead_s: float = 10.0
    action: AvoidanceAction = "hold"


DEFAULT_SEPARATION = SeparationRules()


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
