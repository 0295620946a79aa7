"""Enforcement of the failsafe rules' demands. Pure.

Messages to the operator end in the rule's code, such as `[low-battery]`.
"""

from __future__ import annotations

from typing import Any

from swarmctl.agent import failsafes
from swarmctl.agent.commands import StepResult, command, release_vehicle
from swarmctl.agent.failsafes.base import (
    ACTIVITY_AS_DEMAND,
    STRENGTH,
    ActiveRule,
    Demand,
    DemandKind,
    FailsafeFacts,
    FlightActivity,
)
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.returning import start_return, wait_to_return
from swarmctl.agent.traffic.wait import WaitFor
from swarmctl.core import events as ev
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace

_ACTIVITY_OF_PHASE: dict[Phase, FlightActivity] = {
    Phase.LAUNCHING: "launch",
    Phase.FLYING: "mission",
    Phase.FORMATION: "mission",
    Phase.LANDING: "goal",
    Phase.HOLDING: "hold",
}
_WAITS = "holds until its return path is clear"
_REACTIONS = {
    DemandKind.HOLD: "holds",
    DemandKind.RETURN: "returns",
    DemandKind.LAND: "lands where it is",
}


def apply_failsafes(state: AgentState, now: float) -> StepResult:
    """Evaluate all rules, and follow the strongest new demand if the vehicle does not fulfil it already.

    A lasting demand is followed only once, so that an operator can give another order afterwards.
    """
    if state.ended:
        return state, []
    before = state.demands or (None,) * len(state.task.rules)
    memories, demands = failsafes.evaluate(state.task.rules, state.memories, failsafe_facts(state), now)
    state = replace(state, memories=memories, demands=demands)
    if not any(demands) and not any(before):
        return state, []
    new_demands = tuple(
        demand if demand is not None and (previous is None or previous.kind is not demand.kind) else None
        for previous, demand in zip(before, demands, strict=True)
    )
    strongest = failsafes.strongest(new_demands)
    if strongest is not None and strongest.kind is DemandKind.RELEASE:
        return release_vehicle(state, strongest.reason)
    effects: list[ev.Effect] = [
        ev.NotifyOperator(f"{active.rule.NAME.replace('_', ' ')}: the warning is over {_code(active)}")
        for active, previous, demand in zip(state.task.rules, before, demands, strict=True)
        if previous is not None and previous.kind is DemandKind.WARN and demand is None
    ]
    followed = None
    if strongest is not None and _exceeds_activity(state, strongest):
        followed = _order_for(state, strongest)
    for active, demand in zip(state.task.rules, new_demands, strict=True):
        if demand is not None:
            reaction = _reaction(state, followed, demand) if demand is strongest else ""
            effects.append(ev.NotifyOperator(f"{demand.reason}{reaction} {_code(active)}"))
    if followed is None:
        return state, effects
    state, ordered = followed
    return state, [*effects, *ordered]


def _reaction(state: AgentState, followed: StepResult | None, demand: Demand) -> str:
    if followed is not None:
        waits = followed[0].waits_for(WaitFor.RETURN_PATH)
        return f"; the vehicle {_WAITS if waits else _REACTIONS[demand.kind]}"
    if demand.kind is DemandKind.WARN:
        return ""
    does = "returns" if _activity(state) == "return" else "lands"
    return f"; the vehicle already {does} (mode {state.vehicle.mode}), so no new order is sent"


def _code(active: ActiveRule) -> str:
    return f"[{active.rule.NAME.replace('_', '-')}]"


def failsafe_facts(state: AgentState) -> FailsafeFacts:
    return FailsafeFacts(
        vehicle=state.vehicle,
        frame=state.task.grid.frame,
        activity=_activity(state),
        own_roles=own_mode_roles(state),
        orders_given=state.order.n_given,
        lost=state.lost,
        telemetry_is_late=state.telemetry_is_late,
        mission=_active_mission(state),
        fence=state.task.fence,
        turn_radius_m=0.0 if state.task.wings is None else state.task.turn_radius_m,
    )


def _activity(state: AgentState) -> FlightActivity:
    if state.phase is Phase.LEAVING:
        return "return" if state.order.given is ev.FlightOrder.RETURN else "land"
    return _ACTIVITY_OF_PHASE.get(state.phase, "ground")


def _active_mission(state: AgentState) -> PlannedMission | None:
    is_flown = state.phase is Phase.FLYING and state.plans.pending is None
    return state.plans.mission if is_flown else None


def _exceeds_activity(state: AgentState, demand: Demand) -> bool:
    fulfilled = ACTIVITY_AS_DEMAND.get(_activity(state))
    return fulfilled is not None and STRENGTH[demand.kind] > STRENGTH[fulfilled]


def _order_for(state: AgentState, demand: Demand) -> StepResult:
    order = ev.FlightOrder(demand.kind.value)
    is_leaving = order is not ev.FlightOrder.HOLD
    changes: dict[str, Any] = {
        "plans": state.plans.not_due(),
        # A return or landing without an operator's order counts as a failed flight.
        "given_up": state.given_up or is_leaving,
        "outcome": demand.reason,
        "trouble": demand.reason,
    }
    if order is ev.FlightOrder.RETURN:
        if (waiting := wait_to_return(state, **changes)) is not None:
            return waiting
        return start_return(state, may_hold_again=not demand.urgent, **changes)
    phase = Phase.LEAVING if is_leaving else Phase.HOLDING
    return command(state, order, phase=phase, wait=None, **changes)
