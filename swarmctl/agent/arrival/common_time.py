"""One arrival for many: what all know makes all agree, without a word of negotiation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

LEAST_SHARE = 0.2
"""of its speed, below which a vehicle is not slowed down"""
LEAST_M_S = 1.0
"""nor below this: what is slower cannot be told from one that stands, and is sent home for that"""
HALVINGS = 14
"""to within a millimetre a second"""


@dataclass(frozen=True, slots=True)
class ArrivalGroup:
    """What a vehicle has to know of it beforehand."""

    rank: Mapping[int, int]
    """system id -> which it is in the order of arrivals, from 0"""
    spacing_s: float = 0.0
    """from one arrival to the next; 0: all at once"""
    tolerance_s: float = 3.0
    slowest_m_s: float = 0.0
    """nobody is slowed down below this"""


def agreed_arrival_s(group: ArrivalGroup, earliest_s: Mapping[int, float]) -> float:
    """When the first of them is due, by who can be there when at the earliest [s]: the slowest sets it.
    Raises ValueError where nobody can."""
    return max(at_s - group.rank[uav] * group.spacing_s for uav, at_s in earliest_s.items())


def due_s(group: ArrivalGroup, uav: int, earliest_s: Mapping[int, float]) -> float:
    """When `uav`, who is one of them, is due [s]: never before it can be there."""
    return agreed_arrival_s(group, earliest_s) + group.rank[uav] * group.spacing_s


def least_m_s(most_m_s: float, slowest_m_s: float = 0.0) -> float:
    """The least speed that a vehicle is given: LEAST_SHARE of its own, or more where it needs more."""
    return min(max(LEAST_SHARE * most_m_s, slowest_m_s, LEAST_M_S), most_m_s)


def speed_for(
    arrives_s: Callable[[float], float], due_s: float, most_m_s: float, slowest_m_s: float = 0.0
) -> float:
    """The speed at which a vehicle arrives when it is due, `arrives_s(speed)` falling with speed [m/s];
    between `least_m_s` and `most_m_s`, where it cannot be met."""
    low, high = least_m_s(most_m_s, slowest_m_s), most_m_s
    if arrives_s(high) >= due_s:
        return high
    if arrives_s(low) <= due_s:
        return low
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if arrives_s(middle) > due_s else (low, middle)
    return high
