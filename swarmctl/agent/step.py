"""The agent's event handlers, one for each kind of event, and the condition for a new decision."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from swarmctl.agent.arrival.simultaneous import adjust_speed, speed_failed
from swarmctl.agent.commands import RETRY_AFTER_S, StepResult, command, release_vehicle
from swarmctl.agent.failsafes.enforcement import apply_failsafes
from swarmctl.agent.formation.flight import fly_in_formation, not_following, note_following
from swarmctl.agent.formation.member_messages import tell_group
from swarmctl.agent.formation.near_members import with_members_hidden
from swarmctl.agent.formation.presence import note_group, receive_messages
from swarmctl.agent.orders import handle_operator_command, weights_changed
from swarmctl.agent.own_modes import ROLE_OF_ORDER
from swarmctl.agent.phases import IN_FLIGHT, ON_GROUND, Phase
from swarmctl.agent.replan.mission_changes import (
    mission_accepted,
    mission_failed,
    plan_if_due,
)
from swarmctl.agent.restart import restart
from swarmctl.agent.sharing import learn_from_others, learn_from_sensor, share_state
from swarmctl.agent.state import AgentState
from swarmctl.agent.touchdown import end_at_touchdown, has_touched_down, may_be_armed, note_disarming
from swarmctl.agent.traffic.alarms import raise_alarms
from swarmctl.agent.traffic.intents import share_intent
from swarmctl.agent.traffic.landing_queue import arrive, queue_for_landing
from swarmctl.agent.traffic.last_resort import stop_in_time
from swarmctl.agent.traffic.launching import (
    cancel_launch,
    launch_if_possible,
    note_takeoff,
    postpone_launch,
    watch_first_route,
)
from swarmctl.agent.traffic.neighbours import receive_neighbours
from swarmctl.agent.traffic.received_intents import receive_intents, with_reported_holds
from swarmctl.agent.traffic.returning import update_return
from swarmctl.agent.traffic.route_deconfliction import check_own_route
from swarmctl.agent.traffic.route_hold import resume_if_clear
from swarmctl.core import events as ev
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.vehicle import MAX_DELAY_S, RECENT_DELAY_S, VehicleState


def step(state: AgentState, event: ev.Event, now: float) -> StepResult:
    """Return the agent's next state and the effects of an event at `now`, by the run's clock [s]."""
    after, effects = _HANDLERS[type(event)](state, event, now)
    if after.ended and after.phase is not state.phase:
        # The end is told at once: the process may stop soon, and a disarmed vehicle tells nothing more.
        after, shared = share_state(replace(after, sent=after.sent.state_due()))
        effects = [*effects, *shared]
    if after.sent.intent_boot_s == -math.inf:  # of a new flight, whatever event began it
        after, announced = share_intent(after)
        effects = [*effects, *announced]
    return after, effects


# --- the ground, the launch, and orders


def _ready(state: AgentState, _event: ev.Ready, _now: float) -> StepResult:
    if state.phase is not Phase.WAITING:
        return state, []
    return state.enter(Phase.UPLOADING, plans=state.plans.due()), []


def _rebooted(state: AgentState, _event: ev.Rebooted, _now: float) -> StepResult:
    if state.ended:
        return state, []
    if state.phase not in ON_GROUND:
        # Its mode, mission and position estimate began anew, so nothing that this agent knows holds.
        return release_vehicle(state, "the vehicle rebooted during its flight [rebooted]")
    if state.wait is not None and not state.launch.is_operators:
        # This process orders its own launch only once, so no order would follow after the reboot.
        return cancel_launch(state, "the vehicle rebooted while it waited for its launch")
    # Readiness and mission have to be checked again.
    state = state.enter(Phase.WAITING, plans=state.plans.forgotten(), launch=state.launch.withdrawn())
    return replace(
        state,
        last_position=VehicleState(),
        trouble="the vehicle has rebooted [rebooted]",
    ), []


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> StepResult:
    if event.order is not state.order.given:
        return state, []
    if state.trouble == state.order.failure:
        state = state.without_trouble()
    state = replace(state, order=state.order.followed())
    if state.phase is Phase.LAUNCHING:
        return note_takeoff(state), []
    if state.phase is Phase.FORMATION:
        return note_following(state), []
    if state.launch.is_aborted and not state.vehicle.armed and state.phase is not Phase.FAILED:
        return state.enter(Phase.DONE), []
    return state, []


def _order_failed(state: AgentState, event: ev.OrderFailed, now: float) -> StepResult:
    if event.order is not state.order.given:
        return state, []
    text = f"{event.order} failed: {event.reason}"
    if state.ended:
        is_late_order = event.order in ROLE_OF_ORDER  # an operator gave the order after the release
        return state, [ev.NotifyOperator(text)] if is_late_order else []
    state = replace(state, trouble=text, order=state.order.failed(text))
    if event.order is ev.FlightOrder.FORMATION:
        return not_following(state, state.trouble)
    if state.phase is not Phase.LAUNCHING:
        # The order is repeated while the agent still commands the vehicle.
        return replace(state, order=state.order.repeated(now + RETRY_AFTER_S)), []
    if state.launch.armed_seen or (state.lost and not event.nothing_sent):
        # The vehicle may be armed without climbing: it must not stay uncontrolled.
        return command(state, ev.FlightOrder.LAND, phase=Phase.LEAVING, given_up=True)
    if event.nothing_sent:
        return cancel_launch(state, event.reason)
    return state.enter(Phase.FAILED, outcome=state.trouble), []


# --- telemetry and messages of other vehicles


def _telemetry(state: AgentState, event: ev.TelemetryReceived, now: float) -> StepResult:
    """Note new telemetry and messages, end the flight, follow the failsafe rules, steer, tell the others."""
    state = _note_telemetry(replace(state, silent_s=0.0) if state.silent_s else state, event.state)
    if event.members:
        state = receive_messages(state, event.members)
    if event.neighbours:
        state = receive_neighbours(state, event.neighbours)
    if event.intents:
        state = receive_intents(state, event.intents)
    if event.neighbours or event.intents:
        state = with_members_hidden(with_reported_holds(state))
    if has_touched_down(state):
        return end_at_touchdown(state), []
    effects: list[ev.Effect] = []
    rules, steering = partial(apply_failsafes, now=now), partial(_steer, now=now)
    send_intent = partial(_send_intent, others_changed=bool(event.intents))
    for part in (_note_delay, rules, steering, tell_group, send_intent):
        state, new = part(state)
        effects += new
    if state.ended and not may_be_armed(state):
        return state, effects
    state, shared = share_state(state)
    return state, [*effects, *shared]


def _steer(state: AgentState, now: float) -> StepResult:
    """Let the parts of the policy act in their order, unless the flight has ended or telemetry is late.

    After a part that gives the vehicle an order, the others wait for the next telemetry. So a part earlier
    in the list has priority.
    """
    effects: list[ev.Effect] = []
    if state.ended or state.telemetry_is_late:
        return state, effects
    for part in (
        note_group,
        launch_if_possible,
        watch_first_route,
        _arrive,
        partial(_repeat_order, now=now),
        update_return,
        raise_alarms,
        resume_if_clear,
        queue_for_landing,
        stop_in_time,
        adjust_speed,
        fly_in_formation,
    ):
        state, new = part(state)
        if new:
            effects += new
            if any(isinstance(effect, ev.Command) for effect in new):
                break
    return state, effects


def _arrive(state: AgentState) -> StepResult:
    """Begin the landing of a vehicle that flies over its goal cell."""
    if state.phase is not Phase.FLYING or state.cell not in state.task.goals:
        return state, []
    return arrive(state).without_trouble(), []


def _repeat_order(state: AgentState, now: float) -> StepResult:
    """Repeat an order that failed, when its time has come."""
    if state.phase not in IN_FLIGHT or now < state.order.repeat_at_s or state.order.given is None:
        return state, []
    return command(state, state.order.given)


def _note_telemetry(state: AgentState, vehicle: VehicleState) -> AgentState:
    state = _update_position(state, vehicle) if vehicle.has_position else replace(state, vehicle=vehicle)
    if vehicle.armed and (state.phase is Phase.LAUNCHING or state.phase in IN_FLIGHT):
        state = replace(state, launch=state.launch.begun(vehicle.time_boot_s))
    return note_disarming(state)


def _note_delay(state: AgentState) -> StepResult:
    """Note whether the vehicle's telemetry is too old to decide by it, and tell the operator of a change."""
    delay_s = state.vehicle.delay_s
    is_late = delay_s > (RECENT_DELAY_S if state.telemetry_is_late else MAX_DELAY_S)
    if is_late == state.telemetry_is_late:
        return state, []
    text = (
        f"telemetry is {delay_s:.0f} s old (limit {MAX_DELAY_S:g} s); launches and mission changes are "
        "suspended until it recovers; look at the link and at the load of this machine"
        if is_late
        else "telemetry is recent again; launches and mission changes are possible"
    )
    messages: list[ev.Effect] = [] if state.ended else [ev.NotifyOperator(f"{text} [telemetry-old]")]
    return replace(state, telemetry_is_late=is_late), messages


