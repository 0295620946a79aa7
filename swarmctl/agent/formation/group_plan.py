"""New routes of a group whose leader follows set-points. Pure.

A leader that flies its mission changes its route like every vehicle, by a new mission. A leader that follows
set-points needs no mission: the group follows the new route from the next point ahead on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.formation.group_planner import planner_of, shape_changes
from swarmctl.agent.formation.membership import GroupRoute, Membership
from swarmctl.agent.replan.decide import believed_exposure
from swarmctl.agent.state import AgentState
from swarmctl.core.frames import MAX_POINTS
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners.base import Method, Problem, Unreachable

AHEAD_S = 4.0
"""Time ahead at which a new route may turn off [s]: the shape turns that much later at the latest."""
BEHIND_M = 100.0
"""Length of the route behind the group that is kept [m]."""


def plan_in_formation(state: AgentState) -> AgentState:
    """Return the state after a look at the new observations: the leader plans the group's route anew."""
    task, membership = state.task, state.membership
    p_s = believed_exposure(task, state.belief, state.strength, state.own)
    state = replace(state, plans=state.plans.kept(p_s))
    route, along = membership.route, membership.along
    if not state.leads_group or route is None or along is None or membership.n_present == 1:
        return state
    legs = route.reference.legs
    least_m = along.s_m + max(AHEAD_S * along.speed_m_s, 1.0)
    index = next((i for i, at_m in enumerate(legs.at_m) if at_m >= least_m), None)
    if index is None:
        return state
    cells = [task.grid.cell_at(*task.grid.frame.to_geodetic(*point)) for point in legs.points[index:]]
    start, ahead = cells[0], _through(cells)
    if start is None:
        return state
    method, problem = planner_of(state), _problem(state, p_s, start)
    try:
        found = method.plan(problem)
    except Unreachable as error:
        return replace(state, trouble=str(error))
    present = math.inf if ahead is None or ahead[-1] not in task.goals else method.measure(problem, ahead)
    if present <= found.cost * (1.0 + 1e-9):
        return state
    return replace(state, membership=_on_new_route(state, route, index, found.cells, method, problem))


def _problem(state: AgentState, p_s: NDArray[np.float64], start: Cell) -> Problem:
    task = state.task
    return Problem(p_s, start, task.goals, state.w, task.psi_per_cell, task.max_exposure)


def _through(cells: Sequence[Cell | None]) -> tuple[Cell, ...] | None:
    """Return the lattice route over corners of a route, or None if a corner is outside the area."""
    route: list[Cell] = []
    for cell in cells:
        if cell is None:
            return None
        while route and route[-1] != cell:
            (row, col), (to_row, to_col) = route[-1], cell
            route.append((row + _sign(to_row - row), col + _sign(to_col - col)))
        if not route:
            route.append(cell)
    return tuple(route)


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)


def _on_new_route(
    state: AgentState,
    route: GroupRoute,
    index: int,
    cells: Sequence[Cell],
    method: Method,
    problem: Problem,
) -> Membership:
    """Return the membership with a route that turns off at point `index`; behind it all stays the same."""
    membership, task, formation = state.membership, state.task, state.task.formation
    assert formation is not None
    assert membership.along is not None
    legs, along = route.reference.legs, membership.along
    first = next(i for i, at_m in enumerate(legs.at_m) if at_m >= along.s_m - BEHIND_M or i == index)
    moved_m = legs.at_m[first]
    centres = [task.grid.centre_m(cell) for cell in cells[1:]]
    points_m = (*legs.points[first : index + 1], *centres)[:MAX_POINTS]
    splice_m, cell_m = legs.at_m[index] - moved_m, task.grid.cell_size_m
    shapes = [(from_m - moved_m, number) for from_m, number in route.shapes if from_m < splice_m + moved_m]
    steps_m = (cell_m * math.dist(a, b) for a, b in pairwise(cells))
    centres_m = tuple(accumulate(steps_m, initial=splice_m))
    shapes += shape_changes(state, method, problem, cells, centres_m, shapes[-1][1] if shapes else 0)
    number = membership.n_routes + 1
    new = GroupRoute.of(task.uav, number, points_m, tuple(shapes), formation, task.arrival.speed_m_s)
    memory = membership.memory
    return replace(
        membership,
        route=new,
        along=replace(along, s_m=along.s_m - moved_m),
        memory=memory and replace(memory, s_m=memory.s_m - moved_m),
        route_sent_boot_s=-math.inf,
        n_routes=number,
    )
