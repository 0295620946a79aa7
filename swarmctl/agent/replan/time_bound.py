"""Routes within a time bound: the search, the check of the present route, and arrivals outside the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.length_bounds import (
    LeadIn,
    LengthBounds,
    before_takeoff,
    length_bounds,
    swap_loss_s,
)
from swarmctl.agent.replan.splice import Splice
from swarmctl.agent.replan.travel_time import lost_s
from swarmctl.agent.state import AgentState, Task
from swarmctl.core.exposure import length_cells
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace
from swarmctl.planners.base import BoundTooTight, Problem, Route, is_open

BETTER_COST_SHARE = 1e-9
"""Share of cost by which a new route must beat the present route, so that rounding causes no swap."""

MAX_TRIES = 5
"""Greatest number of searches for a route within its bound; the last search is for the shortest route."""

HALF_CELL = 0.5
"""Least distance from the edge of the goal cell to its centre [cells]; lengths count to the centre."""


def bounds_of(task: Task, lead_in: LeadIn) -> LengthBounds:
    """Return the bounds on the length of a route after `lead_in`, by the task's time bound."""
    return length_bounds(task.arrival, task.grid.cell_size_m, lead_in)


class Departure(msgspec.Struct, frozen=True):
    """The flight of a vehicle to the start of a new route, and what it costs to leave the present one."""

    start_delay_s: float | None = None
    """delay of the vehicle's start from a stand [s]; None: that of the task"""
    path: tuple[PlanarPoint, ...] = ()
    """points from the vehicle on, without the start of the route"""
    initial_m_s: float = 0.0
    """speed at the first point [m/s]"""
    swap_cost_cells: float = 0.0
    """cost of the swap: the standstill, and the flight back to the start of the new route [cells]"""
    ahead_lost_s: float = 0.0
    """time lost at turns on the rest of the present route [s]"""


FROM_GROUND = Departure()


def departure_at(
    state: AgentState, splice: Splice, lead_in: LeadIn, ahead: Sequence[Cell] | None
) -> Departure:
    """Return the departure at a splice point from a present route with the rest `ahead`."""
    flies_on = state.plans.swap_times.stop_s == 0.0 and state.vehicle.brakes_m_s2 is None
    return Departure(
        state.vehicle.start_delay_s,
        splice.path,
        state.vehicle.ground_speed_m_s if splice.leaves_ahead and flies_on else 0.0,
        swap_cost_cells(state, lead_in, splice),
        0.0 if ahead is None else _ahead_lost_s(state, ahead, splice),
    )


def lead_in_to(state: AgentState, splice: Splice) -> LeadIn:
    """Return the lead-in of a vehicle to a route from the last cell of `splice`.

    The distance is measured along the present route if that route leads to the cell, otherwise straight to
    the cell's centre.
    """
    task, vehicle = state.task, state.vehicle
    if state.launch.armed_boot_s is None or vehicle.lat_lon is None:
        return before_takeoff(task.arrival, task.altitude_m, vehicle.start_delay_s)
    if splice.leaves_ahead:
        lead_m = splice.lead_m
    elif splice.index is not None and state.progress is not None:
        lead_m = state.progress.to_centre_m(splice.index)
    else:
        lead_m = _to_centre_m(state, splice)
    elapsed_s = max(vehicle.time_boot_s - state.launch.armed_boot_s, 0.0)
    return LeadIn(elapsed_s, max(task.altitude_m - (vehicle.alt_rel_m or 0.0), 0.0), lead_m)


def _to_centre_m(state: AgentState, splice: Splice) -> float:
    """Return the straight distance of a vehicle with a position to the last cell of `splice` [m]."""
    assert state.vehicle.lat_lon is not None
    return distance_m(state.vehicle.lat_lon, state.task.grid.centre(splice.kept[-1]))


def swap_cost_cells(state: AgentState, lead_in: LeadIn, splice: Splice) -> float:
    """Return the cost of a swap now [cells]: the standstill, and the flight back to the new route's start.

    A vehicle whose new route begins ahead does not fly back. On the ground the cost is 0.
    """
    task, vehicle = state.task, state.vehicle
    if state.phase is not Phase.FLYING or vehicle.lat_lon is None:
        return 0.0
    back_m = 0.0 if splice.leaves_ahead else _to_centre_m(state, splice) - lead_in.lead_m
    stands_s = swap_loss_s(task.arrival, state.plans.swap_times.stop_s, vehicle.brakes_m_s2)
    return (stands_s * task.speed_m_s + back_m) / task.grid.cell_size_m


def route_lost_s(task: Task, cells: Sequence[Cell], departure: Departure = FROM_GROUND) -> float:
    """Return the time that a vehicle loses at turns on a route over these cells and on the flight to it [s].

    The result is 0 if there is no latest arrival. A straightened track turns less than its route, so a
    vehicle on a track is earlier.
    """
    if math.isinf(task.arrival.within_s):
        return 0.0
    track = [*departure.path, *(task.grid.centre_m(cell) for cell in cells)]
    delay_s = task.start_delay_s if departure.start_delay_s is None else departure.start_delay_s
    half_m = HALF_CELL * task.grid.cell_size_m
    return lost_s(
        track,
        task.speed_m_s,
        initial_m_s=departure.initial_m_s,
        remaining_m=half_m,
        start_delay_s=delay_s,
    )


def arrives_s(task: Task, length: float, cells: Sequence[Cell]) -> float:
    """Return the arrival time after take-off [s], for a route over `cells` of this length [cells]."""
    lead_in = before_takeoff(task.arrival, task.altitude_m, task.start_delay_s)
    return lead_in.arrives_s(task.arrival, length * task.grid.cell_size_m, route_lost_s(task, cells))


