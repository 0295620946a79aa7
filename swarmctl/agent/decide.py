"""Which route, and whether it is worth changing the mission for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan
from swarmctl.core.route import flight_plan, landing_spot
from swarmctl.planners.base import Problem, Route

BETTER_BY = 1e-9
"""A new route must beat the one being flown by this share of its cost: rounding alone swaps no mission."""

_STEPS = {(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)}


def decide(state: AgentState) -> tuple[AgentState, list[ev.Effect]]:
    """Plan with all that is known; change the mission if that brings something."""
    task = state.task
    p_s = believed_exposure(task, state.belief)
    start = _planning_start(state)
    problem = _problem(task, p_s, start, task.w)
    route = task.method.plan(problem)
    ahead = _cells_ahead(state, start)
    state = replace(state, exposure=p_s, searches=state.searches + 1, dirty=False)
    if ahead is not None and task.method.measure(problem, ahead) <= route.cost * (1.0 + BETTER_BY):
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
    w = task.w if w is None else w
    return task.method.plan(_problem(task, p_s, task.entry, w))


def _problem(task: Task, p_s: NDArray[np.float64], start: Cell, w: float) -> Problem:
    return Problem(p_s, start, task.goals, w, task.psi_per_cell, max_exposure=task.max_exposure)


def _planning_start(state: AgentState) -> Cell:
    """The cell it is over; the entry before it is in the area; the next one where it only cuts a corner."""
    cell = state.cell
    if cell is None:
        in_flight = state.phase is Phase.FLYING and state.flown_cells
        return state.flown_cells[-1] if in_flight else state.task.entry
    if state.route is not None and cell not in state.route.cells:
        between = state.route.cells[state.progress : state.progress + 2]
        if len(between) == 2 and all((a - cell[0], b - cell[1]) in _STEPS for a, b in between):
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
        return math.isfinite(p_s[cell]) and bool(p_s[cell] <= max(p_s[cells[0]], p_s[cells[1]]))

    return flight_plan(
        task.grid,
        cells,
        altitude_m=task.altitude_m,
        landing_lat_lon=landing_spot(task.grid, cells[-1], task.landing_index, task.landing_count),
        position=position,
        may_clip=may_clip,
    )
