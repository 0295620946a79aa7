"""What the rules of flight demand of an agent, and how it follows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from swarmctl.agent import failsafes
from swarmctl.agent.failsafes.base import ActiveRoute, Activity, Demand, DemandKind, FailsafeFacts
from swarmctl.agent.orders import StepResult, command, release_vehicle
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.returning import MAX_RETURN_WAIT_S, NOT_WAITING, return_started, wait_to_return
from swarmctl.core import events as ev

_DOING: dict[Phase, Activity] = {
    Phase.LAUNCHING: "launch",
    Phase.FLYING: "mission",
    Phase.LANDING: "goal",
    Phase.HOLDING: "hold",
}
_WAITS = ": it holds until its way home is clear of the others'"
_SAID = {
    DemandKind.HOLD: "it holds",
    DemandKind.RETURN: "it returns",
    DemandKind.LAND: "it lands where it is",
}


def apply_failsafes(state: AgentState, now: float) -> StepResult:
    """Judge every rule by what is known now, and follow the strongest demand that was not made before.

    What is demanded on and on is followed once: an operator who orders otherwise afterwards is obeyed.
    """
    if state.ended:
        return state, []
    before = state.demands or (None,) * len(state.task.rules)
    memories, demands = failsafes.evaluate(state.task.rules, state.memories, failsafe_facts(state), now)
    state = replace(state, memories=memories, demands=demands)
    arisen = tuple(
        demand if demand is not None and _is_new(state, was, demand) else None
        for was, demand in zip(before, demands, strict=True)
    )
    strongest = failsafes.strongest(arisen)
    if strongest is not None and strongest.kind is DemandKind.LET_GO:
        return release_vehicle(state, strongest.why)
    effects: list[ev.Effect] = [
        ev.NotifyOperator(f"{ruling.rule.NAME.replace('_', ' ')} is over")
        for ruling, was, demand in zip(state.task.rules, before, demands, strict=True)
        if was is not None and was.kind is DemandKind.WARN and demand is None
    ]
    followed = _follow(state, strongest) if strongest is not None and _changes(state, strongest) else None
    for demand in arisen:
        if demand is not None:
            does = "" if followed is None else _says(followed[0], demand)
            effects.append(ev.NotifyOperator(demand.why + (does if demand is strongest else "")))
    if followed is None:
        return state, effects
    state, ordered = followed
    return state, [*effects, *ordered]


def _is_new(state: AgentState, was: Demand | None, demand: Demand) -> bool:
    """Also where it has waited for its turn, and may not any longer."""
    presses = was is not None and demand.urgent and not was.urgent and state.return_turn_boot_s is not None
    return was is None or was.kind is not demand.kind or presses


def _says(after: AgentState, demand: Demand) -> str:
    return _WAITS if after.returns_when_clear else f": {_SAID[demand.kind]}"


def failsafe_facts(state: AgentState) -> FailsafeFacts:
    return FailsafeFacts(
        vehicle=state.vehicle,
        frame=state.task.grid.frame,
        doing=_doing(state),
        ours=own_mode_roles(state),
        orders=state.orders_given,
        lost=state.lost,
        way=_way(state),
        fence=state.task.fence,
        turn_radius_m=0.0 if state.task.wings is None else state.task.turn_radius_m,
    )


def _doing(state: AgentState) -> Activity:
    if state.phase is Phase.LEAVING:
        return "return" if state.ordered is ev.FlightOrder.RETURN else "land"
    return _DOING.get(state.phase, "ground")


def _way(state: AgentState) -> ActiveRoute | None:
    swap = state.route
    if state.phase is not Phase.FLYING or swap is None or state.pending is not None:
        return None
    points = (*swap.plan.waypoints, swap.plan.landing)
    return ActiveRoute(swap.plan_id, tuple((point.lat_deg, point.lon_deg) for point in points))


def _changes(state: AgentState, demand: Demand) -> bool:
    """Whether it is stronger than what the vehicle does already."""
    does = failsafes.ACTIVITY_AS_DEMAND.get(_doing(state))
    return does is not None and failsafes.STRENGTH[demand.kind] > failsafes.STRENGTH[does]


def _follow(state: AgentState, demand: Demand) -> StepResult:
    order = ev.FlightOrder(demand.kind.value)
    down = order is not ev.FlightOrder.HOLD
    changes: dict[str, Any] = {
        "dirty": False,
        "interrupted_plan": None,
        # Whom no operator has called back has failed, however well it lands.
        "given_up": state.given_up or down,
        "outcome": demand.why,
        "trouble": demand.why,
    }
    if order is ev.FlightOrder.RETURN and not demand.urgent:
        until_s = state.vehicle.time_boot_s + MAX_RETURN_WAIT_S
        if (waits := wait_to_return(state, until_s, **changes)) is not None:
            return waits
        changes |= return_started(state, until_s)
    else:
        changes |= NOT_WAITING
    return command(state, order, phase=Phase.LEAVING if down else Phase.HOLDING, **changes)
