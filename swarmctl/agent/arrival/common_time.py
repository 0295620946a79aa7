"""The common arrival time. Each agent computes the time from the states that all vehicles broadcast."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import msgspec

from swarmctl.core.records import replace

LEAST_SHARE = 0.2
"""least speed of an early vehicle, as a share of its full speed"""
LEAST_M_S = 1.0
"""least speed of an early vehicle [m/s]; below 0.5 m/s, the rule `not_following` may act"""
UNKNOWN_M_S = 0.0
"""value of `CommandedSpeed.m_s` while the vehicle's speed setting is unknown [m/s]"""
N_BISECTIONS = 14
"""number of bisections for a speed, to within about 1 mm/s"""


class ArrivalGroup(msgspec.Struct, frozen=True):
    """The vehicles that arrive together, and the rules of their arrival."""

    rank: Mapping[int, int]
    """system id -> position in the order of arrivals, from 0"""
    spacing_s: float = 0.0
    """time between consecutive arrivals [s]; 0: all at once"""
    tolerance_s: float = 3.0
    """greatest difference from the planned arrival times that the report accepts [s]"""
    slowest_m_s: float = 0.0
    """configured least speed of an early vehicle [m/s]"""


class CommonArrival(msgspec.Struct, frozen=True):
    """The common arrival as one vehicle knows it; times are by its own clock."""

    others_earliest_s: Mapping[int, float] = msgspec.field(default_factory=dict)
    """earliest arrivals of other vehicles over their goals"""
    due_s: float | None = None
    """this vehicle's time of arrival"""
    spare_time_due_s: float | None = None
    """`due_s` for which spare time was planned; None: no spare time was planned"""


class CommandedSpeed(msgspec.Struct, frozen=True):
    """The speed commanded on the present plan."""

    m_s: float | None = None
    """None: no command; 0: unknown"""
    given_boot_s: float = -math.inf
    """time of the last command, by the vehicle's clock"""

    def unknown(self) -> CommandedSpeed:
        """Return the speed after a failed command, or after a mode change that may have reset it."""
        return self if self.m_s is None else replace(self, m_s=UNKNOWN_M_S)


def agreed_arrival_s(group: ArrivalGroup, earliest_s: Mapping[int, float]) -> float:
    """Return the arrival time of the first vehicle [s], from the earliest possible times of all vehicles.

    The time is the earliest that all vehicles can keep. Raises ValueError if there is no vehicle.
    """
    return max(at_s - group.rank[uav] * group.spacing_s for uav, at_s in earliest_s.items())


def due_s(group: ArrivalGroup, uav: int, earliest_s: Mapping[int, float]) -> float:
    """Return the arrival time of vehicle `uav` of the group [s], never before its earliest possible time."""
    return agreed_arrival_s(group, earliest_s) + group.rank[uav] * group.spacing_s


def least_m_s(full_m_s: float, slowest_m_s: float = 0.0) -> float:
    """Return the least speed for a vehicle [m/s], at most its full speed."""
    return min(max(LEAST_SHARE * full_m_s, slowest_m_s, LEAST_M_S), full_m_s)


def speed_for(
    arrival_at: Callable[[float], float], due_s: float, full_m_s: float, slowest_m_s: float = 0.0
) -> float:
    """Return the speed at which a vehicle arrives at `due_s` [m/s].

    `arrival_at` returns the arrival time at a speed, and a faster vehicle is never later. If even full speed
    is too late, the result is full speed. If even `least_m_s` is too early, the result is `least_m_s`.
    """
    low, high = least_m_s(full_m_s, slowest_m_s), full_m_s
    if arrival_at(high) >= due_s:
        return high
    if arrival_at(low) <= due_s:
        return low
    for _ in range(N_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if arrival_at(middle) > due_s else (low, middle)
    return high
