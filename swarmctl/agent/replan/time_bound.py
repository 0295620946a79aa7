"""Which route meets a time bound, whether the one being flown still does, and what to say where none does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from swarmctl.agent.replan.length_bounds import LeadIn, LengthBounds, before_takeoff, change_s, length_bounds
from swarmctl.agent.replan.splice import Splice
from swarmctl.agent.replan.travel_time import lost_s
from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.core.exposure import length_cells
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.planar import PlanarPoint
from swarmctl.planners.base import BoundTooTight, Problem, Route, is_open

BETTER_BY = 1e-9
"""A new route must beat the one being flown by this share of its cost: rounding alone swaps no mission."""

MAX_TRIES = 5
"""searches for a route that meets its bound with its turns, of which the last is for the shortest"""

HALF_CELL = 0.5
"""A vehicle is over its goal cell by so much before the centre, to which lengths are counted [cells]."""


def bounds_of(task: Task, underway: LeadIn) -> LengthBounds:
    """What the task's time bound leaves for the length of a route."""
    return length_bounds(task.arrival, task.grid.cell_size_m, underway)


@dataclass(frozen=True, slots=True)
class EntryLeg:
    """How a vehicle comes to where its new route begins."""

    path: tuple[PlanarPoint, ...] = ()
    """from where it is to before that (east, north) [m]"""
    begins_m_s: float = 0.0


FROM_A_STOP = EntryLeg()


def entry_leg(state: AgentState, branch: Splice) -> EntryLeg:
    """How a vehicle comes onto a route that leaves its old one there, after the swap."""
    flies_on = state.swap_times.stop_s == 0.0 and state.vehicle.brakes_m_s2 is None
    return EntryLeg(branch.path, state.vehicle.ground_speed_m_s if branch.leaves_ahead and flies_on else 0.0)


def lead_in_to(
    state: AgentState, start: Cell, ahead: tuple[Cell, ...] | None, branch: Splice | None = None
) -> LeadIn:
    """How far a vehicle is that is to fly a route from `start`: counted along the route it flies, if that
    leads there (`branch`, `ahead`), else over the centre of `start`."""
    task, vehicle = state.task, state.vehicle
    if state.launched_boot_s is None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return before_takeoff(task.arrival, task.altitude_m)
    grid, here = task.grid, (vehicle.lat_deg, vehicle.lon_deg)
    lead_m = distance_m(here, grid.centre(start))
    if branch is not None and branch.leaves_ahead:
        lead_m = branch.lead_m
    elif ahead is not None and len(ahead) > 1 and state.cell == start:
        step_m = math.dist(ahead[0], ahead[1]) * grid.cell_size_m
        lead_m = distance_m(here, grid.centre(ahead[1])) - step_m
    elapsed_s = max(vehicle.time_boot_s - state.launched_boot_s, 0.0)
    return LeadIn(elapsed_s, max(task.altitude_m - (vehicle.alt_rel_m or 0.0), 0.0), lead_m)


def change_cells(state: AgentState, start: Cell, underway: LeadIn, branch: Splice | None = None) -> float:
    """What it costs to change the mission now [cells]: the time for which that makes the vehicle stand, and
    the way back to the centre of the cell where the new route begins, if it does not lie ahead."""
    task, vehicle = state.task, state.vehicle
    if state.phase is not Phase.FLYING or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return 0.0
    back_m = 0.0
    if branch is None or not branch.leaves_ahead:
        back_m = distance_m((vehicle.lat_deg, vehicle.lon_deg), task.grid.centre(start)) - underway.lead_m
    stands_s = change_s(task.arrival, state.swap_times.stop_s, vehicle.brakes_m_s2)
    return (stands_s * task.arrival.speed_m_s + back_m) / task.grid.cell_size_m


def route_lost_s(task: Task, cells: Sequence[Cell], begun: EntryLeg = FROM_A_STOP) -> float:
    """What a vehicle with a time bound loses on a route over these cells, and on its way there [s]; for one
    without, whose speed need not be known, nothing is reckoned. A track pulled straight from the route turns
    less, so that is early."""
    centres = [task.grid.centre_m(cell) for cell in cells]
    return _lost_s(task, [*begun.path, *centres], begun.begins_m_s)


def arrives_s(task: Task, length: float, cells: Sequence[Cell]) -> float:
    """When a vehicle on the ground will be over its goal, `length` [cells] over these, from its take-off."""
    underway = before_takeoff(task.arrival, task.altitude_m)
    return underway.arrives_s(task.arrival, length * task.grid.cell_size_m, route_lost_s(task, cells))


def misses_by(
    task: Task, bounds: LengthBounds, length: float, cells: Sequence[Cell], begun: EntryLeg = FROM_A_STOP
) -> float:
    """How far outside its bounds a route is, `length` [cells] over these, with what is lost at its turns."""
    return bounds.misses_by(length, _in_cells(task, route_lost_s(task, cells, begun)))


