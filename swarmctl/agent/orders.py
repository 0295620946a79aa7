"""What an operator or its own process tells a vehicle to do, and what an operator is answered."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec

from swarmctl.agent.failsafes.base import Kind
from swarmctl.agent.own_modes import ROLES, roles_of_ours
from swarmctl.agent.state import IN_FLIGHT, ON_GROUND, PLANS_NO_MORE, AgentState, Phase, Task
from swarmctl.core import events as ev
from swarmctl.core.messages import Outcome, Place, VehicleAnswer

Step = tuple[AgentState, list[ev.Effect]]
ALL_BUT_DOWN_M = 2.0
"""above home: it touches down before it follows another order"""


def operator(state: AgentState, event: ev.OperatorCommand, _now: float) -> Step:
    """An order of an operator, who is answered, or of this process, which is not."""
    remote = event.command is not None
    outcome, note = _order_answer(state, event)
    effects: list[ev.Effect] = []
    place = place_of(state)
    if (outcome == "taken" or not remote) and not _is_let_land(state, event):
        if event.after_s and presses(state):
            event = msgspec.structs.replace(event, after_s=0.0)  # the others take their turns around it
        state, effects = _ordered(state, event, remote=remote)
    if event.command is not None:
        answer = VehicleAnswer(state.task.uav, state.task.name, outcome, note=note, place=place)
        effects = [*effects, ev.Answer(event.command, answer)]
    return state, effects


def place_of(state: AgentState) -> Place | None:
    """Where it flies, and what its return needs to know; None where that is not known, or not in flight."""
    v = state.vehicle
    if state.phase not in IN_FLIGHT or v.lat_deg is None or v.lon_deg is None or v.alt_amsl_m is None:
        return None
    if v.home_lat_deg is None or v.home_lon_deg is None or v.home_alt_amsl_m is None:
        return None
    limits = state.task.separation.limits
    return Place(
        v.lat_deg,
        v.lon_deg,
        v.alt_amsl_m,
        v.home_lat_deg,
        v.home_lon_deg,
        v.home_alt_amsl_m,
        speed_m_s=state.task.arrival.speed_m_s,
        # Who circles to hold is anywhere on its circle.
        keeps_m=(limits.horizontal_m + 2.0 * circles_m(state.task), limits.vertical_m),
        # Whoever calls it back: it is on its way for that, or holds as it was told.
        is_returning=_follows(state, ev.Order.RETURN)
        or (bool(presses(state)) and state.ordered is not ev.Order.LAND),
    )


def circles_m(task: Task) -> float:
    """The radius of the circles in which it holds; 0 for what hovers."""
    return 0.0 if task.wings is None else task.wings.loiter_radius_m


def _follows(state: AgentState, order: ev.Order) -> bool:
    """It was given this order in flight, and does so until it is told otherwise."""
    for_a_while = state.turn_boot_s is not None or state.gave_way is not None
    return state.phase in IN_FLIGHT and state.ordered is order and state.order_seen and not for_a_while


def presses(state: AgentState) -> str:
    """Why a rule demands a return that waits for nobody; empty where none does."""
    return _demanded(state, Kind.RETURN)


def _demanded(state: AgentState, kind: Kind) -> str:
    urgent = (d.why for d in state.demands if d is not None and d.kind is kind and d.urgent)
    return next(urgent, "")


def _is_let_land(state: AgentState, event: ev.OperatorCommand) -> bool:
    """It comes down because a rule demands that, and is not stopped to be sent home with the others."""
    called_back = event.order is ev.Order.RETURN and (event.after_s > 0.0 or event.command is None)
    return called_back and state.ordered is ev.Order.LAND and bool(_demanded(state, Kind.LAND))


def _is_theirs(state: AgentState) -> bool:
    """It was let go in flight, and may be in the air still."""
    return state.phase is Phase.RELEASED and state.vehicle.armed


def _order_answer(state: AgentState, event: ev.OperatorCommand) -> tuple[Outcome, str]:
    """What an operator is answered, and why."""
    order = event.order
    if _is_theirs(state) and event.command is not None and order is not ev.Order.LAUNCH:
        return "taken", "somebody else flies it; it is told so once, and let go again"
    if state.ended:
        return "over", f"its flight is over: {state.phase}" + (f", {state.outcome}" if state.outcome else "")
    if state.launch_aborted:
        return "refused", "its launch is being broken off: it lands"
    if order is ev.Order.LAUNCH:
        return _launch_answer(state)
    if state.phase in ON_GROUND:
        return "taken", "it stays on the ground until it is ordered to launch"
    if state.phase is Phase.LAUNCHING:
        return "taken", "its launch is broken off: it lands"
    if _follows(state, order):
        return "taken", "it does so already"
    if _is_let_land(state, event):
        return "refused", f"it lands: {_demanded(state, Kind.LAND)}"
    notes = ["its link is lost; it is told when it is heard again"] if state.lost else []
    if order is ev.Order.HOLD and state.turn_is_own:  # by a rule, which demands it once
        notes += [f"it returns no more, for which it waited: {state.outcome}"]
    if event.after_s and presses(state):
        notes.append(f"it waits for no turn: {presses(state)}")
    elif event.after_s:
        notes.append(f"it holds for {event.after_s:g} s first, for others to return")
    return "taken", "; ".join(notes)


def _launch_answer(state: AgentState) -> tuple[Outcome, str]:
    if state.phase in (Phase.HOLDING, Phase.LEAVING):
        return "refused", f"{state.outcome or state.phase}: it does not take up its route again"
    if state.phase is Phase.LAUNCHING:
        return "taken", "it is about to take off"
    if state.phase not in ON_GROUND:
        return "taken", "it has launched already"
    # An aircraft must not arm at some later time, when whoever ordered it has turned away.
    if state.lost:
        return "refused", "its link is lost"
    if state.phase is not Phase.STANDBY:
        return "refused", f"it is not ready yet: {state.trouble or state.phase}"
    return "taken", "" if state.pending is None else "as soon as its new plan is on it"


def _ordered(state: AgentState, event: ev.OperatorCommand, *, remote: bool) -> Step:
    order = event.order
    if _is_theirs(state) and remote and order is not ev.Order.LAUNCH:
        return command(state, order, by_person=True)
    if state.ended or state.launch_aborted or _follows(state, order):
        return state, []
    if order is ev.Order.LAUNCH:
        if state.phase is Phase.LAUNCHING and event.past:
            return replace(state, launch_past=state.launch_past | frozenset(event.past)), []
        if state.phase not in ON_GROUND or (state.ordered in ROLES and not remote):
            return state, []  # it has launched, or an operator keeps it on the ground
        past = frozenset(event.past)
        return replace(state, launch_ordered=True, launch_is_operators=remote, launch_past=past), []
    if state.phase in ON_GROUND and remote:
        return replace(
            state, launch_ordered=False, launch_waits_boot_s=None, ordered=order, order_seen=True
        ), []
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.DONE, outcome="not launched", pending=None), []
    if state.phase is Phase.LAUNCHING:
        # On the ground or just above it, armed or about to be: the way out of both is down.
        changes: dict[str, Any] = {"launch_aborted": True, "outcome": "launch broken off"}
        return command(state, ev.Order.LAND, by_person=True, phase=Phase.LEAVING, **changes)
    changes = {"dirty": False, "turn_boot_s": None, "turn_is_own": False, "gave_way": None}
    if (state.vehicle.alt_rel_m or 0.0) > ALL_BUT_DOWN_M:
        changes["arrived_boot_s"] = None  # it is over its goal, and does not come down there
    changes |= {"outcome": f"{order} ordered", "returns_since_s": None}
    if not event.after_s:
        phase = Phase.HOLDING if order is ev.Order.HOLD else Phase.LEAVING
        return command(state, order, by_person=True, **(changes | {"phase": phase}))
    # It returns in its turn, and holds until then.
    changes |= {"phase": Phase.HOLDING, "turn_boot_s": state.vehicle.time_boot_s + event.after_s}
    if state.phase is Phase.HOLDING and state.ordered is ev.Order.HOLD:
        return replace(state, **changes), []
    return command(state, ev.Order.HOLD, by_person=True, **changes)


def weights_changed(state: AgentState, event: ev.WeightsChanged, _now: float) -> Step:
    """The paper's sliders. A plan under way is not called back: the next one has the new weights."""
    if state.phase in PLANS_NO_MORE:
        why = f"it plans no more: {state.phase}" + (f", {state.outcome}" if state.outcome else "")
        over = VehicleAnswer(state.task.uav, state.task.name, "over", note=why)
        return state, [ev.Answer(event.command, over)]
    method = state.task.method
    if event.w is not None and not method.planner.USES_W:
        why = f"its planner, {method.name}, does not go by w; give firing strengths alone"
        refused = VehicleAnswer(state.task.uav, state.task.name, "refused", note=why)
        return state, [ev.Answer(event.command, refused)]
    w = state.w if event.w is None else event.w
    strength = state.strength if event.strength is None else event.strength
    changed = (w, strength) != (state.w, state.strength)
    state = replace(state, w=w, strength=strength, dirty=state.dirty or changed)
    note = "its link is lost; it plans when it is heard again" if state.lost else ""
    if not changed:
        note = "it has these already, and does not plan again for them"
    taken = VehicleAnswer(state.task.uav, state.task.name, "taken", state.next_plan_id, note)
    return state, [ev.Answer(event.command, taken)]


def command(state: AgentState, order: ev.Order, *, by_person: bool = False, **changes: Any) -> Step:
    """Give an order, which ends a swap that is under way; `changes` go with it.

    `by_person`: one has ordered it just now, and it goes out whatever the vehicle does.
    """
    before = roles_of_ours(state)
    state = replace(state, **{"pending": None, **changes})
    state = replace(
        state,
        ours_before=before,
        ordered=order,
        order_seen=False,
        order_again_at_s=math.inf,
        orders_given=state.orders_given + 1,
    )
    return state, [ev.Command(order, by_person)]


def let_go(state: AgentState, why: str) -> Step:
    """Somebody else has the vehicle."""
    return replace(state, phase=Phase.RELEASED, pending=None, dirty=False, outcome=f"{why}; let go"), [
        ev.Release()
    ]
