"""States that other vehicles broadcast: relevance and storage. Pure."""

from __future__ import annotations

import math

from swarmctl.agent.arrival.simultaneous import note_arrival_times
from swarmctl.agent.orders import StepResult
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import MAX_REPORT_AGE_S
from swarmctl.agent.traffic.returning import note_returning
from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.records import replace

MARGIN_M_S = 5.0
"""Increase of the closing speed that the selection of nearby vehicles allows for [m/s]."""


def is_relevant(state: AgentState, uav: int, other: StateShared) -> bool:
    """Return whether the agent uses a state: its sender is near or returns, or arrivals are simultaneous."""
    returns = other.returns_to is not None or uav in state.return_wait.neighbours
    return returns or state.task.arrival_group is not None or is_near(state, other)


def receive_neighbours(state: AgentState, event: ev.Neighbours, _now: float) -> StepResult:
    """Store the states of nearby and returning vehicles, and the arrival times."""
    now_s = state.vehicle.time_boot_s
    reports = {uav: NeighbourReport(shared, now_s - shared.age_s) for uav, shared in event.states}
    known = state.neighbours.items()
    kept = {uav: report for uav, report in known if 0.0 <= now_s - report.at_s <= MAX_REPORT_AGE_S}
    new = {uav: report for uav, report in reports.items() if is_near(state, report.state)}
    to = {uav: reports.get(uav, report) for uav, report in state.give_way.to.items()}
    state = note_returning(note_arrival_times(state, event.states), reports)
    return replace(state, neighbours={**kept, **new}, give_way=replace(state.give_way, to=to)), []


def is_near(state: AgentState, other: StateShared) -> bool:
    """Return whether another vehicle may soon come too close; False if the own position is unknown."""
    vehicle, rules = state.vehicle, state.task.separation
    if vehicle.lat_deg is None or vehicle.lon_deg is None:
        return False
    frame = state.task.grid.frame
    here, there = (
        frame.to_local(vehicle.lat_deg, vehicle.lon_deg),
        frame.to_local(other.lat_deg, other.lon_deg),
    )
    speeds_m_s = vehicle.ground_speed_m_s + math.hypot(*other.velocity_m_s[:2]) + MARGIN_M_S
    return math.dist(here, there) < 2.0 * rules.limits.horizontal_m + speeds_m_s * (
        rules.look_ahead_s + MAX_REPORT_AGE_S
    )


def received_neighbours(state: AgentState) -> tuple[int, ...]:
    """Return the system ids of the nearby vehicles received recently."""
    now_s, reports = state.vehicle.time_boot_s, state.neighbours
    return tuple(
        sorted(uav for uav, report in reports.items() if 0.0 <= now_s - report.at_s <= MAX_REPORT_AGE_S)
    )