def ahead_lost_s(
    state: AgentState, start: Cell, ahead: Sequence[Cell], branch: Splice | None = None
) -> float:
    """The same for what remains of the route being flown, from where the vehicle is and as fast as it is."""
    task, vehicle = state.task, state.vehicle
    if branch is not None and branch.leaves_ahead:
        return route_lost_s(task, ahead, EntryLeg(branch.path, vehicle.ground_speed_m_s))
    if state.launched_boot_s is None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return route_lost_s(task, ahead)
    over = ahead[1:] if state.cell == start and len(ahead) > 1 else ahead
    here = task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    return _lost_s(task, [here, *(task.grid.centre_m(cell) for cell in over)], vehicle.ground_speed_m_s)


def _lost_s(task: Task, track: Sequence[tuple[float, float]], begins_m_s: float) -> float:
    if math.isinf(task.arrival.within_s):
        return 0.0
    half_m = HALF_CELL * task.grid.cell_size_m
    return lost_s(track, task.arrival.speed_m_s, begins_m_s=begins_m_s, ends_m=half_m)


def _in_cells(task: Task, seconds: float) -> float:
    return seconds * task.arrival.speed_m_s / task.grid.cell_size_m


def route_within_bounds(
    task: Task, problem: Problem, change: float = 0.0, begun: EntryLeg = FROM_A_STOP
) -> Route:
    """The best route that meets the bounds although it costs `change` [cells] to begin it, else one that
    meets them at least without. Raises Unreachable; BoundTooTight where none was found."""
    bounds = _bounds(problem)
    if math.isinf(bounds.max_cells):
        return task.method.plan(problem)
    if change > 0.0:
        try:
            return _with_turns(task, problem, bounds.less(change).max_cells, begun)
        except BoundTooTight as error:
            if _misses_by(task, bounds, error.nearest, begun) == 0.0:
                return error.nearest
    return _with_turns(task, problem, bounds.max_cells, begun)


def _with_turns(task: Task, problem: Problem, latest_cells: float, begun: EntryLeg) -> Route:
    """A route that with what it loses at its turns is no longer than this. Planners bound length alone, so
    the bound is drawn in by what the route they find loses, until one fits; at last the shortest is tried."""
    bounds = LengthBounds(problem.min_length_cells, latest_cells)
    greatest, seen = latest_cells, list[Route]()
    for tries in range(MAX_TRIES):
        if tries == MAX_TRIES - 1 or greatest < bounds.min_cells:
            greatest = bounds.min_cells
        try:
            route = task.method.plan(replace(problem, max_length_cells=greatest))
        except BoundTooTight as error:
            route, greatest = error.nearest, bounds.min_cells
        if _misses_by(task, bounds, route, begun) == 0.0:
            return route
        seen.append(route)
        if greatest == bounds.min_cells:
            break
        greatest = latest_cells - _in_cells(task, route_lost_s(task, route.cells, begun))
    nearest = min(seen, key=lambda route: _misses_by(task, bounds, route, begun))
    lost = _in_cells(task, route_lost_s(task, nearest.cells, begun))
    text = f"no route is at most {latest_cells:.2f} cells long with what it loses at its turns: the nearest "
    text += f"one takes {nearest.length_cells:.2f} and loses {lost:.2f}; allow as much"
    raise BoundTooTight(text, nearest)


def _misses_by(task: Task, bounds: LengthBounds, route: Route, begun: EntryLeg) -> float:
    return misses_by(task, bounds, route.length_cells, route.cells, begun)


def is_no_worse(
    task: Task,
    problem: Problem,
    ahead: tuple[Cell, ...],
    route: Route,
    change: float,
    lost_s: float = 0.0,
    begun: EntryLeg = FROM_A_STOP,
) -> bool:
    """Whether a vehicle may as well fly on (`ahead`, where it loses `lost_s`) as change to a route, which
    costs `change` [cells]. Of two that miss the bounds that one is better that misses them less."""
    if not is_open(problem, ahead):
        return False
    bounds = _bounds(problem)
    misses = bounds.misses_by(length_cells(ahead), _in_cells(task, lost_s))
    would_miss = _misses_by(task, bounds.less(change), route, begun)
    if misses > 0.0 or would_miss > 0.0:
        return misses <= would_miss
    return task.method.measure(problem, ahead) <= route.cost * (1.0 + BETTER_BY)


def lateness_s(
    state: AgentState, problem: Problem, underway: LeadIn, length: float, lost_s: float
) -> float | None:
    """When a vehicle is over its goal whose route, `length` cells long, does not meet its bound [s]; None
    where it does, or misses it by less than what is reckoned too much."""
    task = state.task
    if _bounds(problem).misses_by(length, _in_cells(task, lost_s)) <= HALF_CELL:
        return None
    length_m = length * task.grid.cell_size_m
    slow_s = underway.arrives_s(task.arrival, length_m, lost_s)
    if slow_s > task.arrival.within_s:
        return slow_s
    # Too early: however well it turns, and at the edge of its goal cell.
    edge_m = length_m - HALF_CELL * task.grid.cell_size_m
    return underway.arrives_s(task.arrival, edge_m) - underway.lost_s


def _bounds(problem: Problem) -> LengthBounds:
    return LengthBounds(problem.min_length_cells, problem.max_length_cells)
