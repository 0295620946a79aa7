"""Return queue: a vehicle that returns by a failsafe holds until its path home is clear. Pure.

Vehicles broadcast their returns, and their holds before a return.

| situation | rule |
|---|---|
| one vehicle returns, another waits | the returning vehicle is first |
| two vehicles wait | the lower system id is first |
| two vehicles started at the same time | within 5 s the vehicle with the higher system id holds again |
| urgent return (very low battery) | starts at once; other returns are scheduled around it |
| a vehicle has waited for 120 s | returns in any case; lower system ids up to 60 s earlier, in 10 s steps |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from swarmctl.agent.failsafes import lost_link
from swarmctl.agent.orders import StepResult, command, position_for_return, urgent_return_reason
from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.return_schedule import may_be_returning, position_from_state, schedule_for
from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core import events as ev
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import MAX_AFTER_S
from swarmctl.core.records import replace

MAX_RETURN_WAIT_S = 120.0
"""Longest wait for a clear path [s]; an interrupted return does not extend it."""
STAGGER_S = 10.0
"""Time between starts at the end of the longest wait [s], the lowest system id first."""
MAX_STAGGERED = 6
"""Greatest number of steps of STAGGER_S by which a vehicle starts early."""
CHECK_EVERY_S = 1.0
"""Interval between checks of the return path [s]."""
SETTLING_S = 5.0
"""Time after the start of a return in which the vehicle gives way to a simultaneous start [s]."""
CLIMBED_SHARE = 0.9
"""Share of the cruise altitude above which a fixed wing has finished its take-off."""
SHARED_AT_ONCE: dict[str, Any] = {"last_shared_s": -math.inf}
"""changed field after which the state is sent at once"""
MAX_WAITING_AGE_S = 5.0
"""Silence after which a waiting vehicle no longer counts [s]; returning vehicles: `may_be_returning`."""


def return_target(state: AgentState) -> LatLon | None:
    """Return the home of a vehicle that returns or waits to return, also after a release or a lost link.

    The result is None for any other vehicle, and if home is unknown.
    """
    vehicle = state.vehicle
    if vehicle.home_lat_deg is None or vehicle.home_lon_deg is None:
        return None
    match state.phase:
        case Phase.LEAVING:
            returns = state.order.given is ev.FlightOrder.RETURN
        case Phase.HOLDING if not state.lost:
            returns = state.return_wait.latest_boot_s is not None
        case Phase.RELEASED:
            returns = vehicle.armed and vehicle.mode_role == "return"
        case _:
            returns = state.lost and state.phase in IN_FLIGHT and _returns_on_lost_link(state)
    return (vehicle.home_lat_deg, vehicle.home_lon_deg) if returns else None


def _returns_on_lost_link(state: AgentState) -> bool:
    return any(isinstance(r.params, lost_link.Params) and r.params.does == "return" for r in state.task.rules)


def note_returning(state: AgentState, reports: Mapping[int, NeighbourReport]) -> AgentState:
    """Store the last states of vehicles that return or wait to return."""
    now_s = state.vehicle.time_boot_s
    known = {**state.return_wait.neighbours, **reports}
    kept = {
        uav: report
        for uav, report in known.items()
        if report.state.returns_to is not None and report.at_s <= now_s
    }
    wait = state.return_wait
    return state if kept == wait.neighbours else replace(state, return_wait=replace(wait, neighbours=kept))


def wait_to_return(state: AgentState, until_s: float, **changes: Any) -> StepResult | None:
    """Hold until the return path is clear, at most until `until_s`; `changes` are further changed fields.

    Return None if the path is clear already, or if the vehicle cannot hold.
    """
    if _takes_off(state) or is_return_path_clear(state):
        return None
    waiting = state.return_wait.until_clear(until_s)
    changes |= {"phase": Phase.HOLDING, "return_wait": waiting, **SHARED_AT_ONCE}
    if state.phase is Phase.HOLDING and state.order.given is ev.FlightOrder.HOLD:
        return replace(state, **changes), []
    return command(state, ev.FlightOrder.HOLD, **changes)


def _takes_off(state: AgentState) -> bool:
    """Return whether a fixed wing still climbs after take-off, and would circle too low in hold."""
    wings, up_m = state.task.wings, state.vehicle.alt_rel_m
    if wings is None or up_m is None:
        return False
    return up_m < min(wings.takeoff_height_m, CLIMBED_SHARE * state.task.altitude_m)


def start_return(state: AgentState, until_s: float | None = None, **changes: Any) -> StepResult:
    """Order the return; `changes` are further changed fields.

    Until `until_s` the return may have to hold again at its start; None: it never does.
    """
    wait, now_s = state.return_wait, state.vehicle.time_boot_s
    started = wait.over() if until_s is None else wait.started(now_s, until_s)
    changes |= {"return_wait": started, **SHARED_AT_ONCE}
    return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **changes)


def update_return(state: AgentState) -> StepResult:
    """Start a waiting return, or interrupt a return that has just started. Called for each position."""
    if state.phase is Phase.HOLDING and state.return_wait.latest_boot_s is not None:
        return _wait_or_start(state, state.return_wait.latest_boot_s)
    if state.phase is Phase.LEAVING and state.return_wait.started_boot_s is not None:
        return _yield_to_simultaneous_start(state, state.return_wait.started_boot_s)
    return state, []


def _wait_or_start(state: AgentState, return_latest_boot_s: float) -> StepResult:
    now_s = state.vehicle.time_boot_s
    most_s = MAX_RETURN_WAIT_S if state.return_wait.when_clear else MAX_AFTER_S
    # After a reboot of the vehicle the start time does not fit the vehicle's clock.
    if not 0.0 < return_latest_boot_s - now_s <= most_s:
        return start_return(state)
    if not state.return_wait.when_clear or 0.0 <= now_s - state.return_wait.checked_boot_s < CHECK_EVERY_S:
        return state, []
    if return_latest_boot_s - now_s <= STAGGER_S * min(_n_waiting_with_higher_id(state), MAX_STAGGERED):
        return start_return(state)
    if not (urgent_return_reason(state) or is_return_path_clear(state)):
        return replace(state, return_wait=replace(state.return_wait, checked_boot_s=now_s)), []
    state, ordered = start_return(state, return_latest_boot_s)
    return state, [
        ev.NotifyOperator("the return path is clear; the vehicle returns [return-clear]"),
        *ordered,
    ]


def _n_waiting_with_higher_id(state: AgentState) -> int:
    now_s = state.vehicle.time_boot_s
    return sum(
        uav > state.task.uav
        and report.state.phase == Phase.HOLDING
        and now_s - report.at_s <= MAX_WAITING_AGE_S
        for uav, report in state.return_wait.neighbours.items()
    )


def _yield_to_simultaneous_start(state: AgentState, since_s: float) -> StepResult:
    """Hold again if the path is not clear of a vehicle with a lower system id."""
    now_s = state.vehicle.time_boot_s
    if not 0.0 <= now_s - since_s < SETTLING_S or now_s >= state.return_wait.deadline_boot_s:
        return replace(state, return_wait=replace(state.return_wait, started_boot_s=None)), []
    if urgent_return_reason(state):
        return state, []
    wait = state.return_wait
    lower = {uav: report for uav, report in wait.neighbours.items() if uav < state.task.uav}
    with_lower = replace(state, return_wait=replace(wait, neighbours=lower))
    held = wait_to_return(with_lower, wait.deadline_boot_s)
    if held is None:
        return state, []
    text = "another vehicle started a return at the same time; this vehicle holds until its path is clear"
    holding = replace(held[0], return_wait=replace(held[0].return_wait, neighbours=wait.neighbours))
    return holding, [
        ev.NotifyOperator(f"{text} [return-yields]"),
        *held[1],
    ]


def is_return_path_clear(state: AgentState) -> bool:
    """Return whether the return path is clear of vehicles that return or have priority in the queue.

    The result is True if position or home is unknown, because such a vehicle does not wait.
    """
    own, now_s = position_for_return(state), state.vehicle.time_boot_s
    if own is None:
        return True
    own = msgspec.structs.replace(own, is_returning=False)
    positions = {}
    for uav, report in state.return_wait.neighbours.items():
        position = position_from_state(report.state, own)
        if position is None:
            continue
        waits = report.state.phase == Phase.HOLDING
        is_first = waits and uav < state.task.uav and now_s - report.at_s <= MAX_WAITING_AGE_S
        if is_first or (not waits and may_be_returning(position, now_s - report.at_s)):
            positions[uav] = position
    return not positions or schedule_for({**positions, state.task.uav: own}).begins_s[state.task.uav] == 0.0
