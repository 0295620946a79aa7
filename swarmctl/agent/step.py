"""The fold: one handler an event."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from swarmctl.agent.arrival.simultaneous import UNKNOWN_M_S, keep_pace, speed_failed
from swarmctl.agent.failsafes.enforcement import ruled
from swarmctl.agent.learning import heard, observed
from swarmctl.agent.orders import (
    Step,
    command,
    let_go,
    operator,
    weights_changed,
)
from swarmctl.agent.own_modes import ROLES, roles_of_ours
from swarmctl.agent.replan.decide import believed_exposure, decide
from swarmctl.agent.replan.route_to_mission import index_abreast
from swarmctl.agent.replan.splice import is_urgent, may_meet_walls
from swarmctl.agent.replan.stopping import stopped_at
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.sharing import share_state
from swarmctl.agent.state import IN_FLIGHT, ON_GROUND, PLANNING, AgentState, Phase
from swarmctl.agent.touchdown import disarmed_since, is_up, touched_down
from swarmctl.agent.traffic.collision_avoidance import keep_apart
from swarmctl.agent.traffic.intents import intents_heard, tell_intent
from swarmctl.agent.traffic.landing_queue import lands_unheard, wait_above
from swarmctl.agent.traffic.launching import launch_if_possible, launched, not_launched, put_off
from swarmctl.agent.traffic.neighbours import neighbours_heard
from swarmctl.agent.traffic.returning import take_turn
from swarmctl.agent.traffic.route_deconfliction import compared, foresee
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.vehicle import VehicleState
from swarmctl.planners.base import Unreachable

RETRY_AFTER_S = 5.0
MAX_FAILED_SWAPS = 3


def step(state: AgentState, event: ev.Event, now: float) -> Step:
    """Fold one event. `now` is the run's clock [s]."""
    return _HANDLERS[type(event)](state, event, now)


def wants_tick(state: AgentState, now: float) -> bool:
    """There is something to decide and nothing in the way of deciding it."""
    return (
        state.dirty
        and state.phase in PLANNING
        and state.pending is None
        and state.gave_way is None
        and not state.lost
        and now >= state.retry_at_s
        and (state.phase is not Phase.FLYING or state.vehicle.mode_role in {"", *roles_of_ours(state)})
        and (not _is_taking_up(state) or _is_urgent(state))
    )


def _is_taking_up(state: AgentState) -> bool:
    """Whether it has only just got its plan: it gets no other within the time that one took. What is learned
    meanwhile is in the next."""
    if state.phase is not Phase.FLYING:
        return False
    return 0.0 <= state.vehicle.time_boot_s - state.swapped_boot_s < state.swap_times.expected_s


def _is_urgent(state: AgentState) -> bool:
    """It has nothing that it could fly on, or a wall close before it."""
    if state.must_change or state.route is None:
        return True
    if not may_meet_walls(state):
        return False
    return is_urgent(state, believed_exposure(state.task, state.belief, state.strength))


# --- the ground, the launch, and orders


def _ready(state: AgentState, _event: ev.Ready, _now: float) -> Step:
    if state.phase is not Phase.WAITING:
        return state, []
    return replace(state, phase=Phase.UPLOADING, dirty=True), []


def _rebooted(state: AgentState, _event: ev.Rebooted, _now: float) -> Step:
    if state.phase not in ON_GROUND:
        # Its clock began anew.
        placed = replace(state.placed, time_boot_s=0.0)
        return replace(state, placed=placed, trouble="it has rebooted"), []
    if state.launch_waits_boot_s is not None and not state.launch_is_operators:
        return not_launched(state, "it has rebooted while it waited")  # its process orders it once
    # Readiness and mission are to be established again.
    state = replace(state, phase=Phase.WAITING, route=None, pending=None, launch_ordered=False)
    return replace(state, launch_waits_boot_s=None, placed=VehicleState(), trouble="it has rebooted"), []


def _operator(state: AgentState, event: ev.OperatorCommand, now: float) -> Step:
    state, effects = operator(state, event, now)
    state, begun = launch_if_possible(state)
    waits = state.phase is Phase.STANDBY and state.launch_waits_boot_s is not None
    if event.order is ev.Order.LAUNCH and waits:
        effects = [_noted(effect, state.trouble) for effect in effects]
    return state, [*begun, *effects]


def _noted(effect: ev.Effect, note: str) -> ev.Effect:
    """With a word to whom it answers."""
    if not isinstance(effect, ev.Answer) or effect.answer.outcome != "taken":
        return effect
    answer = msgspec.structs.replace(effect.answer, note=note)
    return msgspec.structs.replace(effect, answer=answer)


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> Step:
    if event.order is not state.ordered:
        return state, []
    state = replace(state, order_seen=True, order_again_at_s=math.inf)
    if state.phase is Phase.LAUNCHING:
        return launched(state), []
    if state.launch_aborted and not state.vehicle.armed:
        return replace(state, phase=Phase.DONE), []
    return state, []


