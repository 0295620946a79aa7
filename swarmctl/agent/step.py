"""The fold: one handler an event."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from swarmctl.agent.decide import decide
from swarmctl.agent.state import IN_FLIGHT, ON_GROUND, PLANNING, AgentState, Phase
from swarmctl.core import events as ev
from swarmctl.core.belief import UNKNOWN, Observation
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.messages import ObservationShared, StateShared
from swarmctl.core.vehicle import VehicleState

SHARE_STATE_EVERY_S = 1.0
RETRY_AFTER_S = 5.0
MAX_FAILED_SWAPS = 3

Step = tuple[AgentState, list[ev.Effect]]


def step(state: AgentState, event: ev.Event, now: float) -> Step:
    """Fold one event. `now` is the run's clock [s]."""
    return _HANDLERS[type(event)](state, event, now)


def wants_tick(state: AgentState, now: float) -> bool:
    """There is something to decide and nothing in the way of deciding it."""
    return (
        state.dirty
        and state.phase in PLANNING
        and state.pending is None
        and not state.lost
        and now >= state.retry_at_s
    )


# --- what happens on the ground


def _ready(state: AgentState, _event: ev.Ready, _now: float) -> Step:
    if state.phase is not Phase.WAITING:
        return state, []
    return replace(state, phase=Phase.UPLOADING, dirty=True), []


def _failed(state: AgentState, event: ev.Failed, _now: float) -> Step:
    return replace(state, phase=Phase.FAILED, outcome=event.reason, pending=None), []


def _operator(state: AgentState, event: ev.OperatorCommand, _now: float) -> Step:
    order = event.order
    if state.ended:
        return state, []
    if order is ev.Order.LAUNCH:
        return _launch_if_possible(replace(state, launch_ordered=True))
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.DONE, outcome="not launched", pending=None), []
    phase = Phase.HOLDING if order is ev.Order.HOLD else Phase.LEAVING
    return _command(replace(state, phase=phase, pending=None, dirty=False, outcome=f"{order} ordered"), order)


def _command(state: AgentState, order: ev.Order) -> Step:
    return replace(state, ordered=order, order_seen=False), [ev.Command(order)]


def _launch_if_possible(state: AgentState) -> Step:
    if state.phase is Phase.STANDBY and state.launch_ordered and state.pending is None:
        return _command(replace(state, phase=Phase.LAUNCHING), ev.Order.LAUNCH)
    return state, []


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> Step:
    if event.order is state.ordered:
        state = replace(state, order_seen=True)
    if event.order is ev.Order.LAUNCH and state.phase is Phase.LAUNCHING:
        return replace(state, phase=Phase.FLYING), []
    return state, []


def _order_failed(state: AgentState, event: ev.OrderFailed, _now: float) -> Step:
    reason = f"{event.order} failed: {event.reason}"
    if event.order is not ev.Order.LAUNCH:
        # It stays what it was ordered to be: the operator sees the reason and may order again.
        return replace(state, outcome=reason), []
    if state.phase is not Phase.LAUNCHING:
        return state, []
    if not state.vehicle.armed and not state.lost:
        return replace(state, phase=Phase.FAILED, outcome=reason), []
    # Armed, as far as is known, and not seen to climb: it must not be left to itself.
    return _command(replace(state, phase=Phase.LEAVING, given_up=True, outcome=reason), ev.Order.LAND)


# --- what the vehicle, its sensor and the others say


def _telemetry(state: AgentState, event: ev.TelemetryReceived, _now: float) -> Step:
    vehicle = event.state
    if not vehicle.has_position:
        return replace(state, vehicle=vehicle), []
    state = _moved(state, vehicle)
    if state.phase in IN_FLIGHT and not vehicle.armed:
        state = _touched_down(state)
    elif (
        state.phase in (Phase.FLYING, Phase.LANDING)
        and state.ordered is ev.Order.LAUNCH
        and not vehicle.under_our_control
    ):
        reason = f"in mode {vehicle.mode}, which nobody here has ordered; let go"
        state = replace(state, phase=Phase.RELEASED, dirty=False, outcome=reason)
    elif state.phase is Phase.FLYING and state.cell in state.task.goals:
        state = replace(state, phase=Phase.LANDING, dirty=False)
    return _share_state(state)


def _moved(state: AgentState, vehicle: VehicleState) -> AgentState:
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    before, grid = state.vehicle, state.task.grid
    if vehicle.armed and before.lat_deg is not None and before.lon_deg is not None:
        metres = distance_m((before.lat_deg, before.lon_deg), (vehicle.lat_deg, vehicle.lon_deg))
        state = replace(state, flown_m=state.flown_m + metres)
    cell = grid.cell_at(vehicle.lat_deg, vehicle.lon_deg)
    entered = cell is not None and cell != state.cell and vehicle.armed
    state = replace(state, vehicle=vehicle, cell=cell)
    return _entered(state, cell) if entered and cell is not None else state


def _entered(state: AgentState, cell: Cell) -> AgentState:
    if state.route is not None and cell in state.route.cells:
        state = replace(state, progress=state.route.cells.index(cell))
    if state.exposure is None:
        return state
    p_s = float(state.exposure[cell])
    return replace(
        state,
        flown_cells=(*state.flown_cells, cell),
        flown_exposure=state.flown_exposure + p_s,
        flown_safety=state.flown_safety * (1.0 - min(p_s, 1.0)),
    )


