"""What the rules of flight demand of an agent, and how it follows."""

from __future__ import annotations

from dataclasses import replace

from swarmctl import rules
from swarmctl.agent.orders import Step, command, let_go
from swarmctl.agent.ours import roles_of_ours
from swarmctl.agent.state import AgentState, Phase
from swarmctl.core import events as ev
from swarmctl.rules import Action, Doing, Facts, Kind, Way

_DOING: dict[Phase, Doing] = {
    Phase.LAUNCHING: "launch",
    Phase.FLYING: "mission",
    Phase.LANDING: "goal",
    Phase.HOLDING: "hold",
}
_SAID = {Kind.HOLD: "it holds", Kind.RETURN: "it returns", Kind.LAND: "it lands where it is"}


def ruled(state: AgentState, now: float) -> Step:
    """Judge every rule by what is known now, and follow the strongest demand that was not made before.

    What is demanded on and on is followed once: an operator who orders otherwise afterwards is obeyed.
    """
    if state.ended:
        return state, []
    before = state.demands or (None,) * len(state.task.rules)
    memories, demands = rules.judge(state.task.rules, state.memories, facts_of(state), now)
    state = replace(state, memories=memories, demands=demands)
    arisen = tuple(
        demand if demand is not None and (was is None or was.kind is not demand.kind) else None
        for was, demand in zip(before, demands, strict=True)
    )
    strongest = rules.strongest(arisen)
    if strongest is not None and strongest.kind is Kind.LET_GO:
        return let_go(state, strongest.why)
    effects: list[ev.Effect] = [
        ev.Tell(f"{ruling.rule.NAME.replace('_', ' ')} is over")
        for ruling, was, demand in zip(state.task.rules, before, demands, strict=True)
        if was is not None and was.kind is Kind.WARN and demand is None
    ]
    follow = strongest is not None and _changes(state, strongest)
    for demand in arisen:
        if demand is not None:
            done = f": {_SAID[demand.kind]}" if follow and demand is strongest else ""
            effects.append(ev.Tell(demand.why + done))
    if strongest is None or not follow:
        return state, effects
    state, ordered = _follow(state, strongest)
    return state, [*effects, *ordered]


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
    does = rules.CALMEST.get(_doing(state))
    return does is not None and rules.STRENGTH[demand.kind] > rules.STRENGTH[does]


def _follow(state: AgentState, demand: Action) -> Step:
    order = ev.Order(demand.kind.value)
    down = order is not ev.Order.HOLD
    return command(
        state,
        order,
        phase=Phase.LEAVING if down else Phase.HOLDING,
        dirty=False,
        turn_boot_s=None,
        gave_way=None,
        # Whom no operator has called back has failed, however well it lands.
        given_up=state.given_up or down,
        outcome=demand.why,
        trouble=demand.why,
    )