def _order_failed(state: AgentState, event: ev.OrderFailed, now: float) -> Step:
    if event.order is not state.ordered:
        return state, []
    if state.ended:
        told = event.order in ROLES  # somebody's who tried after it was let go
        return state, [ev.Tell(f"{event.order} failed: {event.reason}")] if told else []
    state = replace(state, trouble=f"{event.order} failed: {event.reason}")
    if state.phase is not Phase.LAUNCHING:
        # The order stands: it is given again while the vehicle is still ours to order.
        return replace(state, order_again_at_s=now + RETRY_AFTER_S), []
    if state.armed_seen or (state.lost and not event.nothing_sent):
        # Armed, as far as is known, and not seen to climb: it must not be left to itself.
        return command(state, ev.Order.LAND, phase=Phase.LEAVING, given_up=True)
    if event.nothing_sent:
        return not_launched(state, event.reason)
    return replace(state, phase=Phase.FAILED, outcome=state.trouble), []


# --- what the vehicle, its sensor and the others say


def _telemetry(state: AgentState, event: ev.TelemetryReceived, now: float) -> Step:
    vehicle = event.state
    state = _moved(state, vehicle) if vehicle.has_position else replace(state, vehicle=vehicle)
    launched_s = state.launched_boot_s
    is_launched = vehicle.armed and (state.phase is Phase.LAUNCHING or state.phase in IN_FLIGHT)
    if is_launched and not (state.armed_seen and launched_s is not None):
        launched_s = vehicle.time_boot_s if launched_s is None else launched_s
        state = replace(state, armed_seen=True, launched_boot_s=launched_s)
    state = disarmed_since(state)
    if state.phase in IN_FLIGHT and state.armed_seen and not is_up(state):
        # The last it tells, and at once: its process may end with it.
        return share_state(replace(touched_down(state), last_shared_s=-math.inf))
    state, demanded = ruled(state, now)
    if state.ended:
        # Who is flown by somebody else is in the others' way all the same.
        state, told = tell_intent(state)
        state, shared = share_state(state) if is_up(state) else (state, [])
        return state, [*demanded, *told, *shared]
    state, begun = launch_if_possible(state)
    if state.phase is Phase.FLYING and state.cell in state.task.goals:
        state = replace(state, phase=Phase.LANDING, dirty=False, arrived_boot_s=vehicle.time_boot_s)
        state = _as_decided(state)
        state = replace(state, intent_said_s=-math.inf)  # it gives way to nobody on its way any more
    state, landed = lands_unheard(state)
    if landed:
        return state, [*demanded, *landed]
    if state.phase in IN_FLIGHT and now >= state.order_again_at_s and state.ordered is not None:
        state, again = command(state, state.ordered)
        return state, [*demanded, *again]
    state, turned = take_turn(state)
    state, kept_apart = keep_apart(state)
    state, waited = wait_above(state)
    state, paced = keep_pace(state)
    state, intent = _tell_intent(state)
    state, shared = share_state(state)
    return state, [*demanded, *begun, *turned, *kept_apart, *waited, *paced, *intent, *shared]


def _tell_intent(state: AgentState) -> Step:
    """Where it will be; and whether that meets anybody."""
    state, told = tell_intent(state)
    if not told:
        return state, []
    state, foreseen = foresee(state)
    return state, [*told, *foreseen]


def _intents(state: AgentState, event: ev.Intents, now: float) -> Step:
    state, _ = intents_heard(state, event, now)
    return foresee(state)


def _moved(state: AgentState, vehicle: VehicleState) -> AgentState:
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    before, grid, flown_m = state.vehicle, state.task.grid, state.flown_m
    if vehicle.armed and before.lat_deg is not None and before.lon_deg is not None:
        flown_m += distance_m((before.lat_deg, before.lon_deg), (vehicle.lat_deg, vehicle.lon_deg))
    cell = grid.cell_at(vehicle.lat_deg, vehicle.lon_deg)
    entered = cell is not None and cell != state.cell and vehicle.armed
    state = replace(state, vehicle=vehicle, placed=vehicle, cell=cell, flown_m=flown_m)
    return _entered(state, cell) if entered and cell is not None else state


def _entered(state: AgentState, cell: Cell) -> AgentState:
    if state.route is not None and (index := index_abreast(state.route, cell, state.progress)) is not None:
        state = replace(state, progress=index)
    if state.exposure is None:
        return state
    first, p_s = not state.flown_cells, float(state.exposure[cell])
    state = replace(state, flown_cells=(*state.flown_cells, cell))
    if first:
        return state  # the start cell is not counted, as in a planned route
    if math.isinf(p_s):
        return replace(state, no_fly_entered=state.no_fly_entered + 1)
    return replace(
        state,
        flown_exposure=state.flown_exposure + p_s,
        flown_safety=state.flown_safety * (1.0 - min(p_s, 1.0)),
    )


def _joined(state: AgentState, event: ev.Joined, _now: float) -> Step:
    return replace(state, incarnation=event.incarnation), []


