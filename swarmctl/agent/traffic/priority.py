"""The rule of priority: which of two vehicles in conflict gives way. Pure.

Every vehicle applies this rule to the same two standings, so exactly one of two vehicles gives way if at
least one can. `docs/traffic.md` shows RULE as a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from swarmctl.agent.phases import Phase

SAME_HEIGHT_M = 1.0
"""Difference in height below which the system id decides over a landing place [m]."""


class Activity(IntEnum):
    """Activities in order of priority: the lower number goes first."""

    EMERGENCY = 1
    LANDING = 2
    EN_ROUTE = 3
    CLIMBING = 4
    WAITING = 5


RULE: Mapping[Activity, tuple[str, str]] = {
    Activity.EMERGENCY: ("flown by a failsafe or another station, or without a link", "never"),
    Activity.LANDING: ("lands, or returns", "hovers above its landing spot"),
    Activity.EN_ROUTE: ("flies its route", "takes another route or height, or holds"),
    Activity.CLIMBING: ("is about to take off", "waits on the ground; not once it climbs"),
    Activity.WAITING: ("holds for other vehicles", "holds on"),
}
"""For each activity: the vehicle, and its way to give way. Equal activities: the lower height goes first if
both vehicles land, otherwise the lower system id."""

ACTIVITY_OF_PHASE: Mapping[str, Activity] = {
    Phase.LAUNCHING: Activity.CLIMBING,
    Phase.FLYING: Activity.EN_ROUTE,
    Phase.FORMATION: Activity.EN_ROUTE,
    Phase.LANDING: Activity.LANDING,
    Phase.LEAVING: Activity.LANDING,
    Phase.HOLDING: Activity.WAITING,
}
"""activity of a vehicle by the phase in its broadcast state; any other phase: EMERGENCY"""


@dataclass(frozen=True, slots=True)
class Standing:
    """The facts about one vehicle that the rule compares."""

    activity: Activity
    can_yield: bool
    """False: the vehicle cannot give way at all, or not in time"""
    uav: int
    up_m: float = 0.0
    """height [m], compared if both vehicles land"""


def activity_of(phase: str) -> Activity:
    """Return the activity of a vehicle in a phase that it has broadcast."""
    return ACTIVITY_OF_PHASE.get(phase, Activity.EMERGENCY)


def gives_way(one: Standing, other: Standing) -> bool:
    """Return whether `one` gives way to `other`.

    A vehicle that cannot give way has priority over all that can. Otherwise RULE decides.
    """
    if not (one.can_yield and other.can_yield):
        return one.can_yield
    if one.activity is not other.activity:
        return one.activity > other.activity
    if one.activity is Activity.LANDING and abs(one.up_m - other.up_m) > SAME_HEIGHT_M:
        return one.up_m > other.up_m
    return one.uav > other.uav
