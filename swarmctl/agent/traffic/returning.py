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
from swarmctl.agent.orders import Step, command, place_of, presses
from swarmctl.agent.state import IN_FLIGHT, AgentState, Phase
from swarmctl.agent.traffic.return_turns import is_on_its_way, place_told, turns_of
from swarmctl.agent.traffic.separation.watch import Heard
from swarmctl.core import events as ev
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import MAX_AFTER_S

WAITS_FOR_S = 120.0
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

NO_TURN: dict[str, Any] = {
    "turn_boot_s": None,
    "turn_is_own": False,
    "returns_since_s": None,
    "last_shared_s": -math.inf,  # the others are to know of it at once
}


def home_of(state: AgentState) -> LatLon | None:
    """Where it is on its way to, or waits to be; also where that is somebody else's doing. None where it is
    not, or its home is not known."""
    vehicle = state.vehicle
    if vehicle.home_lat_deg is None or vehicle.home_lon_deg is None:
        return None
    match state.phase:
        case Phase.LEAVING:
            returns = state.ordered is ev.Order.RETURN
        case Phase.HOLDING if not state.lost:
            returns = state.turn_boot_s is not None
        case Phase.RELEASED:
            returns = vehicle.armed and vehicle.mode_role == "return"
        case _:
            returns = state.lost and state.phase in IN_FLIGHT and _goes_home_unheard(state)
    return (vehicle.home_lat_deg, vehicle.home_lon_deg) if returns else None


def _goes_home_unheard(state: AgentState) -> bool:
    """Whether it returns by itself where it hears nothing, as its parameters were checked for."""
    return any(isinstance(r.params, lost_link.Params) and r.params.does == "return" for r in state.task.rules)


def homeward_heard(state: AgentState, states: Mapping[int, Heard]) -> AgentState:
    """Keep what was heard last of those that are on the way home."""
    now_s = state.vehicle.time_boot_s
    known = {**state.homeward, **states}
    kept = {
        uav: heard
        for uav, heard in known.items()
        if heard.state.returns_to is not None and heard.at_s <= now_s
    }
    return state if kept == state.homeward else replace(state, homeward=kept)


def return_in_turn(state: AgentState, until_s: float, **changes: Any) -> Step | None:
    """Have it hold until its way home is clear, `changes` with it, but not after `until_s`; None where it
    is, or it cannot hold."""
    if _takes_off(state) or is_clear(state):
        return None
    changes |= NO_TURN | {"phase": Phase.HOLDING, "turn_boot_s": until_s, "turn_is_own": True}
    if state.phase is Phase.HOLDING and state.ordered is ev.Order.HOLD:
        return replace(state, **changes), []
    return command(state, ev.Order.HOLD, **changes)


def _takes_off(state: AgentState) -> bool:
    """A fixed wing, which would hold in circles as low as it is."""
    wings, up_m = state.task.wings, state.vehicle.alt_rel_m
    if wings is None or up_m is None:
        return False
    return up_m < min(wings.takeoff_height_m, CLIMBED * state.task.altitude_m)


def begun(state: AgentState, until_s: float) -> dict[str, Any]:
    """What changes with the begin of a return that could have waited, until then at most."""
    return NO_TURN | {"returns_since_s": state.vehicle.time_boot_s, "waits_until_s": until_s}


def take_turn(state: AgentState) -> Step:
    """With each position: the return that it has waited for, or the hold of who has to wait after all."""
    if state.phase is Phase.HOLDING and state.turn_boot_s is not None:
        return _waits(state, state.turn_boot_s)
    if state.phase is Phase.LEAVING and state.returns_since_s is not None:
        return _settles(state, state.returns_since_s)
    return state, []


def _waits(state: AgentState, turn_boot_s: float) -> Step:
    now_s = state.vehicle.time_boot_s
    most_s = WAITS_FOR_S if state.turn_is_own else MAX_AFTER_S
    # A clock that was set back tells no turn any more.
    if not 0.0 < turn_boot_s - now_s <= most_s:
        return command(state, ev.Order.RETURN, phase=Phase.LEAVING, **NO_TURN)
    if not state.turn_is_own or 0.0 <= now_s - state.looked_homeward_s < LOOKS_EVERY_S:
        return state, []
    if turn_boot_s - now_s <= ONE_BY_ONE_S * min(_n_that_wait_longer(state), MOST_ONE_BY_ONE):
        return command(state, ev.Order.RETURN, phase=Phase.LEAVING, **NO_TURN)
    if not (presses(state) or is_clear(state)):
        return replace(state, looked_homeward_s=now_s), []
    state, ordered = command(state, ev.Order.RETURN, phase=Phase.LEAVING, **begun(state, turn_boot_s))
    return state, [ev.Tell("its way home is clear: it returns"), *ordered]


def _n_that_wait_longer(state: AgentState) -> int:
    """Those that wait, too, and have a higher system id."""
    now_s = state.vehicle.time_boot_s
    return sum(
        uav > state.task.uav and heard.state.phase == Phase.HOLDING and now_s - heard.at_s <= WAITS_TOO_S
        for uav, heard in state.homeward.items()
    )


def _settles(state: AgentState, since_s: float) -> Step:
    """Of two that have begun at one time the one with the higher system id holds again."""
    now_s = state.vehicle.time_boot_s
    if not 0.0 <= now_s - since_s < SETTLES_S or now_s >= state.waits_until_s:
        return replace(state, returns_since_s=None), []
    if presses(state):
        return state, []
    lower = {uav: heard for uav, heard in state.homeward.items() if uav < state.task.uav}
    held = return_in_turn(replace(state, homeward=lower), state.waits_until_s)
    if held is None:
        return state, []
    text = "another has begun its way home at the same time: it holds until that is past"
    return replace(held[0], homeward=state.homeward), [ev.Tell(text), *held[1]]


def is_clear(state: AgentState) -> bool:
    """Whether its way home meets nobody's who is on the way home, or waits and is before it. Nobody waits
    who does not know where it is."""
    own, now_s = place_of(state), state.vehicle.time_boot_s
    if own is None:
        return True
    own = msgspec.structs.replace(own, is_returning=False)
    before = {}
    for uav, heard in state.homeward.items():
        place = place_told(heard.state, own)
        if place is None:
            continue
        waits = heard.state.phase == Phase.HOLDING
        first = waits and uav < state.task.uav and now_s - heard.at_s <= WAITS_TOO_S
        if first or (not waits and is_on_its_way(place, now_s - heard.at_s)):
            before[uav] = place
    return not before or turns_of({**before, state.task.uav: own}).begins_s[state.task.uav] == 0.0
