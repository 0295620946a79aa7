"""The choice of a route, and the decision to keep or change the mission."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.formation.group_planner import first_method, planner_of
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.length_bounds import LeadIn, before_takeoff
from swarmctl.agent.replan.plans import Plans
from swarmctl.agent.replan.route_to_mission import is_track_still_good, mission_for, pulled_track
from swarmctl.agent.replan.spare_time import with_spare_time
from swarmctl.agent.replan.splice import Splice, splice_on_route, splice_on_track
from swarmctl.agent.replan.time_bound import (
    FROM_GROUND,
    Departure,
    arrival_outside_bound_s,
    bounds_of,
    departure_at,
    is_no_worse,
    lead_in_to,
    route_lost_s,
    route_within_bounds,
)
from swarmctl.agent.state import AgentState, Task
from swarmctl.core.any_angle.pull import Track
from swarmctl.core.belief import Belief, weighed_occupancy
from swarmctl.core.exposure import exposure, length_cells
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.observation import ObservationId
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.base import BoundTooTight, Problem, Route, route_of
from swarmctl.planners.benevolence import OtherVehicle, cell_gains


def decide(state: AgentState) -> tuple[Plans, PlannedMission | None]:
    """Plan a route from the present belief. Return the plans after the decision, and the new mission.

    The new mission is None if the vehicle keeps its present one. Raises Unreachable.
    """
    p_s = believed_exposure(state.task, state.belief, state.strength, state.own)
    splice = splice_on_route(state, p_s)
    if _reaches_goal_first(state, splice):
        return state.plans.kept(p_s), None
    choice = _choose(state, p_s, splice)
    is_track_worse = choice.keeps and not is_track_still_good(state, p_s)
    keeps = choice.keeps and not is_track_worse
    if not keeps and _is_beside_track(state, splice):
        # This search began beside the vehicle, but a new route begins at a splice point ahead: search again.
        state = replace(state, plans=state.plans.searched_beside(must_change=is_track_worse))
        splice = splice_on_track(state, p_s)
        if _reaches_goal_first(state, splice):
            return state.plans.kept(p_s), None
        choice = _choose(state, p_s, splice)
        keeps = choice.keeps
    plans = state.plans.searched(p_s, choice.route, _late_s(state, choice, keeps=keeps))
    if keeps:
        return plans.kept(p_s), None
    mission = _mission_from(state, p_s, choice)
    return plans.changing_to(mission, state.vehicle.time_boot_s), mission


class _Choice(msgspec.Struct, frozen=True):
    """The best route found from a splice point, beside the rest of the present route."""

    splice: Splice
    task: Task
    """the task with the method and the time bound of this search"""
    problem: Problem
    lead_in: LeadIn
    departure: Departure
    ahead: tuple[Cell, ...] | None
    """rest of the present route; None: the splice point is not on a present route"""
    route: Route
    keeps: bool
    """True: the rest of the present route is as good, and it need not change"""


def _choose(state: AgentState, p_s: NDArray[np.float64], splice: Splice) -> _Choice:
    """Plan a route from a splice point, and compare it with the rest of the present route."""
    start = splice.kept[-1]
    task = replace(state.task, altitude_m=state.height_m, method=planner_of(state, start))
    task = with_spare_time(state, task)
    present = state.plans.mission
    ahead = None if present is None or splice.index is None else present.cells[splice.index :]
    lead_in = lead_in_to(state, splice)
    gain = route_gains(task, p_s, state.belief, state.strength, state.w, state.others, state.own)
    problem = problem_from(task, p_s, start, state.w, lead_in, gain)
    departure = departure_at(state, splice, lead_in, ahead)
    route, keeps = choose_route(task, problem, ahead, departure)
    keeps = keeps and not state.plans.must_change
    return _Choice(splice, task, problem, lead_in, departure, ahead, route, keeps)


def _reaches_goal_first(state: AgentState, splice: Splice) -> bool:
    """Return whether the vehicle would reach its goal before the end of a swap that need not be."""
    is_at_goal = splice.leaves_ahead and splice.kept[-1] in state.task.goals
    return is_at_goal and not state.plans.must_change


def _is_beside_track(state: AgentState, splice: Splice) -> bool:
    """Return whether a search began beside a copter that flies a straightened track."""
    present = state.plans.mission
    is_on_track = present is not None and present.track is not None and splice.index is not None
    return is_on_track and state.task.wings is None and state.cell is not None


def _late_s(state: AgentState, choice: _Choice, *, keeps: bool) -> float | None:
    """Return the predicted arrival after the take-off [s]; None for an arrival within the time bound."""
    if not state.task.arrival.is_bounded:
        return None
    if keeps and choice.ahead is not None:
        length, lost_s = length_cells(choice.ahead), choice.departure.ahead_lost_s
    else:
        length = choice.route.length_cells
        lost_s = route_lost_s(choice.task, choice.route.cells, choice.departure)
    return arrival_outside_bound_s(state, choice.problem, choice.lead_in, length, lost_s)


def _mission_from(state: AgentState, p_s: NDArray[np.float64], choice: _Choice) -> PlannedMission:
    """Return the mission of a new route, with the kept part of the present one."""
    splice, task, problem = choice.splice, choice.task, choice.problem
    route = _with_kept_cells(task, problem, choice.route, splice)
    # A lattice route is left at a cell's centre, so the new route begins on the lattice, too.
    on_lattice = splice.leaves_ahead and not splice.lead_waypoints
    track = None if on_lattice else pulled_track(task, problem, route)
    position = state.vehicle.lat_lon if state.phase is Phase.FLYING else None
    plan = mission_for(task, p_s, route, track, position, splice)
    if position is not None:
        begins = Waypoint(*position, state.height_m)
        plan = replace(plan, begins=begins, from_hold=state.plans.hold_is_own)
    return planned_mission(state, plan, route, track, state.plans.because)


def planned_mission(
    state: AgentState,
    plan: FlightPlan,
    route: Route,
    track: Track | None = None,
    because: tuple[ObservationId, ...] = (),
) -> PlannedMission:
    """Return the mission that flies a route, or its straightened track."""
    flown = route if track is None else track
    return PlannedMission(
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
    task: Task, problem: Problem, ahead: tuple[Cell, ...] | None, departure: Departure = FROM_GROUND
) -> tuple[Route, bool]:
    """Return the best route found, and whether the rest of the present route, `ahead`, is as good.

    `ahead` is None for a vehicle without a route. Raises Unreachable.
    """
    try:
        route = route_within_bounds(task, problem, departure)
    except BoundTooTight as error:
        route = error.nearest  # a late vehicle flies the best route found
    return route, ahead is not None and is_no_worse(task, problem, ahead, route, departure)


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