def _link_lost(state: AgentState, _event: ev.LinkLost, now: float) -> Step:
    state, demanded = ruled(replace(state, lost=True, last_shared_s=-math.inf), now)
    state, shared = share_state(state) if state.phase in IN_FLIGHT else (state, [])
    return state, [*demanded, *shared]


def _link_restored(state: AgentState, _event: ev.LinkRestored, now: float) -> Step:
    state = replace(state, lost=False)
    if state.ordered in ROLES and not state.order_seen:
        # What it was told while nobody could reach it still holds, if its next words show it is still ours.
        return replace(state, order_again_at_s=now), []
    return state, []


# --- deciding


def _tick(state: AgentState, _event: ev.Tick, now: float) -> Step:
    if not wants_tick(state, now):
        return state, []
    try:
        state, effects = compared(state, decide(state), now)
    except Unreachable as error:
        return _no_way(replace(state, dirty=False, because=(), trouble=str(error)))
    keeps = state.route is not None and state.pending is None and not state.dirty
    return (_as_decided(state) if keeps else state), effects


def _as_decided(state: AgentState) -> AgentState:
    """It flies what it is to fly: that its mission could not be changed matters no more."""
    return replace(state, trouble="") if state.trouble and state.trouble == state.swap_trouble else state


def _no_way(state: AgentState) -> Step:
    """No route leads from where it is to its goal."""
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.FAILED, outcome=state.trouble), []
    if state.route is not None:
        return state, []  # it flies on as planned, which is better than anything known
    return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)


def _mission_accepted(state: AgentState, event: ev.MissionAccepted, _now: float) -> Step:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    state = replace(state, accepted=swap, pending=None)
    if state.ended:
        return state, []
    state = replace(state, route=swap, held=state.exposure, progress=0, failed_swaps=0, trouble="")
    # A change of mode on the way may have taken back what speed it was given.
    state = replace(state, speed_m_s=None if state.speed_m_s is None else UNKNOWN_M_S)
    state = replace(state, hold_is_ours=False)
    if state.phase in IN_FLIGHT:
        if event.took_s is not None:
            state = replace(state, swap_times=state.swap_times.measured(event.took_s, event.stood_still_s))
        state = replace(state, stopped_boot_s=stopped_at(state))
        return replace(state, replans=state.replans + 1, swapped_boot_s=state.vehicle.time_boot_s), []
    if event.took_s is not None:
        state = replace(state, swap_times=SwapTimes.expecting(event.took_s))
    if state.phase is Phase.UPLOADING:
        state = replace(state, phase=Phase.STANDBY)
    return launch_if_possible(state)


def _mission_failed(state: AgentState, event: ev.MissionFailed, now: float) -> Step:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    failed = state.failed_swaps + (not event.is_late)
    state = replace(state, pending=None, failed_swaps=failed)
    state = replace(state, trouble=event.reason, swap_trouble=event.reason)
    state = replace(state, speed_m_s=UNKNOWN_M_S)  # whether it has changed its mode on the way, nobody knows
    if event.is_late:
        state = replace(state, swap_times=state.swap_times.too_late())
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.FAILED, outcome=event.reason), []
    if event.flying == "theirs" and state.phase in IN_FLIGHT:
        return let_go(state, event.reason)
    state = replace(state, hold_is_ours=event.flying == "hold")
    if state.phase is Phase.LANDING and (event.flying != "old" or swap.plan.from_hold):
        # Over its goal and standing still: there is nothing left to plan.
        return command(state, ev.Order.LAND)
    if state.phase is Phase.LANDING:
        return _as_decided(state), []
    if state.phase is not Phase.FLYING:
        return state, []
    if state.failed_swaps >= MAX_FAILED_SWAPS:
        return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)
    # Decide again with all that is known by then. Unless it flies the old plan, any plan is better than none.
    return replace(
        state,
        dirty=True,
        because=(*swap.because, *state.because),
        retry_at_s=now if event.is_late else now + RETRY_AFTER_S,
        route=state.route if event.flying == "old" else None,
    ), []


_HANDLERS: dict[type[Any], Callable[[AgentState, Any, float], Step]] = {
    ev.Joined: _joined,
    ev.Ready: _ready,
    ev.TelemetryReceived: _telemetry,
    ev.Observed: observed,
    ev.Heard: heard,
    ev.Neighbours: neighbours_heard,
    ev.Intents: _intents,
    ev.SpeedFailed: speed_failed,
    ev.MissionAccepted: _mission_accepted,
    ev.MissionFailed: _mission_failed,
    ev.OrderDone: _order_done,
    ev.OrderFailed: _order_failed,
    ev.LaunchPutOff: put_off,
    ev.LinkLost: _link_lost,
    ev.LinkRestored: _link_restored,
    ev.OperatorCommand: _operator,
    ev.WeightsChanged: weights_changed,
    ev.Rebooted: _rebooted,
    ev.Tick: _tick,
}