def _send_intent(state: AgentState, *, others_changed: bool) -> StepResult:
    """Send the planned flight if it is due, and check it against the others' flights after any change.

    A released vehicle in the air still matters to other vehicles.
    """
    published: list[ev.Effect] = []
    if state.ended or not state.telemetry_is_late:
        state, published = share_intent(state)
    if not (published or others_changed):
        return state, []
    state, conflicts = check_own_route(state)
    return state, [*published, *conflicts]


def _update_position(state: AgentState, vehicle: VehicleState) -> AgentState:
    assert vehicle.lat_lon is not None
    cell = state.task.grid.cell_at(*vehicle.lat_lon)
    entered = cell is not None and cell != state.cell and vehicle.armed
    flown = state.flown.moved(state.vehicle, vehicle)
    state = replace(state, vehicle=vehicle, last_position=vehicle, cell=cell, flown=flown).with_progress()
    return _enter_cell(state, cell) if entered and cell is not None else state


def _enter_cell(state: AgentState, cell: Cell) -> AgentState:
    if state.plans.exposure is None:
        return state
    return replace(state, flown=state.flown.entered(cell, float(state.plans.exposure[cell])))


def _joined(state: AgentState, event: ev.Joined, _now: float) -> StepResult:
    # Each incarnation numbers its observations from 1 on.
    return replace(state, incarnation=event.incarnation, next_seq=1), []


