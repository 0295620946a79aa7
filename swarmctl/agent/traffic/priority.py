"""The rule of priority: which of two vehicles in conflict gives way. Pure.

Every vehicle applies this rule to the standings of both, as it knows them. So at least one of two vehicles
gives way if one can, and normally exactly one. `docs/traffic.md` shows the rule as a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

import msgspec

from swarmctl.agent.phases import Phase

SAME_HEIGHT_M = 1.0
"""Difference in height below which the system id decides over a landing place [m]."""


class Activity(IntEnum):
    """Activities in order of priority: the lower number goes first."""

    EMERGENCY = 1
    """flown by a failsafe or another station, or without a link"""
    LANDING = 2
    """lands, or returns"""
    EN_ROUTE = 3
    """flies its route"""
    CLIMBING = 4
    """is about to take off"""
    WAITING = 5
    """holds by an order, or before its return or landing"""


ACTIVITY_OF_PHASE: Mapping[str, Activity] = {
    Phase.STANDBY: Activity.CLIMBING,
    Phase.LAUNCHING: Activity.CLIMBING,
    Phase.FLYING: Activity.EN_ROUTE,
    Phase.FORMATION: Activity.EN_ROUTE,
    Phase.LANDING: Activity.LANDING,
    Phase.LEAVING: Activity.LANDING,
    Phase.HOLDING: Activity.WAITING,
}
"""activity of a vehicle by the phase in its broadcast state; any other phase: EMERGENCY"""


class Standing(msgspec.Struct, frozen=True):
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

    A vehicle that cannot give way has priority over all that can. Otherwise the order of activities decides.
    Of two landing vehicles the lower one goes first, and of other equal vehicles the lower system id.
    """
    if not (one.can_yield and other.can_yield):
        return one.can_yield
    if one.activity is not other.activity:
        return one.activity > other.activity
    if one.activity is Activity.LANDING and abs(one.up_m - other.up_m) > SAME_HEIGHT_M:
        return one.up_m > other.up_m
    return one.uav > other.uav
