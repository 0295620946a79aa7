"""States that other vehicles broadcast: relevance and storage. Pure."""

from __future__ import annotations

from dataclasses import replace

from swarmctl.agent.arrival.simultaneous import note_arrival_times
from swarmctl.agent.orders import StepResult
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.collision_avoidance import MAX_REPORT_AGE_S, is_near
from swarmctl.agent.traffic.returning import note_returning
from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared


def is_relevant(state: AgentState, uav: int, other: StateShared) -> bool:
    """Return whether a state matters: nearby, returning, or arriving at the same time."""
    on_its_way = other.returns_to is not None or uav in state.returning_neighbours
    return on_its_way or state.task.arrival_group is not None or is_near(state, other)


def receive_neighbours(state: AgentState, event: ev.Neighbours, _now: float) -> StepResult:
    now_s = state.vehicle.time_boot_s
    reports = {uav: NeighbourReport(shared, now_s - shared.age_s) for uav, shared in event.states}
    kept = {
        uav: known for uav, known in state.neighbours.items() if 0.0 <= now_s - known.at_s <= MAX_REPORT_AGE_S
    }
    new = {uav: known for uav, known in reports.items() if is_near(state, known.state)}
    state = note_returning(note_arrival_times(state, event.states), reports)
    return replace(state, neighbours={**kept, **new}), []
