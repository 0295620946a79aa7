"""The policy of one vehicle: `step(state, event, now) -> (state, effects)`. Pure.

Nothing here waits, reads a clock or talks to anybody. New information only marks the plan dirty; the next
`Tick` plans once with all of it, and a changed plan becomes one `SwapMission`, of which at most one is under
way. Whatever happens meanwhile waits for its end, and the newest belief wins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmctl.core import events as ev
from swarmctl.core.belief import UNKNOWN, Belief, Observation
from swarmctl.core.exposure import exposure, exposure_sum, length_cells
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.messages import ObservationShared, StateShared
from swarmctl.core.mission import FlightPlan
from swarmctl.core.route import flight_plan, landing_spot
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import VehicleState
from swarmctl.planners.base import Problem, Route

SHARE_STATE_EVERY_S = 1.0
RETRY_AFTER_S = 5.0
MAX_FAILED_SWAPS = 3
BETTER_BY = 1e-9
"""A new route must beat the one being flown by this share of its cost: rounding alone swaps no mission."""

STEPS = {(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)}


class Phase(StrEnum):
    """Where a vehicle is in its flight."""

    WAITING = "waiting"
    """not ready yet"""
    UPLOADING = "uploading"
    """ready; its first mission is planned or on its way"""
    STANDBY = "standby"
    """on the ground with a verified mission"""
    LAUNCHING = "launching"
    FLYING = "flying"
    LANDING = "landing"
    """over its goal, coming down"""
    HOLDING = "holding"
    """by order"""
    LEAVING = "leaving"
    """returning or landing by order"""
    RELEASED = "released"
    """a pilot, a failsafe or another station has taken it over: it is not fought for"""
    DONE = "done"
    FAILED = "failed"


ENDED = frozenset({Phase.RELEASED, Phase.DONE, Phase.FAILED})
ON_GROUND = frozenset({Phase.WAITING, Phase.UPLOADING, Phase.STANDBY})
IN_FLIGHT = frozenset({Phase.FLYING, Phase.LANDING, Phase.HOLDING, Phase.LEAVING})
PLANNING = frozenset({Phase.UPLOADING, Phase.STANDBY, Phase.FLYING})


@dataclass(frozen=True, slots=True)
class Task:
    """What one vehicle has to do and by which rules; constant during a run."""

    uav: int
    name: str
    grid: Grid
    strength: FiringStrength
    w: float
    psi_per_cell: float
    entry: Cell
    goals: tuple[Cell, ...]
    altitude_m: float
    """flown at, above home [m]"""
    plan: Callable[[Problem], Route] = field(repr=False)
    no_fly: frozenset[Cell] = frozenset()
    landing_index: int = 0
    landing_count: int = 1
    """which of how many landing spots in the goal cell is this vehicle's"""
    fallback: ev.Order = ev.Order.RETURN
    """what it does when its mission cannot be changed any more"""


@dataclass(frozen=True, slots=True)
class AgentState:
    """Everything an agent knows; replaced, never changed, by `step`."""

    task: Task
    belief: Belief
    phase: Phase = Phase.WAITING
    vehicle: VehicleState = field(default_factory=VehicleState)
    cell: Cell | None = None
    """the cell of the area it is over; None outside or unknown"""
    lost: bool = False
    route: ev.SwapMission | None = None
    """the plan the vehicle holds"""
    progress: int = 0
    """index in `route.cells` of the cell it was last seen over"""
    pending: ev.SwapMission | None = None
    """the plan on its way to the vehicle"""
    dirty: bool = False
    because: tuple[ev.ObservationId, ...] = ()
    """observations merged since the last decision"""
    exposure: NDArray[np.float64] | None = None
    """P_s as of the last decision, (rows, cols)"""
    retry_at_s: float = -math.inf
    failed_swaps: int = 0
    """in a row"""
    launch_ordered: bool = False
    next_seq: int = 1
    next_plan_id: int = 1
    last_shared_s: float = -math.inf
    searches: int = 0
    replans: int = 0
    """missions changed in flight"""
    flown_m: float = 0.0
    flown_cells: tuple[Cell, ...] = ()
    flown_exposure: float = 0.0
    """ΣP_s over the cells entered, each as believed when the vehicle decided to enter it"""
    flown_safety: float = 1.0
    """∏(1 − P_s) over the same"""
    refused: int = 0
    """observations of others that cannot be"""
    given_up: bool = False
    """it is coming down because its mission could not be flown"""
    outcome: str = ""
    """how it ended, or what is wrong, in words"""

    @property
    def ended(self) -> bool:
        return self.phase in ENDED


Step = tuple[AgentState, list[ev.Effect]]


def begin(task: Task, belief: Belief) -> AgentState:
    return AgentState(task=task, belief=belief)


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
    return replace(state, phase=phase, pending=None, dirty=False, outcome=f"{order} ordered"), [
        ev.Command(order)
    ]


def _launch_if_possible(state: AgentState) -> Step:
    if state.phase is Phase.STANDBY and state.launch_ordered and state.pending is None:
        return replace(state, phase=Phase.LAUNCHING), [ev.Command(ev.Order.LAUNCH)]
    return state, []


