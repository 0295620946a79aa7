"""What others tell of themselves: which of it a vehicle has to know, and where it keeps it."""

from __future__ import annotations

from dataclasses import replace

from swarmctl.agent.arrival.simultaneous import others_due
from swarmctl.agent.orders import Step
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.collision_avoidance import FRESH_S, is_near
from swarmctl.agent.traffic.returning import homeward_heard
from swarmctl.agent.traffic.separation.watch import Heard
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared


def concerns(state: AgentState, uav: int, other: StateShared) -> bool:
    """Whether what another tells is to be known: it is near, on the way home, or to arrive with this one."""
    on_its_way = other.returns_to is not None or uav in state.homeward
    return on_its_way or state.task.meeting is not None or is_near(state, other)


def neighbours_heard(state: AgentState, event: ev.Neighbours, _now: float) -> Step:
    now_s = state.vehicle.time_boot_s
    heard = {uav: Heard(told, now_s - told.age_s) for uav, told in event.states}
    kept = {uav: known for uav, known in state.neighbours.items() if 0.0 <= now_s - known.at_s <= FRESH_S}
    new = {uav: known for uav, known in heard.items() if is_near(state, known.state)}
    state = homeward_heard(others_due(state, event.states), heard)
    return replace(state, neighbours={**kept, **new}), []
