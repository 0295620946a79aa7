"""The choice of a route, and the decision to keep or change the mission."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.formation.group_planner import first_method, planner_of
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.length_bounds import LeadIn, before_takeoff
from swarmctl.agent.replan.route_to_mission import (
    is_track_still_good,
    mission_for,
    pulled_track,
)
from swarmctl.agent.replan.spare_time import with_spare_time
from swarmctl.agent.replan.splice import Splice, splice_on_route, splice_on_track
from swarmctl.agent.replan.time_bound import (
    JoiningLeg,
    ahead_lost_s,
    arrival_outside_bound_s,
    bounds_of,
    is_no_worse,
    joining_leg,
    lead_in_to,
    route_lost_s,
    route_within_bounds,
    swap_cost_cells,
)
from swarmctl.agent.state import AgentState, Task
from swarmctl.core import events as ev
from swarmctl.core.any_angle.pull import Track
from swarmctl.core.belief import Belief, weighed_occupancy
from swarmctl.core.exposure import exposure, length_cells
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.base import BoundTooTight, Problem, Route, route_of
from swarmctl.planners.benevolence import OtherVehicle, cell_gains


def decide(state: AgentState) -> tuple[AgentState, list[ev.Effect]]:
    """Plan a route from the present belief; change the mission if the new route is better or required."""
    p_s = believed_exposure(state.task, state.belief, state.strength, state.own)
    return _decide_from(state, p_s, splice_on_route(state, p_s))


def _decide_from(
    state: AgentState, p_s: NDArray[np.float64], splice: Splice, *, leaves_track: bool = False
) -> tuple[AgentState, list[ev.Effect]]:
    """Plan a route from a splice point; `leaves_track`: the splice point is on a straightened track."""
    start, joining = splice.kept[-1], joining_leg(state, splice)
    task = replace(state.task, altitude_m=state.height_m, method=planner_of(state, start))
    task = with_spare_time(state, task)
    if splice.leaves_ahead and start in task.goals and not state.plans.must_change:
        # The vehicle would reach its goal before the end of a swap.
        return replace(state, plans=state.plans.kept(p_s)), []
    present = state.plans.mission
    ahead = None if present is None or splice.index is None else present.cells[splice.index :]
    lead_in = lead_in_to(state, splice)
    gain = route_gains(task, p_s, state.belief, state.strength, state.w, state.others, state.own)
    problem = problem_from(task, p_s, start, state.w, lead_in, gain)
    lost_s = 0.0 if ahead is None else ahead_lost_s(state, ahead, splice)
    swap_cost = swap_cost_cells(state, lead_in, splice)
    route, keeps = choose_route(task, problem, ahead, swap_cost, lost_s, joining)
    is_track_good = leaves_track or not keeps or is_track_still_good(state, p_s)
    keeps = keeps and is_track_good and not state.plans.must_change
    is_on_track = present is not None and present.track is not None and splice.index is not None
    if not keeps and not leaves_track and task.wings is None and is_on_track and state.cell is not None:
        # This search began beside the vehicle, but a new route begins at a splice point ahead: search again.
        plans = state.plans.searched_beside(must_change=not is_track_good)
        return _decide_from(replace(state, plans=plans), p_s, splice_on_track(state, p_s), leaves_track=True)
    length = length_cells(ahead) if ahead is not None and keeps else route.length_cells
    lost_s = lost_s if keeps else route_lost_s(task, route.cells, joining)
    is_bounded = state.task.arrival.is_bounded
    late_s = arrival_outside_bound_s(state, problem, lead_in, length, lost_s) if is_bounded else None
    plans = state.plans.searched(p_s, route, late_s)
    if keeps:
        return replace(state, plans=plans.kept(p_s)), []
    route = _with_kept_cells(task, problem, route, splice)
    # A lattice route is left at a cell's centre, so the new route begins on the lattice, too.
    on_lattice = splice.leaves_ahead and not splice.lead_waypoints
    track = None if on_lattice else pulled_track(task, problem, route)
    position = _position_in_flight(state)
    plan = mission_for(task, p_s, route, track, position, splice)
    if position is not None:
        begins = Waypoint(*position, state.height_m)
        plan = replace(plan, begins=begins, from_hold=state.plans.hold_is_own)
    swap = swap_to(state, plan, route, track, state.plans.because)
    return replace(state, plans=plans.sent(swap, state.vehicle.time_boot_s)), [swap]


def swap_to(
    state: AgentState,
    plan: FlightPlan,
    route: Route,
    track: Track | None = None,
    because: tuple[ev.ObservationId, ...] = (),
) -> ev.SwapMission:
    """Return the change to a mission that flies a route, or its straightened track."""
    flown = route if track is None else track
    return ev.SwapMission(
        plan_id=state.plans.next_plan_id,
        plan=plan,
        cells=route.cells,
        because=because,
        cost=route.cost,
        exposure_sum=flown.exposure_sum,
        safety_factor=flown.safety_factor,
        length_m=flown.length_cells * state.task.grid.cell_size_m,
        track=track,
        split=route.split,
    )


def choose_route(
    task: Task,
    problem: Problem,
    ahead: tuple[Cell, ...] | None,
    swap_cost: float = 0.0,
    lost_s: float = 0.0,
    joining: JoiningLeg | None = None,
) -> tuple[Route, bool]:
    """Return the best route found, and whether the rest of the present route, `ahead`, is as good.

    `ahead` is None for a vehicle without a route. The other arguments are those of `is_no_worse`. Raises
    Unreachable.
    """
    try:
        route = route_within_bounds(task, problem, swap_cost, joining)
    except BoundTooTight as error:
        route = error.nearest  # a late vehicle flies the best route found
    return route, ahead is not None and is_no_worse(task, problem, ahead, route, swap_cost, lost_s, joining)


def _with_kept_cells(task: Task, problem: Problem, route: Route, splice: Splice) -> Route:
    """Return the kept cells of the old route and the new route as one route, measured as a whole."""
    if len(splice.kept) == 1:
        return route
    cells = (*splice.kept[:-1], *route.cells)
    unbounded = replace(problem, start=cells[0], min_length_cells=0.0, max_length_cells=math.inf)
    cost = math.inf if route.split is not None else task.method.measure(unbounded, cells)
    whole = route_of(unbounded, cells, cost if math.isfinite(cost) else route.cost)
    return replace(whole, split=route.split)


def believed_exposure(
    task: Task, belief: Belief, strength: FiringStrength, own: Belief | None = None
) -> NDArray[np.float64]:
    """Return P_s (rows, cols), Eq. 3 over Eq. 4; infinite for no-fly cells.

    `own` is the belief by the vehicle's own observations, for a vehicle with autonomy; None: `belief`.
    """
    p_s = exposure(weighed_occupancy(belief, own or belief, task.autonomy), strength)
    for cell in task.no_fly:
        p_s[cell] = math.inf
    return p_s


def route_gains(
    task: Task,
    p_s: NDArray[np.float64],
    belief: Belief,
    strength: FiringStrength,
    w: float,
    others: Mapping[int, OtherVehicle],
    own: Belief | None = None,
) -> NDArray[np.float64] | None:
    """Return b·g(n), (rows, cols), the gain of each cell for the other vehicles; None without benevolence.

    `p_s` is the `believed_exposure` by the same beliefs.
    """
    if task.benevolence == 0.0 or not others:
        return None
    passable = np.where(p_s > task.max_exposure, math.inf, p_s)
    p_occupied = weighed_occupancy(belief, own or belief, task.autonomy)
    return task.benevolence * cell_gains(
        p_occupied, passable, strength, others.values(), w, task.psi_per_cell
    )


def first_route(task: Task, belief: Belief) -> Route:
    """Return the route from the entry cell, as planned before the flight.

    The route of a group's first member is the group's. Raises Unreachable, or BoundTooTight if no route meets
    the task's time bound.
    """
    task = replace(task, method=first_method(task))
    return route_within_bounds(task, first_problem(task, belief))


def first_problem(task: Task, belief: Belief) -> Problem:
    """Return the planning problem before the flight."""
    p_s = believed_exposure(task, belief, task.strength)
    lead_in = before_takeoff(task.arrival, task.altitude_m, task.start_delay_s)
    gain = route_gains(task, p_s, belief, task.strength, task.w, task.others)
    return problem_from(task, p_s, task.entry, task.w, lead_in, gain)


def first_flight(task: Task, problem: Problem, route: Route) -> FlightPlan:
    """Return the mission for a route from the entry cell that solves `first_problem`.

    Raises Unreachable if the route has no room for the vehicle's turns, or its end no room for the landing.
    """
    return mission_for(task, problem.exposure, route, pulled_track(task, problem, route))


def problem_from(
    task: Task,
    p_s: NDArray[np.float64],
    start: Cell,
    w: float,
    lead_in: LeadIn,
    gain: NDArray[np.float64] | None = None,
) -> Problem:
    """Return the planning problem from a cell that the vehicle reaches after `lead_in`."""
    bounds = bounds_of(task, lead_in)
    return task.problem(
        p_s, start, w, min_length_cells=bounds.min_cells, max_length_cells=bounds.max_cells, gain=gain
    )


def _position_in_flight(state: AgentState) -> LatLon | None:
    return state.vehicle.lat_lon if state.phase is Phase.FLYING else None
