"""New routes of a group whose leader follows set-points. Pure.

A leader that follows set-points needs no mission: the group follows the new route from the next point ahead
on. A leader that flies its mission changes its route by a new mission, if its vehicle flies on meanwhile.
Otherwise it follows set-points from then on.
"""

from __future__ import annotations

import math
from itertools import accumulate, pairwise

from swarmctl.agent.commands import StepResult, command
from swarmctl.agent.formation.group_planner import planner_of, shape_changes
from swarmctl.agent.formation.membership import GroupRoute, Membership
from swarmctl.agent.formation.split import cells_along, split_in_metres
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.decide import believed_exposure
from swarmctl.agent.replan.splice import GROUP_TURNS_AFTER_S, is_wall_close, may_learn_of_walls
from swarmctl.agent.replan.time_bound import BETTER_COST_SHARE
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.planners import split_route
from swarmctl.planners.base import Method, Problem, Route, Unreachable

BEHIND_M = 100.0
"""Length of the route behind the group that is kept [m]."""


def plan_of_leader(state: AgentState) -> StepResult | None:
    """Plan for a leader on its mission that would stop for a new one; None for any other vehicle.

    It flies a better route by set-points, so its group does not stop.
    """
    formation, membership = state.task.formation, state.membership
    if formation is None or not formation.approach.LEADER_FLIES_MISSION or not state.flies_mission:
        return None
    if not state.leads_group or membership.n_present == 1 or membership.along is None:
        return None
    if state.vehicle.brakes_m_s2 is None or state.plans.must_change or state.alarms:
        return None
    planned = plan_in_formation(state)
    assert planned.plans.exposure is not None
    if may_learn_of_walls(state) and is_wall_close(state, planned.plans.exposure):
        return None  # a new mission leaves the route at once
    if planned.membership.route is membership.route:
        return planned, []
    planned, ordered = command(planned, ev.FlightOrder.FORMATION, phase=Phase.FORMATION)
    text = f"the vehicle leads group {formation.name} on by set-points: for a new mission it would stop"
    return planned, [ev.NotifyOperator(f"{text} [leads-on]"), *ordered]


def plan_in_formation(state: AgentState) -> AgentState:
    """Return the state after a look at the new observations: the leader plans the group's route anew."""
    task, membership = state.task, state.membership
    p_s = believed_exposure(task, state.belief, state.strength, state.own)
    state = replace(state, plans=state.plans.observed(p_s))
    route, along = membership.route, membership.along
    if not state.leads_group or route is None or along is None or membership.n_present == 1:
        return state
    least_m = along.s_m + max(GROUP_TURNS_AFTER_S * along.speed_m_s, 1.0)
    ahead = [(at_m, cell) for at_m, cell in cells_along(task.grid, route.reference.legs) if at_m >= least_m]
    if len(ahead) < 2:
        return state
    splice_m, start = ahead[0]
    method, problem = planner_of(state, start), task.problem(p_s, start, state.w)
    if route.split_at(splice_m) is not None and method.planner is not split_route:
        return state  # only the leader that planned a split knows the members' routes
    try:
        found = method.plan(problem)
    except Unreachable as error:
        return replace(state, trouble=str(error))
    state = state.without_trouble()
    rest = [cell for _, cell in ahead]
    present = method.measure(problem, rest) if rest[-1] in task.goals else math.inf
    if present <= found.cost * (1.0 + BETTER_COST_SHARE):
        return state
    return replace(state, membership=_on_new_route(state, route, splice_m, found, method, problem))


def _on_new_route(
    state: AgentState,
    route: GroupRoute,
    splice_m: float,
    found: Route,
    method: Method,
    problem: Problem,
) -> Membership:
    """Return the membership with a route that turns off at `splice_m`; before it all stays the same."""
    membership, task, formation = state.membership, state.task, state.task.formation
    assert formation is not None
    memory = membership.memory
    assert memory is not None
    legs, along = route.reference.legs, memory.along
    kept = [
        (at_m, point)
        for at_m, point in zip(legs.at_m, legs.points, strict=True)
        if along.s_m - BEHIND_M <= at_m < splice_m
    ]
    before_m = max((at_m for at_m in legs.at_m if at_m < along.s_m - BEHIND_M), default=None)
    if before_m is not None:
        kept.insert(0, (before_m, legs.point_at(before_m)))
    moved_m, cell_m, cells, plan = kept[0][0], task.grid.cell_size_m, found.cells, found.split
    centres = (task.grid.centre_m(cell) for cell in cells)
    points_m = (*(point for _, point in kept), *centres)
    shapes = [(from_m - moved_m, number) for from_m, number in route.shapes if from_m < splice_m]
    splice_m -= moved_m
    steps_m = (cell_m * math.dist(a, b) for a, b in pairwise(cells))
    centres_m = tuple(accumulate(steps_m, initial=splice_m))
    before = shapes[-1][1] if shapes else 0
    takes_m = formation.change_m(membership.n_present)
    shapes += shape_changes(takes_m, method, problem, cells, centres_m, before, plan)
    number, split = membership.n_routes + 1, route.split_at(along.s_m)
    if plan is not None:
        split = split_in_metres(state, plan, along.s_m - moved_m, centres_m[len(plan.routes[0])])
    elif split is not None:
        split = split.moved(-moved_m)
    speed_m_s = task.speed_m_s
    new = GroupRoute.of(task.uav, number, points_m, tuple(shapes), formation, speed_m_s, split=split)
    return replace(
        membership,
        route=new,
        memory=replace(memory, along=replace(along, s_m=along.s_m - moved_m)),
        sent_boot_s=-math.inf,
        n_routes=number,
    )