def _link_lost(state: AgentState, event: ev.LinkLost, now: float) -> StepResult:
    """Act on a lost link, and repeat the announced flight to the other vehicles."""
    is_new, state = not state.lost, replace(state, lost=True, silent_s=event.age_s)
    if is_new:
        state = replace(state, sent=state.sent.state_due()).with_new_flight()
    state, effects = apply_failsafes(state, now)
    state, shared = share_state(state) if is_new and state.phase in IN_FLIGHT else (state, [])
    state, announced = share_intent(state)
    return state, [*effects, *shared, *announced]


def _link_restored(state: AgentState, _event: ev.LinkRestored, now: float) -> StepResult:
    state = replace(state, lost=False, silent_s=0.0)
    if state.order.given in ROLE_OF_ORDER and not state.order.is_followed:
        # The next telemetry repeats the order, unless that telemetry shows another operator's mode.
        return replace(state, order=state.order.repeated(now)), []
    return state, []


_HANDLERS: dict[type[Any], Callable[[AgentState, Any, float], StepResult]] = {
    ev.Joined: _joined,
    ev.Restarted: restart,
    ev.Ready: _ready,
    ev.TelemetryReceived: _telemetry,
    ev.Observed: learn_from_sensor,
    ev.ObservationsReceived: learn_from_others,
    ev.SpeedFailed: speed_failed,
    ev.MissionAccepted: mission_accepted,
    ev.MissionFailed: mission_failed,
    ev.OrderDone: _order_done,
    ev.OrderFailed: _order_failed,
    ev.LaunchPostponed: postpone_launch,
    ev.LinkLost: _link_lost,
    ev.LinkRestored: _link_restored,
    ev.OperatorCommand: handle_operator_command,
    ev.WeightsChanged: weights_changed,
    ev.Rebooted: _rebooted,
    ev.Tick: plan_if_due,
}
