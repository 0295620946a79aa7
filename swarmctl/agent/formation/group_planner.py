"""The planner of a group's leader, and where its route changes the shape. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.formation.membership import Formation
from swarmctl.agent.formation.shape import assigned
from swarmctl.agent.formation.split import is_formed, with_split
from swarmctl.agent.phases import ON_GROUND
from swarmctl.agent.state import AgentState, Task
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.split import SplitPlan
from swarmctl.planners import formation as planner
from swarmctl.planners import split_route
from swarmctl.planners.base import Method, Problem, Unreachable

OTHER_SHAPE = 0.1
"""Cost of a cell of length in another shape than the first, in lengths of a vehicle: without it a group would
keep its narrow shape after a passage."""
WHILE_FORMING = 10.0
"""Price of a change of shape while members still fly to their places, as a multiple."""


def planner_of(state: AgentState, start: Cell | None = None) -> Method:
    """Return the vehicle's planner; for the leader of a group, and on the ground for the first member, the
    group's planner.

    start: the cell in flight at which the plan begins; without it the plan has no split
    """
    formation, membership = state.task.formation, state.membership
    if formation is None:
        return state.task.method
    if state.phase in ON_GROUND:
        return first_method(state.task)
    if membership.n_present == 1 or not state.leads_group:
        return state.task.method
    heading_deg = None
    if membership.route is not None and membership.along is not None:
        heading = membership.route.reference.at(membership.along.s_m).heading_rad
        heading_deg = math.degrees(heading) % 360.0
    formed = is_formed(state)
    members, shape = membership.with_places, membership.shape
    method = _method(state.task, formation, members, heading_deg, shape, is_formed=formed)
    return with_split(state, method, start, is_formed=formed)


def first_method(task: Task) -> Method:
    """Return the planner of a vehicle's first route: for the first member of a group, the group's planner."""
    formation = task.formation
    if formation is None or not leads_first(task):
        return task.method
    return _method(task, formation, formation.members)


def leads_first(task: Task) -> bool:
    """Return whether a vehicle is the first member of a group."""
    return task.formation is not None and task.uav == task.formation.members[0]


def _method(
    task: Task,
    formation: Formation,
    present: Sequence[int],
    heading_deg: float | None = None,
    shape: int | None = None,
    *,
    is_formed: bool = True,
) -> Method:
    """Return the planner of a group of these vehicles, which the task's vehicle leads.

    heading_deg: heading of a group under way; None before the first route in flight
    shape: number of the present shape; None on the ground

    is_formed: False for a group whose members still fly to their places

    A change of shape costs the way that a vehicle flies meanwhile.
    """
    cell_m = task.grid.cell_size_m
    numbers = assigned([uav in present for uav in formation.members], closes_up=formation.closes_up)
    own = numbers[formation.members.index(task.uav)]
    others = [number for number in numbers if number is not None and number != own]
    shapes = []
    for k in range(len(formation.shapes)):
        places = formation.places(k, len(present))
        forward_m, right_m, _ = places[own or 0]
        offsets = ((places[i][0] - forward_m, places[i][1] - right_m) for i in others)
        shapes.append(((0.0, 0.0), *((f / cell_m, r / cell_m) for f, r in offsets)))
    change_cells = formation.change_m(len(present)) / cell_m * (1.0 if is_formed else WHILE_FORMING)
    params = planner.Params(
        tuple(shapes),
        formation.exposure,
        change_cost=change_cells * task.psi_per_cell,
        other_shape_cost=OTHER_SHAPE * task.psi_per_cell,
        start_heading_deg=heading_deg,
        start_shape=shape,
    )
    return Method("formation", planner, params)


def shape_changes(
    takes_m: float,
    method: Method,
    problem: Problem,
    cells: Sequence[Cell],
    centres_m: Sequence[float],
    before: int = 0,
    split: SplitPlan | None = None,
) -> list[tuple[float, int]]:
    """Return the changes of shape on a route of the group: (distance along it [m], number from there on).

    takes_m: length of the route on which the members take their places in another shape [m]
    centres_m: distance along the route to the centre of each cell [m]
    before: number of the shape at the first cell
    split: the split in which the members fly these cells up to the meeting; its shape is taken half-way

    The planner changes the shape at the centre before the cell that the group reaches in its new shape. The
    members need time for it, so a change to the narrow shape begins as much earlier; a change back does not.
    A route that the group cannot fly in any shape has no changes.
    """
    params = method.params.group if method.planner is split_route else method.params
    if method.planner not in (planner, split_route) or len(params.shapes) == 1:
        return []
    changes: list[tuple[float, int]] = []
    if split is not None:
        first, meets = (cells.index(split.routes[0][k]) for k in (0, -1))
        if split.shape != before:
            changes, before = [(0.5 * (centres_m[first] + centres_m[meets]), split.shape)], split.shape
        cells, centres_m, problem = cells[meets:], centres_m[meets:], replace(problem, start=cells[meets])
        params = replace(params, start_heading_deg=None, start_shape=before)
    try:
        numbers = planner.shapes_along(problem, cells, params)
    except Unreachable:
        return changes
    for at_m, number in zip(centres_m, numbers[1:], strict=False):
        if number != before:
            begin_m = at_m - takes_m if number else at_m
            if changes and begin_m <= changes[-1][0]:
                changes.pop()  # no time for the shape between
            changes.append((begin_m, number))
            before = number
    return changes
