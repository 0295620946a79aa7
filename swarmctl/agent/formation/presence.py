"""Presence: which members are in a vehicle's group, which one leads, and by which route. Pure.

`note_group` comes first at each telemetry message. Present members keep apart by
`approaches.place_keeping.keep_separation`, so the rules for other traffic do not see them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.commands import StepResult
from swarmctl.agent.formation.approaches.place_keeping import on_new_route
from swarmctl.agent.formation.group_planner import planner_of, shape_changes
from swarmctl.agent.formation.membership import Formation, GroupRoute, Membership
from swarmctl.agent.formation.near_members import JOINS_WITHIN_M, near_members, with_members_hidden
from swarmctl.agent.formation.split import split_in_metres
from swarmctl.agent.formation.ways import SplitStretch
from swarmctl.agent.phases import EN_ROUTE, Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.frames import MemberShared
from swarmctl.core.planar import PlanarPoint, contains
from swarmctl.core.records import replace

LOW_M, ON_ITS_WAY_M = 1.5, 3.0
"""Height below its cruise height, and distance along its route, up to which a vehicle still takes off [m]."""
AT_END_M = 1.0
"""Distance before the end of the group's way at which the group ends; the group is slow there [m]."""
REJOINS_AFTER_S = 10.0
"""Time from leaving a group until the vehicle may join again [s]."""


def receive_messages(state: AgentState, told: Sequence[tuple[int, float, MemberShared]]) -> AgentState:
    """Store messages of the group: (UAV, age of the message [s], message)."""
    membership = state.membership.with_messages(told, state.now_boot_s, state.task.grid.frame)
    return replace(state, membership=membership)


def note_group(state: AgentState) -> StepResult:
    """Note the present members and the leader, and hide present members from the rules for other traffic.

    A vehicle that begins to lead in place of another one reports it.
    """
    formation, before = state.task.formation, state.membership
    if formation is None:
        return state, []
    heard = near_members(state, formation, formation.lost_after_s) if _belongs(state) else ()
    if not heard or _is_without_way(state, formation, heard):
        if before.present:
            state = replace(state, membership=replace(before, present=()))
        return with_members_hidden(state), []
    with_places = near_members(state, formation, formation.keeps_place_s)
    membership = replace(before, present=heard, with_places=with_places)
    if membership.n_present != before.n_present:
        membership = replace(membership, n_present_since_boot_s=state.now_boot_s)
    if len(weights := _told_weights(membership)) == len(formation.approach.WEIGHTS) > 0:
        membership = replace(membership, weights=weights)
    membership = _with_route(state, formation, membership)
    if _is_at_end(state, formation, membership):
        membership = replace(membership, is_over=True, present=())
    effects: list[ev.Effect] = []
    led = before.leader
    if led is not None and led != state.task.uav and membership.leader == state.task.uav:
        text = f"the vehicle leads group {formation.name} now, in place of {state.task.name_of(led)}"
        effects = [ev.NotifyOperator(f"{text} [new-leader]")]
    return with_members_hidden(replace(state, membership=membership)), effects


def _belongs(state: AgentState) -> bool:
    """Return whether the vehicle is in its group, or may lead or join it now."""
    vehicle, membership = state.vehicle, state.membership
    if state.phase not in EN_ROUTE or state.is_waiting or state.lost or membership.is_over:
        return False
    if not vehicle.armed or not vehicle.has_position or vehicle.alt_amsl_m is None:
        return False
    if state.phase is Phase.FORMATION:
        return True
    if state.plans.mission is None or state.progress is None:
        return False
    is_on_its_way = state.plans.replans > 0 or state.progress.along_m >= ON_ITS_WAY_M
    has_climbed = (vehicle.alt_rel_m or 0.0) >= state.height_m - LOW_M
    return is_on_its_way and has_climbed and vehicle.time_boot_s - membership.left_boot_s >= REJOINS_AFTER_S


def _is_without_way(state: AgentState, formation: Formation, heard: Sequence[int]) -> bool:
    """Return whether the group flies apart without a way for this vehicle, whose place may be in a wall.

    heard: the members that would be present, this vehicle included
    """
    uav, membership = state.task.uav, state.membership
    route, along = membership.route, membership.along
    if formation.split_factor is None:
        return False
    if route is not None and along is not None and route.split_at(along.s_m) is not None:
        return uav != route.leader and route.way_of(uav) is None
    for told in [membership.told[other].message for other in heard if other != uav]:
        if told.route_id and told.split is not None:
            is_apart = told.split.begin_m <= told.along_m < told.split.end_m
            return is_apart and uav not in (of for of, _ in told.split.ways)
    return False


def _told_weights(membership: Membership) -> tuple[float, ...]:
    """Return the weights of the behaviours that the leader tells; empty: none, or this vehicle leads."""
    leader = membership.leader
    told = None if leader is None else membership.told.get(leader)
    return () if told is None else told.message.weights


