"""The agent's event handlers, one for each kind of event, and the condition for a new decision."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec

from swarmctl.agent.arrival.simultaneous import adjust_speed, speed_failed
from swarmctl.agent.failsafes.enforcement import apply_failsafes
from swarmctl.agent.orders import (
    StepResult,
    command,
    handle_operator_command,
    release_vehicle,
    weights_changed,
)
from swarmctl.agent.own_modes import ROLE_OF_ORDER, own_mode_roles
from swarmctl.agent.phases import IN_FLIGHT, ON_GROUND, PLANNING, Phase
from swarmctl.agent.replan.decide import believed_exposure, decide
from swarmctl.agent.replan.splice import is_wall_close, may_learn_of_walls
from swarmctl.agent.replan.stopping import stop_end_s
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.restart import restart
from swarmctl.agent.sharing import learn_from_others, learn_from_sensor, share_state
from swarmctl.agent.state import AgentState
from swarmctl.agent.touchdown import end_at_touchdown, has_touched_down, may_be_armed, note_disarming
from swarmctl.agent.traffic.collision_avoidance import avoid_collisions
from swarmctl.agent.traffic.intents import receive_intents, share_intent
from swarmctl.agent.traffic.landing_queue import land_after_unconfirmed_hold, queue_for_landing
from swarmctl.agent.traffic.launching import (
    cancel_launch,
    launch_if_possible,
    note_takeoff,
    postpone_launch,
    watch_first_route,
)
from swarmctl.agent.traffic.neighbours import receive_neighbours
from swarmctl.agent.traffic.returning import update_return
from swarmctl.agent.traffic.route_deconfliction import check_own_route, deconflict
from swarmctl.core import events as ev
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.vehicle import MAX_DELAY_S, RECENT_DELAY_S, VehicleState
from swarmctl.planners.base import Unreachable

RETRY_AFTER_S = 5.0
"""Time until a failed order or mission change is tried again [s]."""
MAX_FAILED_SWAPS = 3


def step(state: AgentState, event: ev.Event, now: float) -> StepResult:
    """Return the agent's next state and the effects of an event at `now`, by the run's clock [s]."""
    return _HANDLERS[type(event)](state, event, now)


def needs_tick(state: AgentState, now: float) -> bool:
    """Return whether the agent has to decide on a plan now."""
    return (
        state.dirty
        and state.phase in PLANNING
        and state.pending is None
        and state.give_way.plan is None
        and not state.lost
        and not state.telemetry_is_late
        and now >= state.retry_at_s
        # The empty role: the vehicle's mode is not known yet.
        and (state.phase is not Phase.FLYING or state.vehicle.mode_role in {"", *own_mode_roles(state)})
        and (not _was_just_swapped(state) or _must_plan_now(state))
    )


def _was_just_swapped(state: AgentState) -> bool:
    """Return whether the time since the last mission change is below the expected time of a mission change.

    The agent does not plan during this time, so that its next plan includes all observations until then.
    """
    if state.phase is not Phase.FLYING:
        return False
    return 0.0 <= state.vehicle.time_boot_s - state.swaps.done_boot_s < state.swap_times.expected_s


def _must_plan_now(state: AgentState) -> bool:
    """Return whether planning is urgent: no plan is flown, the plan must change, or a wall is close."""
    if state.must_change or state.route is None:
        return True
    if not may_learn_of_walls(state):
        return False
    return is_wall_close(state, believed_exposure(state.task, state.belief, state.strength))


# --- the ground, the launch, and orders


def _ready(state: AgentState, _event: ev.Ready, _now: float) -> StepResult:
    if state.phase is not Phase.WAITING:
        return state, []
    return state.enter(Phase.UPLOADING, dirty=True), []


def _rebooted(state: AgentState, _event: ev.Rebooted, _now: float) -> StepResult:
    if state.ended:
        return state, []
    if state.phase not in ON_GROUND:
        # Its mode, mission and position estimate began anew, so nothing that this agent knows holds.
        return release_vehicle(state, "the vehicle rebooted during its flight [rebooted]")
    if state.launch.wait_since_boot_s is not None and not state.launch.is_operators:
        # This process orders its own launch only once, so no order would follow after the reboot.
        return cancel_launch(state, "the vehicle rebooted while it waited for its launch")
    # Readiness and mission have to be checked again.
    state = state.enter(Phase.WAITING, route=None, pending=None, launch=state.launch.withdrawn())
    return replace(
        state,
        last_position=VehicleState(),
        trouble="the vehicle has rebooted [rebooted]",
    ), []


def _operator(state: AgentState, event: ev.OperatorCommand, now: float) -> StepResult:
    state, effects = handle_operator_command(state, event, now)
    state, begun = launch_if_possible(state)
    state, conflict = watch_first_route(state)
    begun += conflict
    waits = state.phase is Phase.STANDBY and state.launch.wait_since_boot_s is not None
    if event.order is ev.FlightOrder.LAUNCH and waits:
        effects = [_with_note(effect, state.trouble) for effect in effects]
    return state, [*begun, *effects]


def _with_note(effect: ev.Effect, note: str) -> ev.Effect:
    """Return the effect; if it answers an accepted order, with `note` as the note of the answer."""
    if not isinstance(effect, ev.Answer) or effect.answer.outcome != "taken":
        return effect
    answer = msgspec.structs.replace(effect.answer, note=note)
    return msgspec.structs.replace(effect, answer=answer)


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> StepResult:
    if event.order is not state.order.given:
        return state, []
    state = replace(state, order=state.order.followed())
    if state.phase is Phase.LAUNCHING:
        return note_takeoff(state), []
    if state.launch.is_aborted and not state.vehicle.armed and state.phase is not Phase.FAILED:
        return state.enter(Phase.DONE), []
    return state, []


def _order_failed(state: AgentState, event: ev.OrderFailed, now: float) -> StepResult:
    if event.order is not state.order.given:
        return state, []
    if state.ended:
        is_late_order = event.order in ROLE_OF_ORDER  # an operator gave the order after the release
        return state, [ev.NotifyOperator(f"{event.order} failed: {event.reason}")] if is_late_order else []
    state = replace(state, trouble=f"{event.order} failed: {event.reason}")
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
    """Act on new telemetry, in a fixed order of steps.

    After a touchdown, a release, a landing after an unconfirmed hold, or a repeated order, the remaining
    steps wait for the next telemetry; with late telemetry they wait for recent telemetry.
    """
    vehicle = event.state
    state = _update_position(state, vehicle) if vehicle.has_position else replace(state, vehicle=vehicle)
    if vehicle.armed and (state.phase is Phase.LAUNCHING or state.phase in IN_FLIGHT):
        state = replace(state, launch=state.launch.begun(vehicle.time_boot_s))
    state, delayed = _note_delay(note_disarming(state))
    if has_touched_down(state):
        # The last state is sent at once, because the process may end soon.
        return share_state(replace(end_at_touchdown(state), last_shared_s=-math.inf))
    state, demanded = apply_failsafes(state, now)
    demanded = [*delayed, *demanded]
    if state.ended:
        # A released vehicle in the air still matters to other vehicles.
        state, published = share_intent(state)
        state, shared = share_state(state) if may_be_armed(state) else (state, [])
        return state, [*demanded, *published, *shared]
    if state.telemetry_is_late:
        state, shared = share_state(state)
        return state, [*demanded, *shared]
    state, begun = launch_if_possible(state)
    state, conflict = watch_first_route(state)
    begun += conflict
    if state.phase is Phase.FLYING and state.cell in state.task.goals:
        state = state.enter(Phase.LANDING, dirty=False, arrived_boot_s=vehicle.time_boot_s)
        state = _without_swap_trouble(state)
        # From now on the vehicle has priority over vehicles en route; its intent is due at once.
        state = replace(state, intent_sent_boot_s=-math.inf)
    state, landed = land_after_unconfirmed_hold(state)
    if landed:
        return state, [*demanded, *landed]
    if state.phase in IN_FLIGHT and now >= state.order.repeat_at_s and state.order.given is not None:
        state, again = command(state, state.order.given)
        return state, [*demanded, *again]
    state, returned = update_return(state)
    state, avoided = avoid_collisions(state)
    state, queued = queue_for_landing(state)
    state, speed = adjust_speed(state)
    state, intent = _send_intent(state)
    state, shared = share_state(state)
    return state, [*demanded, *begun, *returned, *avoided, *queued, *speed, *intent, *shared]


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


def _send_intent(state: AgentState) -> StepResult:
    state, published = share_intent(state)
    if not published:
        return state, []
    state, conflicts = check_own_route(state)
    return state, [*published, *conflicts]


def _intents(state: AgentState, event: ev.Intents, now: float) -> StepResult:
    state, _ = receive_intents(state, event, now)
    state, conflict = watch_first_route(state)
    state, checked = check_own_route(state)
    return state, [*conflict, *checked]


def _update_position(state: AgentState, vehicle: VehicleState) -> AgentState:
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    cell = state.task.grid.cell_at(vehicle.lat_deg, vehicle.lon_deg)
    entered = cell is not None and cell != state.cell and vehicle.armed
    flown = state.flown.moved(state.vehicle, vehicle)
    state = replace(state, vehicle=vehicle, last_position=vehicle, cell=cell, flown=flown).with_progress()
    return _enter_cell(state, cell) if entered and cell is not None else state


def _enter_cell(state: AgentState, cell: Cell) -> AgentState:
    if state.exposure is None:
        return state
    return replace(state, flown=state.flown.entered(cell, float(state.exposure[cell])))


def _joined(state: AgentState, event: ev.Joined, _now: float) -> StepResult:
    # Each incarnation numbers its observations from 1 on.
    return replace(state, incarnation=event.incarnation, next_seq=1), []


def _link_lost(state: AgentState, _event: ev.LinkLost, now: float) -> StepResult:
    state, demanded = apply_failsafes(replace(state, lost=True, last_shared_s=-math.inf), now)
    state, shared = share_state(state) if state.phase in IN_FLIGHT else (state, [])
    return state, [*demanded, *shared]


def _link_restored(state: AgentState, _event: ev.LinkRestored, now: float) -> StepResult:
    state = replace(state, lost=False)
    if state.order.given in ROLE_OF_ORDER and not state.order.is_followed:
        # The next telemetry repeats the order, unless that telemetry shows another operator's mode.
        return replace(state, order=state.order.repeated(now)), []
    return state, []


# --- deciding


def _tick(state: AgentState, _event: ev.Tick, now: float) -> StepResult:
    if not needs_tick(state, now):
        return state, []
    try:
        state, effects = deconflict(state, decide(state), now)
    except Unreachable as error:
        return _handle_unreachable_goal(replace(state, dirty=False, because=(), trouble=str(error)))
    keeps_plan = state.route is not None and state.pending is None and not state.dirty
    return (_without_swap_trouble(state) if keeps_plan else state), effects


def _without_swap_trouble(state: AgentState) -> AgentState:
    """Clear the trouble of a failed mission change, because the vehicle flies its planned mission."""
    return replace(state, trouble="") if state.trouble and state.trouble == state.swaps.failure else state


def _handle_unreachable_goal(state: AgentState) -> StepResult:
    """Keep the present route, or end the flight, because the agent has found no route to a goal."""
    if state.phase in ON_GROUND:
        return state.enter(Phase.FAILED, outcome=state.trouble), []
    if state.route is not None:
        return state, []
    return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)


def _mission_accepted(state: AgentState, event: ev.MissionAccepted, _now: float) -> StepResult:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    state = replace(state, accepted=swap, pending=None)
    if state.ended:
        return state, []
    # The vehicle has flown on since the decision.
    state = replace(state, route=swap, route_exposure=state.exposure).with_progress()
    state = replace(state, swaps=replace(state.swaps, n_failed=0), trouble="", hold_is_own=False)
    # A mode change during the swap may have reset the commanded speed.
    state = replace(state, speed=state.speed.after_swap())
    if state.phase in IN_FLIGHT:
        if event.took_s is not None:
            state = replace(state, swap_times=state.swap_times.measured(event.took_s, event.stood_still_s))
        swaps = state.swaps.done(state.vehicle.time_boot_s, stop_end_s(state))
        return replace(state, replans=state.replans + 1, swaps=swaps), []
    if event.took_s is not None:
        state = replace(state, swap_times=SwapTimes.expecting(event.took_s))
    if state.phase is Phase.UPLOADING:
        state = state.enter(Phase.STANDBY)
    return launch_if_possible(state)


def _mission_failed(state: AgentState, event: ev.MissionFailed, now: float) -> StepResult:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    swaps = state.swaps.failed(event.reason, is_late=event.is_late)
    # A mode change during the swap may have reset the speed.
    speed = state.speed.unknown()
    state = replace(state, pending=None, swaps=swaps, speed=speed, trouble=event.reason)
    if event.is_late:
        state = replace(state, swap_times=state.swap_times.too_late())
    if state.phase in ON_GROUND:
        return state.enter(Phase.FAILED, outcome=event.reason), []
    if event.flying == "theirs" and state.phase in IN_FLIGHT:
        return release_vehicle(state, event.reason)
    state = replace(state, hold_is_own=event.flying == "hold")
    if state.phase is Phase.LANDING and (event.flying != "old" or swap.plan.from_hold):
        # The vehicle may hold in its goal cell, so it has to land there.
        return command(state, ev.FlightOrder.LAND)
    if state.phase is Phase.LANDING:
        return _without_swap_trouble(state), []
    if state.phase is not Phase.FLYING:
        return state, []
    if state.swaps.n_failed >= MAX_FAILED_SWAPS:
        return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)
    # A vehicle that no longer flies its old plan has no route, so it takes any new plan.
    return replace(
        state,
        dirty=True,
        because=(*swap.because, *state.because),
        retry_at_s=now if event.is_late else now + RETRY_AFTER_S,
        route=state.route if event.flying == "old" else None,
    ), []


_HANDLERS: dict[type[Any], Callable[[AgentState, Any, float], StepResult]] = {
    ev.Joined: _joined,
    ev.Restarted: restart,
    ev.Ready: _ready,
    ev.TelemetryReceived: _telemetry,
    ev.Observed: learn_from_sensor,
    ev.ObservationsReceived: learn_from_others,
    ev.Neighbours: receive_neighbours,
    ev.Intents: _intents,
    ev.SpeedFailed: speed_failed,
    ev.MissionAccepted: _mission_accepted,
    ev.MissionFailed: _mission_failed,
    ev.OrderDone: _order_done,
    ev.OrderFailed: _order_failed,
    ev.LaunchPostponed: postpone_launch,
    ev.LinkLost: _link_lost,
    ev.LinkRestored: _link_restored,
    ev.OperatorCommand: _operator,
    ev.WeightsChanged: weights_changed,
    ev.Rebooted: _rebooted,
    ev.Tick: _tick,
}
