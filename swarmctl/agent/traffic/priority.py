"""The rule of priority: which of two vehicles in conflict gives way. Pure.

Every vehicle applies `gives_way` to the standings of both, as it knows them. So at least one of two vehicles
gives way if one can, and normally exactly one. `docs/traffic.md` shows the rule as a table.

| standing | of | by |
|---|---|---|
| `own_standing` | this vehicle | its phase |
| `standing_of` | another vehicle | its known flight |
| `reported_standing` | another vehicle | the phase of its last state |
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

import msgspec

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, NeighbourReport

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


def own_standing(state: AgentState, up_m: float = 0.0, *, can_yield: bool = True) -> Standing:
    """Return the standing of this vehicle; `up_m` is its height above the sea."""
    return Standing(activity_of(state.phase), can_yield, state.task.uav, up_m)


def standing_of(state: AgentState, uav: int, known: KnownFlight) -> Standing:
    """Return another vehicle's standing by its known flight: it yields if it can change its plan."""
    activity = Activity.EN_ROUTE if known.may_change else Activity.LANDING
    if known.on_ground:
        activity = Activity.CLIMBING
    now_s, flight = state.vehicle.time_boot_s, known.straight or known.flight
    at = flight.at(min(max(now_s, flight.times_s[0]), flight.times_s[-1]))
    up_m = flight.points[-1][2] if at is None else at[2]
    return Standing(activity, known.may_change, uav, up_m)


def reported_standing(uav: int, report: NeighbourReport, *, can_yield: bool = True) -> Standing:
    """Return another vehicle's standing by its last state, which does not tell whether it can yield."""
    return Standing(activity_of(report.state.phase), can_yield, uav, report.position_m[2])
