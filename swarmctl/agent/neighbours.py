"""What others tell of themselves: which of it a vehicle has to know, and where it keeps it."""

from __future__ import annotations

from dataclasses import replace

from swarmctl.agent.apart import FRESH_S, is_near
from swarmctl.agent.meeting import others_due
from swarmctl.agent.orders import Step
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.separation.watch import Heard


def concerns(state: AgentState, other: StateShared) -> bool:
    """Whether what another tells is to be known: it is near, or they are to arrive together."""
    return state.task.meeting is not None or is_near(state, other)


def neighbours_heard(state: AgentState, event: ev.Neighbours, _now: float) -> Step:
    now_s = state.vehicle.time_boot_s
    kept = {uav: heard for uav, heard in state.neighbours.items() if 0.0 <= now_s - heard.at_s <= FRESH_S}
    new = {uav: Heard(told, now_s) for uav, told in event.states if is_near(state, told)}
    return replace(others_due(state, event.states), neighbours={**kept, **new}), []