def _order_done(state: AgentState, event: ev.OrderDone, _now: float) -> Step:
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
    if not state.vehicle.armed:
        return replace(state, phase=Phase.FAILED, outcome=reason), []
    # Armed and not seen to climb: it must not be left to itself.
    return replace(state, phase=Phase.LEAVING, given_up=True, outcome=reason), [ev.Command(ev.Order.LAND)]


# --- what the vehicle, its sensor and the others say


def _telemetry(state: AgentState, event: ev.TelemetryReceived, _now: float) -> Step:
    vehicle = event.state
    if not vehicle.has_position:
        return replace(state, vehicle=vehicle), []
    state = _moved(state, vehicle)
    if state.phase in IN_FLIGHT and not vehicle.armed:
        state = _touched_down(state)
    elif state.phase in (Phase.FLYING, Phase.LANDING) and not vehicle.under_our_control:
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
    return replace(state, lost=False), []


# --- deciding


def _tick(state: AgentState, _event: ev.Tick, now: float) -> Step:
    if not wants_tick(state, now):
        return state, []
    return decide(state)


def decide(state: AgentState) -> Step:
    """Plan with all that is known; change the mission if that brings something."""
    task = state.task
    p_s = believed_exposure(task, state.belief)
    start = _planning_start(state)
    route = task.plan(Problem(p_s, start, task.goals, task.w, task.psi_per_cell))
    ahead = _cells_ahead(state, start)
    state = replace(state, exposure=p_s, searches=state.searches + 1, dirty=False)
    if ahead is not None and edge_costs(task, p_s, ahead) <= route.cost * (1.0 + BETTER_BY):
        return replace(state, because=()), []
    swap = ev.SwapMission(
        plan_id=state.next_plan_id,
        plan=_flight_plan(state, route.cells, p_s),
        cells=route.cells,
        because=state.because,
        cost=route.cost,
        exposure_sum=route.exposure_sum,
        safety_factor=route.safety_factor,
        length_m=route.length_cells * task.grid.cell_size_m,
    )
    return replace(state, pending=swap, because=(), next_plan_id=state.next_plan_id + 1), [swap]


def believed_exposure(task: Task, belief: Belief) -> NDArray[np.float64]:
    """P_s (rows, cols), Eq. 3 over Eq. 4; infinite where flying is forbidden."""
    p_s = exposure(belief.occupancy(), task.strength)
    for cell in task.no_fly:
        p_s[cell] = math.inf
    return p_s


def first_route(task: Task, belief: Belief, w: float | None = None) -> Route:
    """The route from the entry cell, as planned before anything is flown."""
    p_s = believed_exposure(task, belief)
    return task.plan(Problem(p_s, task.entry, task.goals, task.w if w is None else w, task.psi_per_cell))


def edge_costs(task: Task, p_s: NDArray[np.float64], cells: tuple[Cell, ...]) -> float:
    """Σ C_mn along `cells` (Eq. 5)."""
    distance = (1.0 - task.w) * task.psi_per_cell * length_cells(cells)
    return distance + (task.w * exposure_sum(p_s, cells) if task.w > 0.0 else 0.0)


def _planning_start(state: AgentState) -> Cell:
    """The cell it is over; the entry before it is in the area; the next one where it only cuts a corner."""
    cell = state.cell
    if cell is None:
        in_flight = state.phase is Phase.FLYING and state.flown_cells
        return state.flown_cells[-1] if in_flight else state.task.entry
    if state.route is not None and cell not in state.route.cells:
        between = state.route.cells[state.progress : state.progress + 2]
        if len(between) == 2 and all((a - cell[0], b - cell[1]) in STEPS for a, b in between):
            return between[1]
    return cell


def _cells_ahead(state: AgentState, start: Cell) -> tuple[Cell, ...] | None:
    """What remains of the route being flown, from `start`; None if it does not lead there."""
    if state.route is None or start not in state.route.cells:
        return None
    return state.route.cells[state.route.cells.index(start) :]


def _flight_plan(state: AgentState, cells: tuple[Cell, ...], p_s: NDArray[np.float64]) -> FlightPlan:
    task, vehicle = state.task, state.vehicle
    position = None
    if state.phase is Phase.FLYING and vehicle.lat_deg is not None and vehicle.lon_deg is not None:
        position = (vehicle.lat_deg, vehicle.lon_deg)

    def may_clip(cell: Cell) -> bool:
        # DEVIATION: a vehicle past the centre of its cell would fly back to it to turn off diagonally. It
        # cuts the corner instead where the cell it passes over is no worse than the two it flies between.
        return bool(p_s[cell] <= max(p_s[cells[0]], p_s[cells[1]]))

    return flight_plan(
        task.grid,
        cells,
        altitude_m=task.altitude_m,
        landing_lat_lon=landing_spot(task.grid, cells[-1], task.landing_index, task.landing_count),
        position=position,
        may_clip=may_clip,
    )


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
        return state, [ev.Command(ev.Order.LAND)]
    if state.phase is not Phase.FLYING:
        return state, []
    if state.failed_swaps >= MAX_FAILED_SWAPS:
        return replace(state, phase=Phase.LEAVING, given_up=True), [ev.Command(state.task.fallback)]
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
