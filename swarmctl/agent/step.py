"""The fold: one handler an event."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from swarmctl.agent.apart import keep_apart
from swarmctl.agent.approach import ROLL_OUT_M
from swarmctl.agent.branching import is_urgent, may_meet_walls
from swarmctl.agent.clearing import compared, foresee
from swarmctl.agent.decide import believed_exposure, decide
from swarmctl.agent.intents import intents_heard, tell_intent
from swarmctl.agent.meeting import UNKNOWN_M_S, earliest_in_s, keep_pace, speed_failed
from swarmctl.agent.neighbours import neighbours_heard
from swarmctl.agent.orders import (
    Step,
    command,
    launch_if_possible,
    let_go,
    operator,
    turn_come,
    weights_changed,
)
from swarmctl.agent.ours import ROLES, roles_of_ours
from swarmctl.agent.realise import index_abreast
from swarmctl.agent.ruling import ruled
from swarmctl.agent.state import ARRIVED, IN_FLIGHT, ON_GROUND, PLANNING, AgentState, Phase
from swarmctl.agent.swap_times import SwapTimes
from swarmctl.core import events as ev
from swarmctl.core.frames import MAX_TEXT, StateShared
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.observation import MAX_CELLS, Checkpoint, Observation, Told
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.planners.base import Unreachable

SHARE_STATE_EVERY_S = 1.0
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
        return replace(state, trouble="it has rebooted"), []
    # Readiness and mission are to be established again.
    state = replace(state, phase=Phase.WAITING, route=None, pending=None, launch_ordered=False)
    return replace(state, trouble="it has rebooted"), []


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> Step:
    if event.order is not state.ordered:
        return state, []
    state = replace(state, order_seen=True, order_again_at_s=math.inf)
    if state.phase is Phase.LAUNCHING:
        return replace(state, phase=Phase.FLYING), []
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
    if state.armed_seen or state.lost:
        # Armed, as far as is known, and not seen to climb: it must not be left to itself.
        return command(state, ev.Order.LAND, phase=Phase.LEAVING, given_up=True)
    return replace(state, phase=Phase.FAILED, outcome=state.trouble), []


# --- what the vehicle, its sensor and the others say


def _telemetry(state: AgentState, event: ev.TelemetryReceived, now: float) -> Step:
    vehicle = event.state
    state = _moved(state, vehicle) if vehicle.has_position else replace(state, vehicle=vehicle)
    if vehicle.armed and (state.phase is Phase.LAUNCHING or state.phase in IN_FLIGHT):
        launched_s = vehicle.time_boot_s if state.launched_boot_s is None else state.launched_boot_s
        state = replace(state, armed_seen=True, launched_boot_s=launched_s)
    state = _disarmed_since(state)
    if state.phase in IN_FLIGHT and state.armed_seen and _is_down(state):
        # The last it tells, and at once: its process may end with it.
        return _share_state(replace(_touched_down(state), last_shared_s=-math.inf))
    state, demanded = ruled(state, now)
    if state.ended:
        state, told = tell_intent(state)
        return state, [*demanded, *told]
    if state.phase is Phase.FLYING and state.cell in state.task.goals:
        state = replace(state, phase=Phase.LANDING, dirty=False, arrived_boot_s=vehicle.time_boot_s)
    if state.phase in IN_FLIGHT and now >= state.order_again_at_s and state.ordered is not None:
        state, again = command(state, state.ordered)
        return state, [*demanded, *again]
    if (called := turn_come(state)) is not None:
        state, again = called
        return state, [*demanded, *again]
    state, kept_apart = keep_apart(state)
    state, paced = keep_pace(state)
    state, intent = _tell_intent(state)
    state, shared = _share_state(state)
    return state, [*demanded, *kept_apart, *paced, *intent, *shared]


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
    before, grid = state.vehicle, state.task.grid
    if vehicle.armed and before.lat_deg is not None and before.lon_deg is not None:
        metres = distance_m((before.lat_deg, before.lon_deg), (vehicle.lat_deg, vehicle.lon_deg))
        state = replace(state, flown_m=state.flown_m + metres)
    cell = grid.cell_at(vehicle.lat_deg, vehicle.lon_deg)
    entered = cell is not None and cell != state.cell and vehicle.armed
    state = replace(state, vehicle=vehicle, cell=cell)
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


def _disarmed_since(state: AgentState) -> AgentState:
    since_s = state.vehicle.heartbeat_s if state.disarmed_s is None else state.disarmed_s
    told_s = None if state.vehicle.armed else since_s
    return state if told_s == state.disarmed_s else replace(state, disarmed_s=told_s)


def _is_down(state: AgentState) -> bool:
    """It says that it is disarmed, and that it is on the ground, or says so twice: its flight is over."""
    vehicle = state.vehicle
    is_told_twice = vehicle.heartbeat_s != state.disarmed_s
    return not vehicle.armed and (is_told_twice or vehicle.landed is Landed.ON_GROUND)


def _touched_down(state: AgentState) -> AgentState:
    """It was armed by its launch and is disarmed now."""
    if state.phase is Phase.LANDING and (state.cell in state.task.goals or _rolled_out(state)):
        return replace(state, phase=Phase.DONE, outcome=ARRIVED, pending=None)
    if state.phase is Phase.LEAVING:
        phase = Phase.FAILED if state.given_up else Phase.DONE
        said = state.outcome or state.trouble
        return replace(state, phase=phase, outcome=f"{said}; landed", pending=None)
    where = f"in cell {state.cell}" if state.cell is not None else "outside the area"
    battery = state.vehicle.battery_percent
    rest = "" if battery is None else f", battery {battery} %"
    reason = f"disarmed {where}, short of its goal, in mode {state.vehicle.mode or 'unknown'}{rest}"
    return replace(state, phase=Phase.FAILED, outcome=reason, pending=None)


def _rolled_out(state: AgentState) -> bool:
    """Whether a fixed wing stands where it was to land, or has rolled to."""
    vehicle, swap = state.vehicle, state.route
    if swap is None or swap.plan.approach is None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return False
    down = swap.plan.approach.touchdown
    away_m = distance_m((vehicle.lat_deg, vehicle.lon_deg), (down.lat_deg, down.lon_deg))
    return away_m <= ROLL_OUT_M


def _share_state(state: AgentState) -> Step:
    vehicle = state.vehicle
    if not vehicle.has_position:
        return state, []
    # A vehicle's own clock falls back when it boots again.
    elapsed_s = vehicle.time_boot_s - state.last_shared_s
    if 0.0 <= elapsed_s < SHARE_STATE_EVERY_S:
        return state, []
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    assert vehicle.alt_rel_m is not None
    message = StateShared(
        time_s=vehicle.time_boot_s,
        lat_deg=vehicle.lat_deg,
        lon_deg=vehicle.lon_deg,
        alt_rel_m=vehicle.alt_rel_m,
        phase=state.phase,
        n_observed=state.belief.n_observed,
        n_found=state.belief.n_found,
        mode=vehicle.mode[:MAX_TEXT],
        plan_id=0 if state.route is None else state.route.plan_id,
        replans=state.replans,
        late_s=state.late_s,
        outcome=state.outcome[:MAX_TEXT],
        trouble=(state.alarm or state.trouble)[:MAX_TEXT],
        alt_amsl_m=vehicle.alt_amsl_m,
        earliest_in_s=earliest_in_s(state),
        velocity_m_s=(vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s),
    )
    return replace(state, last_shared_s=vehicle.time_boot_s), [ev.Publish(message)]


def _observed(state: AgentState, event: ev.Observed, now: float) -> Step:
    # DEVIATION: of what is known the paper's UAVs sense no more. Who sees the contrary of what it was told
    # says so: somebody errs, or lies.
    against = state.belief.contrary(event.cells)
    new = (*state.belief.unsettled(event.cells), *against)
    effects: list[ev.Effect] = []
    for i in range(0, len(new), MAX_CELLS):
        seen = Observation(state.task.uav, state.next_seq, now, new[i : i + MAX_CELLS], state.incarnation)
        state = _learn(replace(state, next_seq=state.next_seq + 1), (seen,))
        effects.append(ev.Publish(seen, tuple((r, c) for r, c, _ in against)))
    return state, effects


def _heard(state: AgentState, event: ev.Heard, _now: float) -> Step:
    try:
        return _learn(state, event.told), []
    except ValueError:  # a cell outside the area, or one name with two contents: take what is good
        pass
    for told in event.told:
        try:
            state = _learn(state, (told,))
        except ValueError as error:
            state = replace(state, refused=state.refused + 1, trouble=str(error))
    return state, []


def _learn(state: AgentState, told: tuple[Told, ...]) -> AgentState:
    belief = state.belief.merge(told)
    if belief is state.belief:
        return state
    learned = tuple((*t.source, t.upto if isinstance(t, Checkpoint) else t.seq) for t in told)
    return replace(state, belief=belief, dirty=True, because=(*state.because, *learned))


def _joined(state: AgentState, event: ev.Joined, _now: float) -> Step:
    return replace(state, incarnation=event.incarnation), []


def _link_lost(state: AgentState, _event: ev.LinkLost, now: float) -> Step:
    return ruled(replace(state, lost=True), now)


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
        return compared(state, decide(state), now)
    except Unreachable as error:
        return _no_way(replace(state, dirty=False, because=(), trouble=str(error)))


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
    state = replace(state, pending=None, failed_swaps=failed, trouble=event.reason)
    state = replace(state, speed_m_s=UNKNOWN_M_S)  # whether it has changed its mode on the way, nobody knows
    if event.is_late:
        state = replace(state, swap_times=state.swap_times.too_late())
    if state.phase in ON_GROUND:
        return replace(state, phase=Phase.FAILED, outcome=event.reason), []
    if event.flying == "theirs" and state.phase in IN_FLIGHT:
        return let_go(state, event.reason)
    state = replace(state, hold_is_ours=event.flying == "hold")
    if state.phase is Phase.LANDING and event.flying != "old":
        # Over its goal and standing still: there is nothing left to plan.
        return command(state, ev.Order.LAND)
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
    ev.Observed: _observed,
    ev.Heard: _heard,
    ev.Neighbours: neighbours_heard,
    ev.Intents: _intents,
    ev.SpeedFailed: speed_failed,
    ev.MissionAccepted: _mission_accepted,
    ev.MissionFailed: _mission_failed,
    ev.OrderDone: _order_done,
    ev.OrderFailed: _order_failed,
    ev.LinkLost: _link_lost,
    ev.LinkRestored: _link_restored,
    ev.OperatorCommand: operator,
    ev.WeightsChanged: weights_changed,
    ev.Rebooted: _rebooted,
    ev.Tick: _tick,
}
