"""States that other vehicles broadcast: relevance and storage. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from swarmctl.agent.arrival.simultaneous import note_arrival_times
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import HEARD_S, MAX_AGE_S
from swarmctl.agent.traffic.returning import note_returning
from swarmctl.agent.traffic.separation.other_vehicles import MAX_REPORT_AGE_S, NeighbourReport
from swarmctl.core.frames import StateShared
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace

CLOSING_MARGIN_M_S = 5.0
"""Increase of the closing speed that the selection of nearby vehicles allows for [m/s]."""


def relevant_states(
    state: AgentState, received: Iterable[tuple[int, float, StateShared]]
) -> tuple[tuple[int, StateShared], ...]:
    """Return the states of senders that are or were near, or return; all if the arrivals are simultaneous.

    received: (UAV, age of the message [s], state); the ages of the returned states include it
    """
    is_near, to_local = _near_test(state), state.task.grid.frame.to_local
    known = state.received.returning.keys() | state.neighbours.keys()
    takes_all = state.task.arrival_group is not None
    return tuple(
        (uav, replace(other, age_s=other.age_s + age_s))
        for uav, age_s, other in received
        if takes_all
        or other.returns_to is not None
        or uav in known
        or is_near(other, to_local(other.lat_deg, other.lon_deg))
    )


def receive_neighbours(state: AgentState, states: Sequence[tuple[int, StateShared]]) -> AgentState:
    """Store the states of nearby and returning vehicles, and the arrival times."""
    now_s, to_local = state.vehicle.time_boot_s, state.task.grid.frame.to_local
    reports = {
        uav: NeighbourReport(
            shared,
            now_s - shared.age_s,
            (*to_local(shared.lat_deg, shared.lon_deg), shared.alt_amsl_m),
        )
        for uav, shared in states
    }
    before, is_near = state.received.reports, _near_test(state)
    kept = {
        uav: report
        for uav, report in before.items()
        if uav not in reports and 0.0 <= now_s - report.at_s <= MAX_AGE_S
    }
    new = {uav: report for uav, report in reports.items() if is_near(report.state, report.position_m[:2])}
    if any(uav not in before or now_s - before[uav].at_s > HEARD_S for uav in new):
        # A vehicle hears this one for the first time.
        state = replace(state, sent=replace(state.sent, intent_new_boot_s=now_s))
    state = note_returning(note_arrival_times(state, states), reports)
    return replace(state, received=replace(state.received, reports={**kept, **new}))


def _near_test(state: AgentState) -> Callable[[StateShared, PlanarPoint], bool]:
    """Return a test whether another vehicle, at a place in the local frame, may soon come too close.

    The test returns False if the own position is unknown.
    """
    vehicle, rules, frame = state.vehicle, state.task.separation, state.task.grid.frame
    if vehicle.lat_lon is None:
        return lambda _other, _there: False
    here, least_m = frame.to_local(*vehicle.lat_lon), 2.0 * rules.limits.horizontal_m
    ahead_s, own_m_s = rules.look_ahead_s + MAX_REPORT_AGE_S, vehicle.ground_speed_m_s

    def is_near(other: StateShared, there: PlanarPoint) -> bool:
        east_m_s, north_m_s, _ = other.velocity_m_s
        closing_m_s = own_m_s + math.hypot(east_m_s, north_m_s) + CLOSING_MARGIN_M_S
        return math.dist(here, there) < least_m + closing_m_s * ahead_s

    return is_near


def received_neighbours(state: AgentState) -> tuple[int, ...]:
    """Return the system ids of the nearby vehicles received recently."""
    now_s, reports = state.vehicle.time_boot_s, state.neighbours
    return tuple(sorted(uav for uav, report in reports.items() if report.is_recent(now_s)))
