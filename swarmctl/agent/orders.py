"""Orders of an operator or of the agent's own process, and the answers to the operator. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from swarmctl.agent.commands import StepResult, command
from swarmctl.agent.failsafes.base import DemandKind, urgent_reason
from swarmctl.agent.formation.membership import Membership
from swarmctl.agent.own_modes import ROLE_OF_ORDER
from swarmctl.agent.phases import ON_GROUND, PAST_PLANNING, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.launching import launch_if_possible, watch_first_route
from swarmctl.agent.traffic.returning import (
    follows_order,
    hold_and_wait,
    holds_by_order,
    holds_first,
    position_for_return,
)
from swarmctl.agent.traffic.wait import RULES, Wait, WaitFor, begin_wait
from swarmctl.core import events as ev
from swarmctl.core.messages import CommandOutcome, VehicleAnswer
from swarmctl.core.records import replace

_WAIT_OF_ORDER = {ev.FlightOrder.RETURN: WaitFor.RETURN_PATH, ev.FlightOrder.LAND: WaitFor.GROUND}
REPEAT_WHEN_RECENT = "telemetry is old; repeat the order when telemetry is recent"
TOUCHING_DOWN_M = 2.0
"""Height above home [m] below which a descending vehicle touches down before it follows another order."""


_Decision = tuple[CommandOutcome, str, StepResult]
"""the outcome and the note of an answer, and the state and effects of the order"""


def handle_operator_command(state: AgentState, event: ev.OperatorCommand, _now: float) -> StepResult:
    """Follow an order; an operator's order is also answered."""
    place = position_for_return(state)
    outcome, note, (state, effects) = _decide(state, event)
    state, begun = launch_if_possible(state)
    state, conflict = watch_first_route(state)
    waits = state.phase is Phase.STANDBY and state.is_waiting
    if event.order is ev.FlightOrder.LAUNCH and outcome == "taken" and waits:
        note = state.trouble
    effects = [*begun, *conflict, *effects]
    if event.request_id is not None:
        answer = VehicleAnswer(state.task.uav, state.task.name, outcome, note=note, place=place)
        effects = [*effects, ev.Answer(event.request_id, answer)]
    return state, effects


def _decide(state: AgentState, event: ev.OperatorCommand) -> _Decision:
    order, remote = event.order, event.request_id is not None
    unchanged: StepResult = state, []
    if state.phase is Phase.RELEASED and state.vehicle.armed and remote and order in ROLE_OF_ORDER:
        note = "another operator controls the vehicle; the order is sent once [sent-once]"
        return "taken", note, command(state, order, by_person=True)
    if state.ended:
        outcome = f", {state.outcome}" if state.outcome else ""
        return "over", f"the flight is over: {state.phase}{outcome}", unchanged
    if state.launch.is_aborted:
        return "refused", "the launch is being aborted; the vehicle lands [launch-aborted]", unchanged
    if order is ev.FlightOrder.LAUNCH:
        return _decide_launch(state, event)
    if order is ev.FlightOrder.RESUME:
        why = _reason_against_resuming(state)
        return ("refused", why, unchanged) if why else ("taken", "", _resume(state))
    if state.phase in ON_GROUND:
        note = "the vehicle stays on the ground until an order to launch [stays-on-ground]"
        return "taken", note, _stay_on_ground(state, event)
    if state.phase is Phase.LAUNCHING:
        return "taken", "the vehicle aborts its launch and lands [launch-aborted]", _abort_launch(state)
    if follows_order(state, order):
        return "taken", "the vehicle already follows this order [already-done]", unchanged
    # A recall must not stop a landing that a failsafe demands.
    is_recall = order is ev.FlightOrder.RETURN and (bool(event.after_s) or not remote)
    reason = urgent_reason(state.demands, DemandKind.LAND)
    if is_recall and reason and state.order.given is ev.FlightOrder.LAND:
        return "refused", f"a failsafe lands the vehicle: {reason} [failsafe-landing]", unchanged
    return "taken", "; ".join(_notes(state, event)), _follow_in_flight(state, event)


def _notes(state: AgentState, event: ev.OperatorCommand) -> Iterator[str]:
    """Yield what an operator should know of an order to a vehicle in flight."""
    order = event.order
    if state.lost:
        yield "the link is lost; the order is sent now, and repeated after the loss [waits-for-link]"
    if order is ev.FlightOrder.HOLD and state.waits_for(WaitFor.RETURN_PATH):
        # A failsafe demands the return only once.
        yield f"the order cancels the return that a failsafe demanded: {state.outcome} [return-cancelled]"
    if event.after_s and (reason := urgent_reason(state.demands)):
        yield f"the vehicle returns at once: {reason} [urgent-return]"
    elif event.after_s:
        yield f"the vehicle first holds for {event.after_s:g} s, while other vehicles return [return-queue]"
    elif _may_wait(state, event) and holds_first(state, order):
        longest_s = RULES[_WAIT_OF_ORDER[order]].longest_s
        yield (
            f"the vehicle holds until its way is clear of other vehicles, {longest_s:g} s at most; repeat "
            "the order, and the vehicle follows it at once [holds-first]"
        )