def misses_by(
    task: Task,
    bounds: LengthBounds,
    length: float,
    cells: Sequence[Cell],
    departure: Departure = FROM_GROUND,
) -> float:
    """Return the distance of a route over `cells` from its bounds [cells], with the time lost at turns."""
    return bounds.misses_by(length, _in_cells(task, route_lost_s(task, cells, departure)))


def _ahead_lost_s(state: AgentState, ahead: Sequence[Cell], splice: Splice) -> float:
    """Return the time lost at turns on the rest of the present route, begun at the present speed [s]."""
    task, progress, delay_s = state.task, state.progress, state.vehicle.start_delay_s
    speed_m_s = state.vehicle.ground_speed_m_s
    if splice.leaves_ahead:
        return route_lost_s(task, ahead, Departure(delay_s, splice.path, speed_m_s))
    if state.launch.armed_boot_s is None or progress is None:
        return route_lost_s(task, ahead, Departure(delay_s))
    over = ahead[1:] if splice.index == progress.cell_index and len(ahead) > 1 else ahead
    return route_lost_s(task, over, Departure(delay_s, (progress.here,), speed_m_s))


def _in_cells(task: Task, seconds: float) -> float:
    return seconds * task.speed_m_s / task.grid.cell_size_m


def route_within_bounds(task: Task, problem: Problem, departure: Departure = FROM_GROUND) -> Route:
    """Return a route that meets the bounds even with the cost of the swap.

    If no such route is found, the result meets the bounds without that cost. Raises Unreachable, or
    BoundTooTight if the search finds no such route either.
    """
    bounds = _bounds(problem)
    if math.isinf(bounds.max_cells):
        return task.method.plan(problem)
    if departure.swap_cost_cells > 0.0:
        try:
            return _plan_with_turn_losses(
                task, problem, bounds.with_reserve(departure.swap_cost_cells).max_cells, departure
            )
        except BoundTooTight as error:
            if _misses_by(task, bounds, error.nearest, departure) == 0.0:
                return error.nearest
    return _plan_with_turn_losses(task, problem, bounds.max_cells, departure)


def _plan_with_turn_losses(task: Task, problem: Problem, latest_cells: float, departure: Departure) -> Route:
    """Return a route of at most `latest_cells`, with the time lost at turns counted as length.

    Planners bound the length alone. So the loss of each route found sets the bound of the next search, until
    a route fits. The last search is for the shortest route. Raises BoundTooTight.
    """
    bounds = LengthBounds(problem.min_length_cells, latest_cells)
    greatest, seen = latest_cells, list[Route]()
    for tries in range(MAX_TRIES):
        if tries == MAX_TRIES - 1 or greatest < bounds.min_cells:
            greatest = bounds.min_cells
        try:
            route = task.method.plan(replace(problem, max_length_cells=greatest))
        except BoundTooTight as error:
            route, greatest = error.nearest, bounds.min_cells
        if _misses_by(task, bounds, route, departure) == 0.0:
            return route
        seen.append(route)
        if greatest == bounds.min_cells:
            break
        greatest = latest_cells - _in_cells(task, route_lost_s(task, route.cells, departure))
    nearest = min(seen, key=lambda route: _misses_by(task, bounds, route, departure))
    lost = _in_cells(task, route_lost_s(task, nearest.cells, departure))
    text = f"no route found is at most {latest_cells:.2f} cells long with the loss at turns; the nearest "
    text += (
        f"has {nearest.length_cells:.2f} cells and loses {lost:.2f}; allow a later arrival or a higher speed"
    )
    raise BoundTooTight(text, nearest)


def _misses_by(task: Task, bounds: LengthBounds, route: Route, departure: Departure) -> float:
    return misses_by(task, bounds, route.length_cells, route.cells, departure)


def is_no_worse(
    task: Task,
    problem: Problem,
    ahead: tuple[Cell, ...],
    route: Route,
    departure: Departure,
) -> bool:
    """Return whether the rest of the present route, `ahead`, is open and at least as good as a new route.

    If either route misses the bounds, the route that misses the bounds by less is better.
    """
    if not is_open(problem, ahead):
        return False
    bounds = _bounds(problem)
    misses = bounds.misses_by(length_cells(ahead), _in_cells(task, departure.ahead_lost_s))
    would_miss = _misses_by(task, bounds.with_reserve(departure.swap_cost_cells), route, departure)
    if misses > 0.0 or would_miss > 0.0:
        return misses <= would_miss
    return task.method.measure(problem, ahead) <= route.cost * (1.0 + BETTER_COST_SHARE)


def arrival_outside_bound_s(
    state: AgentState, problem: Problem, lead_in: LeadIn, length: float, lost_s: float
) -> float | None:
    """Return the arrival time after the take-off [s]; None for a route that meets the time bound.

    The route is `length` [cells] long. A miss of half a cell or less counts as met, because the losses are
    estimated high.
    """
    task = state.task
    if _bounds(problem).misses_by(length, _in_cells(task, lost_s)) <= HALF_CELL:
        return None
    length_m = length * task.grid.cell_size_m
    arrival_s = lead_in.arrives_s(task.arrival, length_m, lost_s)
    if arrival_s > task.arrival.within_s:
        return arrival_s
    # For the earliest arrival, the route ends at the edge of the goal cell, and no time is lost.
    edge_m = length_m - HALF_CELL * task.grid.cell_size_m
    return lead_in.arrives_s(task.arrival, edge_m) - lead_in.lost_s


def _bounds(problem: Problem) -> LengthBounds:
    return LengthBounds(problem.min_length_cells, problem.max_length_cells)