def _touched_down(state: AgentState) -> AgentState:
    """It flew and is disarmed now."""
    if state.phase is Phase.LANDING:
        return replace(state, phase=Phase.DONE, outcome="arrived", pending=None)
    if state.phase is Phase.LEAVING:
        phase = Phase.FAILED if state.given_up else Phase.DONE
        return replace(state, phase=phase, outcome=f"{state.outcome}; landed", pending=None)
    where = f"in cell {state.cell}" if state.cell is not None else "outside the area"
    reason = f"disarmed {where}, short of its goal, in mode {state.vehicle.mode or 'unknown'}"
    return replace(state, phase=Phase.FAILED, outcome=reason, pending=None)


def _share_state(state: AgentState) -> Step:
    vehicle = state.vehicle
    # A vehicle's own clock falls back when it boots again.
    elapsed_s = vehicle.time_boot_s - state.last_shared_s
    if 0.0 <= elapsed_s < SHARE_STATE_EVERY_S:
        return state, []
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    assert vehicle.alt_rel_m is not None
    message = StateShared(
        sender=state.task.uav,
        time_s=vehicle.time_boot_s,
        lat_deg=vehicle.lat_deg,
        lon_deg=vehicle.lon_deg,
        alt_rel_m=vehicle.alt_rel_m,
        phase=state.phase,
        n_observed=state.belief.n_observed,
        n_found=state.belief.n_found,
    )
    return replace(state, last_shared_s=vehicle.time_boot_s), [ev.Publish(message)]


def _observed(state: AgentState, event: ev.Observed, now: float) -> Step:
    # What is known, own or heard, need not be sensed again (paper, section 3).
    new = tuple(c for c in event.cells if state.belief.known[c[0], c[1]] == UNKNOWN)
    if not new:
        return state, []
    observation = Observation(observer=state.task.uav, seq=state.next_seq, time_s=now, cells=new)
    state = _learn(replace(state, next_seq=state.next_seq + 1), observation)
    return state, [ev.Publish(ObservationShared(sender=state.task.uav, observation=observation))]


def _heard(state: AgentState, event: ev.Heard, _now: float) -> Step:
    try:
        return _learn(state, event.message.observation), []
    except ValueError as error:  # a cell outside the area, or one name with two contents
        return replace(state, refused=state.refused + 1, outcome=str(error)), []


def _learn(state: AgentState, observation: Observation) -> AgentState:
    belief = state.belief.merge((observation,))
    if belief is state.belief:
        return state
    learned = (observation.observer, observation.seq)
    return replace(state, belief=belief, dirty=True, because=(*state.because, learned))


def _link_lost(state: AgentState, _event: ev.LinkLost, _now: float) -> Step:
    return replace(state, lost=True), []


def _link_restored(state: AgentState, _event: ev.LinkRestored, _now: float) -> Step:
    state = replace(state, lost=False)
    if state.phase in IN_FLIGHT and state.ordered not in (None, ev.Order.LAUNCH) and not state.order_seen:
        # What it was told while nobody could reach it still holds.
        return state, [ev.Command(state.ordered)]
    return state, []


# --- deciding


def _tick(state: AgentState, _event: ev.Tick, now: float) -> Step:
    if not wants_tick(state, now):
        return state, []
    return decide(state)


def _mission_accepted(state: AgentState, event: ev.MissionAccepted, _now: float) -> Step:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    state = replace(state, route=swap, pending=None, progress=0, failed_swaps=0, outcome="")
    if state.phase in IN_FLIGHT:
        return replace(state, replans=state.replans + 1), []
    if state.phase is Phase.UPLOADING:
        state = replace(state, phase=Phase.STANDBY)
    return _launch_if_possible(state)


def _mission_failed(state: AgentState, event: ev.MissionFailed, now: float) -> Step:
    swap = state.pending
    if swap is None or swap.plan_id != event.plan_id:
        return state, []
    state = replace(state, pending=None, failed_swaps=state.failed_swaps + 1, outcome=event.reason)
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.FAILED), []
    if state.phase is Phase.LANDING and event.flying != "old":
        # Over its goal and standing still: there is nothing left to plan.
        return _command(state, ev.Order.LAND)
    if state.phase is not Phase.FLYING:
        return state, []
    if state.failed_swaps >= MAX_FAILED_SWAPS:
        return _command(replace(state, phase=Phase.LEAVING, given_up=True), state.task.fallback)
    # Decide again with all that is known by then. Unless it flies the old plan, any plan is better than none.
    return replace(
        state,
        dirty=True,
        because=(*swap.because, *state.because),
        retry_at_s=now + RETRY_AFTER_S,
        route=state.route if event.flying == "old" else None,
    ), []


_HANDLERS: dict[type[Any], Callable[[AgentState, Any, float], Step]] = {
    ev.Ready: _ready,
    ev.TelemetryReceived: _telemetry,
    ev.Observed: _observed,
    ev.Heard: _heard,
    ev.MissionAccepted: _mission_accepted,
    ev.MissionFailed: _mission_failed,
    ev.OrderDone: _order_done,
    ev.OrderFailed: _order_failed,
    ev.LinkLost: _link_lost,
    ev.LinkRestored: _link_restored,
    ev.OperatorCommand: _operator,
    ev.Failed: _failed,
    ev.Tick: _tick,
}
