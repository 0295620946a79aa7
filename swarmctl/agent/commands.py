"""Commands of the agent to its vehicle. Pure."""

from __future__ import annotations

from typing import Any

from swarmctl.agent.arrival.common_time import CommandedSpeed
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.core.setpoint import STOP

StepResult = tuple[AgentState, list[ev.Effect]]
RETRY_AFTER_S = 5.0
"""Time until a failed order or mission change is tried again [s]."""
SPEED_EVERY_S, SPEED_CHANGE_M_S = 2.0, 0.2
"""Least time and least difference between two speeds of a mission [s], [m/s]."""


def command(
    state: AgentState, order: ev.FlightOrder, *, by_person: bool = False, **changes: Any
) -> StepResult:
    """Give the vehicle an order and cancel a mission change in progress; `changes` are further fields.

    The other vehicles learn of the order and of the new flight at once. With a lost link the vehicle may fly
    on, so no new flight is announced. A member of a group stops by a set-point until its hold begins, because
    it would go on by its last one.
    `by_person`: an operator or a recall has just given the order, so it is sent whatever the mode is.
    """
    roles = own_mode_roles(state)
    effects: list[ev.Effect] = [ev.Command(order, by_person)]
    follows = state.phase is Phase.FORMATION and state.vehicle.mode_role in roles  # not if a pilot may fly it
    if follows and order is ev.FlightOrder.HOLD:
        effects.insert(0, ev.SendSetPoint(STOP))
    order_sent = state.order.sent(order, roles)
    phase = changes.pop("phase", state.phase)
    plans = changes.pop("plans", state.plans).without_upload()
    state = state.enter(phase, **changes, plans=plans, order=order_sent, sent=state.sent.state_due())
    return state if state.lost else state.with_new_flight(), effects


def may_set_speed(state: AgentState) -> bool:
    """Return whether the vehicle flies its mission, and its last speed command is not recent."""
    since_s = state.vehicle.time_boot_s - state.speed.given_boot_s
    return state.flies_mission and not 0.0 <= since_s < SPEED_EVERY_S


def set_speed(state: AgentState, wanted_m_s: float) -> StepResult:
    """Set the speed of the mission, if the present speed differs by SPEED_CHANGE_M_S or more."""
    present_m_s = state.task.speed_m_s if state.speed.m_s is None else state.speed.m_s
    if not may_set_speed(state) or abs(wanted_m_s - present_m_s) < SPEED_CHANGE_M_S:
        return state, []
    speed = CommandedSpeed(wanted_m_s, state.vehicle.time_boot_s)
    return replace(state, speed=speed), [ev.SetSpeed(wanted_m_s)]


def release_vehicle(state: AgentState, why: str) -> StepResult:
    """Release the vehicle to another operator: the agent sends no further commands of its own."""
    outcome = f"{why}; the program now sends only an operator's orders (`swarmctl order`)"
    plans = state.plans.without_upload().not_due()
    return state.enter(Phase.RELEASED, plans=plans, outcome=outcome), [ev.Release()]