def _decide_launch(state: AgentState, event: ev.OperatorCommand) -> _Decision:
    remote, ignored = event.request_id is not None, frozenset(event.ignore)
    unchanged: StepResult = state, []
    if state.phase in (Phase.HOLDING, Phase.LEAVING):
        advice = "order the vehicle to hold, then to resume"
        note = f"the vehicle is in flight: {state.outcome or state.phase}; {advice} [not-resumed]"
        return "refused", note, unchanged
    if state.phase is Phase.LAUNCHING:
        launch = replace(state.launch, ignored=state.launch.ignored | ignored)
        return "taken", "the vehicle is about to take off [launching]", (replace(state, launch=launch), [])
    if state.phase not in ON_GROUND:
        return "taken", "the vehicle has launched already [launched-already]", unchanged
    if not remote and state.order.given in ROLE_OF_ORDER:
        return "refused", "an operator keeps the vehicle on the ground", unchanged
    # The own process orders a launch before the vehicle is ready. An operator's order must not launch the
    # vehicle later, after the operator has stopped watching it.
    if remote and (why := _reason_against_launching(state)):
        return "refused", why, unchanged
    is_uploading = state.plans.pending is not None
    note = "the vehicle launches after its new plan is uploaded [after-upload]" if is_uploading else ""
    launch = replace(state.launch, is_ordered=True, is_operators=remote, ignored=ignored)
    return "taken", note, (replace(state, launch=launch), [])


def _reason_against_launching(state: AgentState) -> str:
    """Return the reason why a vehicle on the ground cannot launch now; "" if it can."""
    if state.lost:
        return "the link is lost; repeat the order when the link is back [launch-without-link]"
    if state.telemetry_is_late:
        return f"{REPEAT_WHEN_RECENT} [telemetry-old]"
    if state.phase is not Phase.STANDBY:
        return f"the vehicle is not ready yet: {state.trouble or state.phase} [not-ready]"
    return ""


def _reason_against_resuming(state: AgentState) -> str:
    """Return the reason why the vehicle cannot end a hold with a new plan; "" if it can."""
    if state.phase in ON_GROUND:
        return "the vehicle is on the ground; order a launch [not-resumed]"
    if state.phase is not Phase.HOLDING:
        return f"the vehicle does not hold: {state.outcome or state.phase} [not-resumed]"
    if state.lost:
        return "the link is lost; repeat the order when the link is back [not-resumed]"
    if state.telemetry_is_late:
        return f"{REPEAT_WHEN_RECENT} [not-resumed]"
    if state.is_waiting:
        return "the vehicle holds until its return; order it to hold first [not-resumed]"
    if not state.order.is_followed or state.vehicle.mode_role != "hold":
        return f"the hold is not confirmed, in mode {state.vehicle.mode or 'unknown'} [not-resumed]"
    demands = (d.reason for d in state.demands if d is not None and d.kind is not DemandKind.WARN)
    reason = next(demands, "")
    return f"a failsafe rule demands the end of the route: {reason} [not-resumed]" if reason else ""


def _resume(state: AgentState) -> StepResult:
    """Plan from the hold, as if no change had failed before. A vehicle over its goal lands."""
    state = replace(state, outcome="", trouble="", wait=None, given_up=False, plans=state.plans.afresh())
    if state.cell in state.task.goals:
        boot_s = state.vehicle.time_boot_s
        return command(state, ev.FlightOrder.LAND, by_person=True, phase=Phase.LANDING, arrived_boot_s=boot_s)
    return state.enter(
        Phase.FLYING,
        order=state.order.noted(ev.FlightOrder.LAUNCH),
        plans=state.plans.without_mission().resumed(),
    ), []


def _stay_on_ground(state: AgentState, event: ev.OperatorCommand) -> StepResult:
    """Withdraw the launch by an operator's order; the own process ends the flight."""
    if event.request_id is None:
        return state.enter(Phase.DONE, outcome="not launched", plans=state.plans.without_upload()), []
    launch, order = state.launch.withdrawn(), state.order.noted(event.order)
    return replace(state, launch=launch, order=order, wait=None), []


def _abort_launch(state: AgentState) -> StepResult:
    """Land: the vehicle is armed or will be soon, on the ground or just above it."""
    aborted = {"launch": replace(state.launch, is_aborted=True), "outcome": "launch aborted"}
    return command(state, ev.FlightOrder.LAND, by_person=True, phase=Phase.LEAVING, **aborted)


