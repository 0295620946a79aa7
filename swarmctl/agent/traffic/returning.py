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
from dataclasses import replace
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
MAX_WAITING_AGE_S = 5.0
"""Silence after which a waiting vehicle no longer counts [s]; returning vehicles: `may_be_returning`."""

NOT_WAITING: dict[str, Any] = {
    "return_latest_boot_s": None,
    "returns_when_clear": False,
    "return_started_boot_s": None,
    "last_shared_s": -math.inf,  # the state is sent at once
}


def return_target(state: AgentState) -> LatLon | None:
    """Return the home of a vehicle that returns or waits to return, also after a release or a lost link.

    The result is None for any other vehicle, and if home is unknown.
    """
    vehicle = state.vehicle
    if vehicle.home_lat_deg is None or vehicle.home_lon_deg is None:
        return None
    match state.phase:
        case Phase.LEAVING:
            returns = state.ordered is ev.FlightOrder.RETURN
        case Phase.HOLDING if not state.lost:
            returns = state.return_latest_boot_s is not None
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
    known = {**state.returning_neighbours, **reports}
    kept = {
        uav: report
        for uav, report in known.items()
        if report.state.returns_to is not None and report.at_s <= now_s
    }
    return state if kept == state.returning_neighbours else replace(state, returning_neighbours=kept)


def wait_to_return(state: AgentState, until_s: float, **changes: Any) -> StepResult | None:
    """Hold until the return path is clear, at most until `until_s`; `changes` are further changed fields.

    Return None if the path is clear already, or if the vehicle cannot hold.
    """
    if _takes_off(state) or is_return_path_clear(state):
        return None
    changes |= NOT_WAITING | {
        "phase": Phase.HOLDING,
        "return_latest_boot_s": until_s,
        "returns_when_clear": True,
    }
    if state.phase is Phase.HOLDING and state.ordered is ev.FlightOrder.HOLD:
        return replace(state, **changes), []
    return command(state, ev.FlightOrder.HOLD, **changes)


def _takes_off(state: AgentState) -> bool:
    """Return whether a fixed wing still climbs after take-off, and would circle too low in hold."""
    wings, up_m = state.task.wings, state.vehicle.alt_rel_m
    if wings is None or up_m is None:
        return False
    return up_m < min(wings.takeoff_height_m, CLIMBED_SHARE * state.task.altitude_m)


def return_changes(state: AgentState, until_s: float) -> dict[str, Any]:
    """Return the changed fields at the start of a return that may hold again, at most until `until_s`."""
    return NOT_WAITING | {
        "return_started_boot_s": state.vehicle.time_boot_s,
        "return_deadline_boot_s": until_s,
    }


def update_return(state: AgentState) -> StepResult:
    """Start a waiting return, or interrupt a return that has just started. Called for each position."""
    if state.phase is Phase.HOLDING and state.return_latest_boot_s is not None:
        return _wait_or_start(state, state.return_latest_boot_s)
    if state.phase is Phase.LEAVING and state.return_started_boot_s is not None:
        return _yield_to_simultaneous_start(state, state.return_started_boot_s)
    return state, []


def _wait_or_start(state: AgentState, return_latest_boot_s: float) -> StepResult:
    now_s = state.vehicle.time_boot_s
    most_s = MAX_RETURN_WAIT_S if state.returns_when_clear else MAX_AFTER_S
    # After a reboot of the vehicle the start time does not fit the vehicle's clock.
    if not 0.0 < return_latest_boot_s - now_s <= most_s:
        return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **NOT_WAITING)
    if not state.returns_when_clear or 0.0 <= now_s - state.return_checked_boot_s < CHECK_EVERY_S:
        return state, []
    if return_latest_boot_s - now_s <= STAGGER_S * min(_n_waiting_with_higher_id(state), MAX_STAGGERED):
        return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **NOT_WAITING)
    if not (urgent_return_reason(state) or is_return_path_clear(state)):
        return replace(state, return_checked_boot_s=now_s), []
    state, ordered = command(
        state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **return_changes(state, return_latest_boot_s)
    )
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
        for uav, report in state.returning_neighbours.items()
    )


def _yield_to_simultaneous_start(state: AgentState, since_s: float) -> StepResult:
    """Hold again if the path is not clear of a vehicle with a lower system id."""
    now_s = state.vehicle.time_boot_s
    if not 0.0 <= now_s - since_s < SETTLING_S or now_s >= state.return_deadline_boot_s:
        return replace(state, return_started_boot_s=None), []
    if urgent_return_reason(state):
        return state, []
    lower = {uav: report for uav, report in state.returning_neighbours.items() if uav < state.task.uav}
    held = wait_to_return(replace(state, returning_neighbours=lower), state.return_deadline_boot_s)
    if held is None:
        return state, []
    text = "another vehicle started a return at the same time; this vehicle holds until its path is clear"
    return replace(held[0], returning_neighbours=state.returning_neighbours), [
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
    for uav, report in state.returning_neighbours.items():
        position = position_from_state(report.state, own)
        if position is None:
            continue
        waits = report.state.phase == Phase.HOLDING
        is_first = waits and uav < state.task.uav and now_s - report.at_s <= MAX_WAITING_AGE_S
        if is_first or (not waits and may_be_returning(position, now_s - report.at_s)):
            positions[uav] = position
    return not positions or schedule_for({**positions, state.task.uav: own}).begins_s[state.task.uav] == 0.0
