"""A return that may wait: it begins when the way home is clear of all who are on theirs. Pure.

Who is on the way home, and who holds until its turn, tells so in its state. Of several that wait the one with
the lowest system id is first. Two that begin before either has heard of the other both see it within a second
or two, while they still climb: of these the one with the higher system id holds again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec

from swarmctl.agent.failsafes import lost_link
from swarmctl.agent.orders import StepResult, command, place_for_return, urgent_return_reason
from swarmctl.agent.state import IN_FLIGHT, AgentState, Phase
from swarmctl.agent.traffic.return_turns import may_be_returning, place_from_state, schedule_for
from swarmctl.agent.traffic.separation.watch import NeighbourReport
from swarmctl.core import events as ev
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import MAX_AFTER_S

MAX_RETURN_WAIT_S = 120.0
"""Then it returns, whoever else does; also where it has begun in between."""
ONE_BY_ONE_S, MOST_ONE_BY_ONE = 10.0, 6
"""Of several whose time is over by then the lower system ids go that much before it, one after the other."""
LOOKS_EVERY_S = 1.0
SETTLES_S = 5.0
"""For so long after its begin it still gives way to another that has begun."""
CLIMBED = 0.9
"""of its altitude: who is so high takes off no more"""
WAITS_TOO_S = 5.0
"""Who was not heard for so long is not waited for, unless it was on its way."""

NOT_WAITING: dict[str, Any] = {
    "return_turn_boot_s": None,
    "returns_when_clear": False,
    "return_started_boot_s": None,
    "last_shared_s": -math.inf,  # the others are to know of it at once
}


def return_target(state: AgentState) -> LatLon | None:
    """Where it is on its way to, or waits to be; also where that is somebody else's doing. None where it is
    not, or its home is not known."""
    vehicle = state.vehicle
    if vehicle.home_lat_deg is None or vehicle.home_lon_deg is None:
        return None
    match state.phase:
        case Phase.LEAVING:
            returns = state.ordered is ev.FlightOrder.RETURN
        case Phase.HOLDING if not state.lost:
            returns = state.return_turn_boot_s is not None
        case Phase.RELEASED:
            returns = vehicle.armed and vehicle.mode_role == "return"
        case _:
            returns = state.lost and state.phase in IN_FLIGHT and _goes_home_unheard(state)
    return (vehicle.home_lat_deg, vehicle.home_lon_deg) if returns else None


def _goes_home_unheard(state: AgentState) -> bool:
    """Whether it returns by itself where it hears nothing, as its parameters were checked for."""
    return any(isinstance(r.params, lost_link.Params) and r.params.does == "return" for r in state.task.rules)


def note_returning(state: AgentState, states: Mapping[int, NeighbourReport]) -> AgentState:
    """Keep what was heard last of those that are on the way home."""
    now_s = state.vehicle.time_boot_s
    known = {**state.returning_neighbours, **states}
    kept = {
        uav: heard
        for uav, heard in known.items()
        if heard.state.returns_to is not None and heard.at_s <= now_s
    }
    return state if kept == state.returning_neighbours else replace(state, returning_neighbours=kept)


def wait_to_return(state: AgentState, until_s: float, **changes: Any) -> StepResult | None:
    """Have it hold until its way home is clear, `changes` with it, but not after `until_s`; None where it
    is, or it cannot hold."""
    if _takes_off(state) or is_return_path_clear(state):
        return None
    changes |= NOT_WAITING | {
        "phase": Phase.HOLDING,
        "return_turn_boot_s": until_s,
        "returns_when_clear": True,
    }
    if state.phase is Phase.HOLDING and state.ordered is ev.FlightOrder.HOLD:
        return replace(state, **changes), []
    return command(state, ev.FlightOrder.HOLD, **changes)


def _takes_off(state: AgentState) -> bool:
    """A fixed wing, which would hold in circles as low as it is."""
    wings, up_m = state.task.wings, state.vehicle.alt_rel_m
    if wings is None or up_m is None:
        return False
    return up_m < min(wings.takeoff_height_m, CLIMBED * state.task.altitude_m)


def return_started(state: AgentState, until_s: float) -> dict[str, Any]:
    """What changes with the begin of a return that could have waited, until then at most."""
    return NOT_WAITING | {
        "return_started_boot_s": state.vehicle.time_boot_s,
        "return_deadline_boot_s": until_s,
    }


def update_return(state: AgentState) -> StepResult:
    """With each position: the return that it has waited for, or the hold of who has to wait after all."""
    if state.phase is Phase.HOLDING and state.return_turn_boot_s is not None:
        return _waits(state, state.return_turn_boot_s)
    if state.phase is Phase.LEAVING and state.return_started_boot_s is not None:
        return _settles(state, state.return_started_boot_s)
    return state, []


def _waits(state: AgentState, return_turn_boot_s: float) -> StepResult:
    now_s = state.vehicle.time_boot_s
    most_s = MAX_RETURN_WAIT_S if state.returns_when_clear else MAX_AFTER_S
    # A clock that was set back tells no turn any more.
    if not 0.0 < return_turn_boot_s - now_s <= most_s:
        return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **NOT_WAITING)
    if not state.returns_when_clear or 0.0 <= now_s - state.return_checked_boot_s < LOOKS_EVERY_S:
        return state, []
    if return_turn_boot_s - now_s <= ONE_BY_ONE_S * min(_n_that_wait_longer(state), MOST_ONE_BY_ONE):
        return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **NOT_WAITING)
    if not (urgent_return_reason(state) or is_return_path_clear(state)):
        return replace(state, return_checked_boot_s=now_s), []
    state, ordered = command(
        state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **return_started(state, return_turn_boot_s)
    )
    return state, [ev.NotifyOperator("its way home is clear: it returns"), *ordered]


def _n_that_wait_longer(state: AgentState) -> int:
    """Those that wait, too, and have a higher system id."""
    now_s = state.vehicle.time_boot_s
    return sum(
        uav > state.task.uav and heard.state.phase == Phase.HOLDING and now_s - heard.at_s <= WAITS_TOO_S
        for uav, heard in state.returning_neighbours.items()
    )


def _settles(state: AgentState, since_s: float) -> StepResult:
    """Of two that have begun at one time the one with the higher system id holds again."""
    now_s = state.vehicle.time_boot_s
    if not 0.0 <= now_s - since_s < SETTLES_S or now_s >= state.return_deadline_boot_s:
        return replace(state, return_started_boot_s=None), []
    if urgent_return_reason(state):
        return state, []
    lower = {uav: heard for uav, heard in state.returning_neighbours.items() if uav < state.task.uav}
    held = wait_to_return(replace(state, returning_neighbours=lower), state.return_deadline_boot_s)
    if held is None:
        return state, []
    text = "another has begun its way home at the same time: it holds until that is past"
    return replace(held[0], returning_neighbours=state.returning_neighbours), [
        ev.NotifyOperator(text),
        *held[1],
    ]


def is_return_path_clear(state: AgentState) -> bool:
    """Whether its way home meets nobody's who is on the way home, or waits and is before it. Nobody waits
    who does not know where it is."""
    own, now_s = place_for_return(state), state.vehicle.time_boot_s
    if own is None:
        return True
    own = msgspec.structs.replace(own, is_returning=False)
    before = {}
    for uav, heard in state.returning_neighbours.items():
        place = place_from_state(heard.state, own)
        if place is None:
            continue
        waits = heard.state.phase == Phase.HOLDING
        first = waits and uav < state.task.uav and now_s - heard.at_s <= WAITS_TOO_S
        if first or (not waits and may_be_returning(place, now_s - heard.at_s)):
            before[uav] = place
    return not before or schedule_for({**before, state.task.uav: own}).begins_s[state.task.uav] == 0.0