def _follow_in_flight(state: AgentState, event: ev.OperatorCommand) -> StepResult:
    """Hold, return or land; first hold if the order has a start time, or if the way is not clear."""
    order, now_s = event.order, state.vehicle.time_boot_s
    changes: dict[str, Any] = {"plans": state.plans.not_due()}
    if (state.vehicle.alt_rel_m or 0.0) > TOUCHING_DOWN_M:
        changes["arrived_boot_s"] = None  # the vehicle is over its goal, but does not land there
    changes["outcome"] = f"{order} ordered"
    if order not in _WAIT_OF_ORDER:
        return command(state, order, by_person=True, phase=Phase.HOLDING, wait=None, **changes)
    purpose = _WAIT_OF_ORDER[order]
    if event.after_s and not urgent_reason(state.demands):  # other returns are scheduled around an urgent one
        wait = begin_wait(WaitFor.TURN, now_s, until_s=now_s + event.after_s)
    elif _may_wait(state, event) and (holds_first(state, order) or _is_of_shutdown(state, event)):
        wait = begin_wait(purpose, now_s)
    else:
        waited = _wait_for(state, order)
        ended = begin_wait(purpose, now_s).ended(now_s) if waited is None else waited.over(now_s)
        return command(state, order, by_person=True, phase=Phase.LEAVING, wait=ended, **changes)
    return hold_and_wait(state, wait, by_person=True, **changes)


def _is_of_shutdown(state: AgentState, event: ev.OperatorCommand) -> bool:
    """Return whether an order comes from a shutdown: all vehicles hold, and tell first that they wait."""
    return event.request_id is None and holds_by_order(state) and state.order.is_followed


def _may_wait(state: AgentState, event: ev.OperatorCommand) -> bool:
    """Return whether an order may wait for other vehicles; a repeated order and an urgent return do not."""
    if event.order not in _WAIT_OF_ORDER or event.after_s is not None or urgent_reason(state.demands):
        return False
    return not (state.lost or state.telemetry_is_late) and _wait_for(state, event.order) is None


def _wait_for(state: AgentState, order: ev.FlightOrder) -> Wait | None:
    """Return the wait that goes on before this order; a repeated order ends it."""
    wait = state.wait if state.is_waiting else None
    return wait if wait is not None and wait.purpose in (_WAIT_OF_ORDER[order], WaitFor.TURN) else None


def weights_changed(state: AgentState, event: ev.WeightsChanged, _now: float) -> StepResult:
    """Use new weights (the paper's sliders) from the next plan on; an upload in progress continues.

    A new range of communication counts at once, in every phase.
    """
    effects: list[ev.Effect] = [] if event.range is None else [ev.SetRange(event.range)]
    if why := _reason_against_behaviours(state, event):
        refused = VehicleAnswer(state.task.uav, state.task.name, "refused", note=why)
        return state, [ev.Answer(event.request_id, refused)]
    plans_anew = event.w is not None or event.strength is not None
    if state.phase in PAST_PLANNING and plans_anew:
        why = f"the vehicle does not plan routes in this phase: {state.phase}"
        why += (f", {state.outcome}" if state.outcome else "") + " [no-plan]"
        why += "" if event.range is None else f"; range of communication {event.range} from now on"
        over = VehicleAnswer(state.task.uav, state.task.name, "over", note=why)
        return state, [*effects, ev.Answer(event.request_id, over)]
    method = state.task.method
    if event.w is not None and not method.planner.USES_W:
        why = f"planner {method.name} does not use w; give firing strengths alone [w-unused]"
        refused = VehicleAnswer(state.task.uav, state.task.name, "refused", note=why)
        return state, [ev.Answer(event.request_id, refused)]
    w = state.w if event.w is None else event.w
    strength = state.strength if event.strength is None else event.strength
    changed = (w, strength) != (state.w, state.strength)
    plans = state.plans.due() if changed else state.plans
    state = replace(state, w=w, strength=strength, plans=plans, membership=_with_behaviours(state, event))
    note = "the link is lost; the vehicle plans when the link is back [waits-for-link]" if state.lost else ""
    if event.behaviours and state.membership.leader not in (None, state.task.uav):
        leader = state.task.name_of(state.membership.leader)
        note = f"{leader} leads the group, and its weights count [leader-decides]"
    if not changed and event.range is None and not event.behaviours:
        note = "the vehicle already has these weights and keeps its plan [unchanged]"
    taken = VehicleAnswer(state.task.uav, state.task.name, "taken", state.plans.next_plan_id, note)
    return state, [*effects, ev.Answer(event.request_id, taken)]


def _reason_against_behaviours(state: AgentState, event: ev.WeightsChanged) -> str:
    """Return the reason why weights of behaviours cannot be changed; "" if they can, or if none change."""
    if not event.behaviours:
        return ""
    formation = state.task.formation
    names = () if formation is None else formation.approach.WEIGHTS
    unknown = [name for name in event.behaviours if name not in names]
    if not names:
        return "the vehicle is in no group whose approach has weights of behaviours [no-behaviours]"
    if unknown:
        return f"unknown behaviours {', '.join(unknown)}: expected {', '.join(names)} [no-behaviours]"
    return ""


def _with_behaviours(state: AgentState, event: ev.WeightsChanged) -> Membership:
    formation, membership = state.task.formation, state.membership
    if formation is None or not event.behaviours:
        return membership
    return replace(membership, weights=formation.weights_with(membership.weights, event.behaviours))