def _with_route(state: AgentState, formation: Formation, membership: Membership) -> Membership:
    """Return the membership with the leader's route: its own plan, or the route that it has told."""
    present, leader = membership.route, membership.leader
    assert leader is not None
    if leader != state.task.uav:
        told = membership.told[leader].message
        if not told.route or (present is not None and present.is_of(leader, told.route_id)):
            return membership
        points_m = tuple(state.task.grid.frame.to_local(*point) for point in told.route)
        number, shapes, split = told.route_id, told.shapes, _received_split(state, told)
        ways = () if split is None else [curve.points_m for curve in split.curves.values()]
        if not all(_is_near_area(state, points) for points in (points_m, *ways)):
            return membership  # a wrong route of the leader must lead nobody away
        speed_m_s = state.task.speed_m_s
        route = GroupRoute.of(leader, number, points_m, shapes, formation, speed_m_s, split=split)
    elif state.phase is Phase.FORMATION:
        if present is None or present.leader == leader:
            return membership
        # A new leader goes on along the route of the former one, until it plans a route of its own.
        number = membership.n_routes + 1
        route = replace(present, leader=leader, number=number)
        return replace(membership, route=route, n_routes=number, sent_boot_s=-math.inf)
    else:
        own = _route_of_mission(state, formation, membership)
        if own is None:
            return membership
        route = own
    memory = membership.memory
    if present is not None and memory is not None:
        along = on_new_route(memory.along, present.reference, route.reference)
        memory = replace(memory, along=along)
    n_routes = max(membership.n_routes, route.number) if leader == state.task.uav else membership.n_routes
    return replace(
        membership,
        route=route,
        memory=memory,
        n_routes=n_routes,
        sent_boot_s=-math.inf,
    )


def _received_split(state: AgentState, told: MemberShared) -> SplitStretch | None:
    """Return the split that the leader has told, with the ways of the members in metres."""
    if (split := told.split) is None:
        return None
    to_local = state.task.grid.frame.to_local
    ways = {uav: [to_local(*point) for point in points] for uav, points in split.ways}
    return SplitStretch.of(split.begin_m, split.end_m, ways)


def _is_near_area(state: AgentState, points_m: Sequence[PlanarPoint]) -> bool:
    """Return whether a route stays in the fence, or without a fence near the area."""
    if state.task.fence is not None:
        return all(contains(state.task.fence.corners_m, point) for point in points_m)
    grid, margin_m = state.task.grid, JOINS_WITHIN_M
    return all(
        -margin_m <= east_m <= grid.size_east_m + margin_m
        and -margin_m <= north_m <= grid.size_north_m + margin_m
        for east_m, north_m in points_m
    )


def _route_of_mission(state: AgentState, formation: Formation, membership: Membership) -> GroupRoute | None:
    """Return the route of a leader that flies its mission; None if it is the present one, or unknown."""
    swap, progress, present = state.plans.mission, state.progress, membership.route
    if swap is None or progress is None:
        return None
    plan = swap.plan_id, membership.n_present
    before = None if present is None or present.leader != state.task.uav else present.plan
    if before == plan:
        return None
    task, shapes, along = state.task, [], membership.along
    split = None if present is None or along is None else present.split_at(along.s_m)
    apart, centres_m = swap.split, progress.flight.centres_m
    if apart is not None:
        end_m = centres_m[swap.cells.index(apart.routes[0][-1]) + 1]
        apart = apart if end_m > progress.along_m else None
    if before is None or before[0] != swap.plan_id:
        if apart is not None:
            if present is None or along is None:
                return None  # the members' places are unknown
            split = split_in_metres(state, apart, progress.along_m, end_m)
        elif split is not None and along is not None:
            split = split.moved(progress.along_m - along.s_m)
    if state.plans.exposure is not None:
        problem = task.problem(state.plans.exposure, swap.cells[0], state.w)
        own = replace(state, membership=membership)
        method = planner_of(own)
        takes_m = formation.change_m(membership.n_present)
        shapes = shape_changes(takes_m, method, problem, swap.cells, centres_m, split=apart)
    return GroupRoute.of(
        task.uav,
        membership.n_routes + 1,
        progress.flight.legs.points[:-1],
        tuple(shapes),
        formation,
        task.speed_m_s,
        plan,
        split,
    )


def _is_at_end(state: AgentState, formation: Formation, membership: Membership) -> bool:
    """Return whether the reference point is so near the end of the route that the members go on alone."""
    route, memory = membership.route, membership.memory
    if route is None or memory is None:
        return False
    flown_m = memory.along.s_m + memory.along.speed_m_s * (state.now_boot_s - memory.now_s)
    return flown_m >= route.reference.length_m - formation.ends_before_m - AT_END_M
