"""What the rules of flight demand of an agent, and how it follows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from swarmctl.agent import failsafes
from swarmctl.agent.failsafes.base import Action, Doing, Facts, Kind, Way
from swarmctl.agent.orders import Step, command, let_go
from swarmctl.agent.own_modes import roles_of_ours
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.returning import NO_TURN, WAITS_FOR_S, begun, return_in_turn
from swarmctl.core import events as ev

_DOING: dict[Phase, Doing] = {
    Phase.LAUNCHING: "launch",
    Phase.FLYING: "mission",
    Phase.LANDING: "goal",
    Phase.HOLDING: "hold",
}
_WAITS = ": it holds until its way home is clear of the others'"
_SAID = {Kind.HOLD: "it holds", Kind.RETURN: "it returns", Kind.LAND: "it lands where it is"}


def ruled(state: AgentState, now: float) -> Step:
    """Judge every rule by what is known now, and follow the strongest demand that was not made before.

    What is demanded on and on is followed once: an operator who orders otherwise afterwards is obeyed.
    """
    if state.ended:
        return state, []
    before = state.demands or (None,) * len(state.task.rules)
    memories, demands = failsafes.judge(state.task.rules, state.memories, facts_of(state), now)
    state = replace(state, memories=memories, demands=demands)
    arisen = tuple(
        demand if demand is not None and _is_new(state, was, demand) else None
        for was, demand in zip(before, demands, strict=True)
    )
    strongest = failsafes.strongest(arisen)
    if strongest is not None and strongest.kind is Kind.LET_GO:
        return let_go(state, strongest.why)
    effects: list[ev.Effect] = [
        ev.Tell(f"{ruling.rule.NAME.replace('_', ' ')} is over")
        for ruling, was, demand in zip(state.task.rules, before, demands, strict=True)
        if was is not None and was.kind is Kind.WARN and demand is None
    ]
    followed = _follow(state, strongest) if strongest is not None and _changes(state, strongest) else None
    for demand in arisen:
        if demand is not None:
            does = "" if followed is None else _says(followed[0], demand)
            effects.append(ev.Tell(demand.why + (does if demand is strongest else "")))
    if followed is None:
        return state, effects
    state, ordered = followed
    return state, [*effects, *ordered]


def _is_new(state: AgentState, was: Action | None, demand: Action) -> bool:
    """Also where it has waited for its turn, and may not any longer."""
    presses = was is not None and demand.urgent and not was.urgent and state.turn_boot_s is not None
    return was is None or was.kind is not demand.kind or presses


def _says(after: AgentState, demand: Action) -> str:
    return _WAITS if after.turn_is_own else f": {_SAID[demand.kind]}"


def facts_of(state: AgentState) -> Facts:
    return Facts(
        vehicle=state.vehicle,
        frame=state.task.grid.frame,
        doing=_doing(state),
        ours=roles_of_ours(state),
        orders=state.orders_given,
        lost=state.lost,
        way=_way(state),
        fence=state.task.fence,
        turn_radius_m=0.0 if state.task.wings is None else state.task.turn_radius_m,
    )


def _doing(state: AgentState) -> Doing:
    if state.phase is Phase.LEAVING:
        return "return" if state.ordered is ev.Order.RETURN else "land"
    return _DOING.get(state.phase, "ground")


def _way(state: AgentState) -> Way | None:
    swap = state.route
    if state.phase is not Phase.FLYING or swap is None or state.pending is not None:
        return None
    points = (*swap.plan.way, swap.plan.landing)
    return Way(swap.plan_id, tuple((point.lat_deg, point.lon_deg) for point in points))


def _changes(state: AgentState, demand: Action) -> bool:
    """Whether it is stronger than what the vehicle does already."""
    does = failsafes.CALMEST.get(_doing(state))
    return does is not None and failsafes.STRENGTH[demand.kind] > failsafes.STRENGTH[does]


def _follow(state: AgentState, demand: Action) -> Step:
    order = ev.Order(demand.kind.value)
    down = order is not ev.Order.HOLD
    changes: dict[str, Any] = {
        "dirty": False,
        "gave_way": None,
        # Whom no operator has called back has failed, however well it lands.
        "given_up": state.given_up or down,
        "outcome": demand.why,
        "trouble": demand.why,
    }
    if order is ev.Order.RETURN and not demand.urgent:
        until_s = state.vehicle.time_boot_s + WAITS_FOR_S
        if (waits := return_in_turn(state, until_s, **changes)) is not None:
            return waits
        changes |= begun(state, until_s)
    else:
        changes |= NO_TURN
    return command(state, order, phase=Phase.LEAVING if down else Phase.HOLDING, **changes)
