"""Which route meets a time bound, whether the one being flown still does, and what to say where none does."""

from __future__ import annotations

import math
from dataclasses import replace

from swarmctl.agent.bounds import CHANGE_S, Underway, Window, before_takeoff, window
from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.core.exposure import length_cells
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.planners.base import BoundTooTight, Problem, Route, is_open

BETTER_BY = 1e-9
"""A new route must beat the one being flown by this share of its cost: rounding alone swaps no mission."""

HALF_CELL = 0.5
"""A vehicle is over its goal cell by so much before the centre, to which lengths are counted [cells]."""


def bounds_of(task: Task, underway: Underway) -> Window:
    """What the task's time bound leaves for the length of a route."""
    return window(task.arrival, task.grid.cell_size_m, underway)


def underway_to(state: AgentState, start: Cell, ahead: tuple[Cell, ...] | None) -> Underway:
    """How far a vehicle is that is to fly a route from `start`: counted along the route it flies, if that
    leads there (`ahead`), else over the centre of `start`."""
    task, vehicle = state.task, state.vehicle
    if state.launched_boot_s is None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return before_takeoff(task.arrival, task.altitude_m)
    grid, here = task.grid, (vehicle.lat_deg, vehicle.lon_deg)
    lead_m = distance_m(here, grid.centre(start))
    if ahead is not None and len(ahead) > 1 and state.cell == start:
        step_m = math.dist(ahead[0], ahead[1]) * grid.cell_size_m
        lead_m = distance_m(here, grid.centre(ahead[1])) - step_m
    elapsed_s = max(vehicle.time_boot_s - state.launched_boot_s, 0.0)
    return Underway(elapsed_s, max(task.altitude_m - (vehicle.alt_rel_m or 0.0), 0.0), lead_m)


def change_cells(state: AgentState, start: Cell, underway: Underway) -> float:
    """What it costs to change the mission now [cells]: the time that takes, and the way back to the centre of
    the cell where the new route begins."""
    task, vehicle = state.task, state.vehicle
    if state.phase is not Phase.FLYING or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return 0.0
    back_m = distance_m((vehicle.lat_deg, vehicle.lon_deg), task.grid.centre(start)) - underway.lead_m
    return (CHANGE_S * task.arrival.speed_m_s + back_m) / task.grid.cell_size_m


def route_in_time(task: Task, problem: Problem, change: float = 0.0) -> Route:
    """The best route that meets the bounds although it costs `change` [cells] to begin it, else one that
    meets them at least without. Raises Unreachable; BoundTooTight where there is none."""
    bounds = _bounds(problem)
    if change > 0.0 and not math.isinf(bounds.max_cells):
        try:
            return task.method.plan(replace(problem, max_length_cells=bounds.less(change).max_cells))
        except BoundTooTight as error:
            if bounds.misses_by(error.nearest.length_cells) == 0.0:
                return error.nearest
    return task.method.plan(problem)


def is_no_worse(task: Task, problem: Problem, ahead: tuple[Cell, ...], route: Route, change: float) -> bool:
    """Whether a vehicle may as well fly on (`ahead`) as change to a route, which costs `change` [cells]. Of
    two that miss the bounds that one is better that misses them less."""
    if not is_open(problem, ahead):
        return False
    bounds = _bounds(problem)
    misses = bounds.misses_by(length_cells(ahead))
    would_miss = bounds.less(change).misses_by(route.length_cells)
    if misses > 0.0 or would_miss > 0.0:
        return misses <= would_miss
    return task.method.measure(problem, ahead) <= route.cost * (1.0 + BETTER_BY)


def lateness(state: AgentState, problem: Problem, underway: Underway, length: float) -> str:
    """What to say of a vehicle whose route, `length` cells long, does not meet its bound; the same as long as
    that is so. Empty where it does."""
    arrival = state.task.arrival
    if _bounds(problem).misses_by(length) <= HALF_CELL:
        return ""
    arrives_s = underway.arrives_s(arrival, (length - HALF_CELL) * state.task.grid.cell_size_m)
    text = f"no route meets its bound of {arrival} any more; over its goal after {arrives_s:.1f} s"
    return state.late or text


def _bounds(problem: Problem) -> Window:
    return Window(problem.min_length_cells, problem.max_length_cells)
