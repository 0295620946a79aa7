"""Which route, and whether it is worth changing the mission for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.bounds import Underway, before_takeoff
from swarmctl.agent.in_time import (
    ahead_lost_s,
    bounds_of,
    change_cells,
    is_no_worse,
    lateness_s,
    route_in_time,
    route_lost_s,
    underway_to,
)
from swarmctl.agent.realise import index_abreast, pulled, realised, track_holds
from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure, length_cells
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.base import BoundTooTight, Problem, Route

_STEPS = {(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)}


def decide(state: AgentState) -> tuple[AgentState, list[ev.Effect]]:
    """Plan with all that is known; change the mission if that brings something."""
    p_s = believed_exposure(state.task, state.belief, state.strength)
    return _decide_from(state, p_s, _planning_start(state))


def _decide_from(
    state: AgentState, p_s: NDArray[np.float64], start: Cell
) -> tuple[AgentState, list[ev.Effect]]:
    task = replace(state.task, altitude_m=state.height_m)
    ahead = _cells_ahead(state, start)
    underway = underway_to(state, start, ahead)
    problem = _problem(task, p_s, start, state.w, underway)
    change = change_cells(state, start, underway)
    try:
        route = route_in_time(task, problem, change)
    except BoundTooTight as error:
        route = error.nearest  # a vehicle that is late is not stopped for it
    lost_s = 0.0 if ahead is None else ahead_lost_s(state, start, ahead)
    keeps = ahead is not None and is_no_worse(task, problem, ahead, route, change, lost_s)
    keeps = keeps and track_holds(state, p_s, start) and not state.must_change
    if not keeps and state.cell not in (None, start) and _is_on_track(state):
        # So far the route was looked at from abreast of the vehicle; a new one begins at the vehicle.
        return _decide_from(replace(state, searches=state.searches + 1), p_s, state.cell)
    length = length_cells(ahead) if ahead is not None and keeps else route.length_cells
    lost_s = lost_s if keeps else route_lost_s(task, route.cells)
    late_s = lateness_s(state, problem, underway, length, lost_s)
    state = replace(
        state, exposure=p_s, searches=state.searches + 1, dirty=False, planned=route, late_s=late_s
    )
    if keeps:
        return replace(state, held=p_s, because=()), []
    track = pulled(task, problem, route)
    flown = route if track is None else track
    swap = ev.SwapMission(
        plan_id=state.next_plan_id,
        plan=realised(task, p_s, route, track, _position(state)),
        cells=route.cells,
        because=state.because,
        cost=route.cost,
        exposure_sum=flown.exposure_sum,
        safety_factor=flown.safety_factor,
        length_m=flown.length_cells * task.grid.cell_size_m,
        track=track,
    )
    state = replace(state, pending=swap, because=(), next_plan_id=state.next_plan_id + 1, must_change=False)
    return state, [swap]


def believed_exposure(task: Task, belief: Belief, strength: FiringStrength) -> NDArray[np.float64]:
    """P_s (rows, cols), Eq. 3 over Eq. 4; infinite where flying is forbidden."""
    p_s = exposure(belief.occupancy(), strength)
    for cell in task.no_fly:
        p_s[cell] = math.inf
    return p_s


def first_route(task: Task, belief: Belief, w: float | None = None) -> Route:
    """The route from the entry cell, as planned before anything is flown. Raises Unreachable; BoundTooTight
    where no route meets the task's bound."""
    return route_in_time(task, first_problem(task, belief, w))


def first_problem(task: Task, belief: Belief, w: float | None = None) -> Problem:
    """What a planner is asked before anything is flown."""
    p_s = believed_exposure(task, belief, task.strength)
    underway = before_takeoff(task.arrival, task.altitude_m)
    return _problem(task, p_s, task.entry, task.w if w is None else w, underway)


def first_flight(task: Task, problem: Problem, route: Route) -> FlightPlan:
    """The mission for a route from the entry cell that answers `first_problem`. Raises Unreachable where a
    vehicle that needs room to turn cannot fly it."""
    return realised(task, problem.exposure, route, pulled(task, problem, route))


def _problem(task: Task, p_s: NDArray[np.float64], start: Cell, w: float, underway: Underway) -> Problem:
    bounds = bounds_of(task, underway)
    return Problem(
        p_s,
        start,
        task.goals,
        w,
        task.psi_per_cell,
        task.max_exposure,
        bounds.min_cells,
        bounds.max_cells,
    )


def _planning_start(state: AgentState) -> Cell:
    """The cell it is over; the entry before it is in the area; the next one where it only cuts a corner."""
    cell = state.cell
    if cell is None:
        in_flight = state.phase is Phase.FLYING and state.flown_cells
        return state.flown_cells[-1] if in_flight else state.task.entry
    if state.route is None:
        return cell
    if (index := index_abreast(state.route, cell, state.progress)) is not None:
        return state.route.cells[index]
    if cell not in state.route.cells:
        between = state.route.cells[state.progress : state.progress + 2]
        if len(between) == 2 and all((a - cell[0], b - cell[1]) in _STEPS for a, b in between):
            return between[1]
    return cell


def _cells_ahead(state: AgentState, start: Cell) -> tuple[Cell, ...] | None:
    """What remains of the route being flown, from `start`; None if it does not lead there."""
    if state.route is None or start not in state.route.cells:
        return None
    return state.route.cells[state.route.cells.index(start) :]


def _is_on_track(state: AgentState) -> bool:
    """Whether the vehicle is over a track that stands for its route."""
    swap, cell = state.route, state.cell
    return swap is not None and swap.track is not None and cell in swap.track.over


def _position(state: AgentState) -> LatLon | None:
    vehicle = state.vehicle
    if state.phase is Phase.FLYING and vehicle.lat_deg is not None and vehicle.lon_deg is not None:
        return vehicle.lat_deg, vehicle.lon_deg
    return None
