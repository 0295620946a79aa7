"""The split of a group: the leader's planner that compares it, and the members' ways in metres. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from swarmctl.agent.formation.membership import IN_PLACE_M, GroupRoute
from swarmctl.agent.formation.near_members import joins_within_m, places_in, places_of
from swarmctl.agent.formation.shape import ShapePlace
from swarmctl.agent.formation.ways import SplitStretch, offset_of
from swarmctl.agent.state import AgentState
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.planar import PlanarPoint, by_heading, turning_points
from swarmctl.core.route import cells_between
from swarmctl.core.split import SplitPlan
from swarmctl.core.track_position import StraightLegs
from swarmctl.planners import split_route
from swarmctl.planners.base import Method

COMPLETE_S = 20.0
"""Time for which a group waits for absent members before it is complete without them [s]."""
BEHIND_M = 5.0
"""Distance behind the reference point at which a split begins, because members hear of it later [m]."""
RANGE_MARGIN_M = 20.0
"""Distance by which members stay nearer to each other than their messages reach [m]."""
_LOOKS = 8


def with_split(state: AgentState, method: Method, start: Cell | None, *, is_formed: bool) -> Method:
    """Return the planner that compares a split, if the group may split at the start of the plan.

    method: the planner for flying together
    start: the leader's cell at which the plan begins; None: on the ground, or for a route that is known
    is_formed: the members are at their places

    Only a leader at the reference point plans a split, and only while all members are at their places.
    """
    formation, membership, grid = state.task.formation, state.membership, state.task.grid
    route, along = membership.route, membership.along
    if formation is None or formation.split_factor is None or start is None or route is None or along is None:
        return method
    s_m, present = route.reference.locate(grid.centre_m(start)), route.split_at(along.s_m)
    places, others = places_of(state, formation), _others(state)
    if any(places[state.task.uav][:2]) or route.way_of(state.task.uav) is not None:
        return method
    under_way = None
    if present is None:
        if not is_formed:
            return method
        points = [_place_m(route, uav, places[uav], s_m) for uav in others]
        starts = [grid.cell_at(*grid.frame.to_geodetic(*point)) for point in points]
        if None in starts:
            return method  # a member still flies outside the area
    else:
        if s_m >= present.end_m or present.plan is None or not set(others) <= present.curves.keys():
            return method
        own_routes = dict(zip(present.plan.members, present.plan.routes, strict=True))
        rest = [_rest(grid, own_routes[uav], _place_m(route, uav, places[uav], s_m)) for uav in others]
        starts = [cells[0] for cells in rest]
        n_onward = 1 + sum(at_m >= present.end_m - 1.0 for at_m, _ in cells_along(grid, route.reference.legs))
        under_way = split_route.UnderWay(tuple(rest), n_onward, present.plan.shape)
    reach_m = min(joins_within_m(formation), formation.reach_m) - RANGE_MARGIN_M
    params = split_route.Params(
        method.params,
        (state.task.uav, *others),
        (start, *(cell for cell in starts if cell is not None)),
        formation.split_factor,
        reach_m / grid.cell_size_m,
        under_way,
    )
    return Method("formation", split_route, params)


def is_formed(state: AgentState) -> bool:
    """Return whether the present members are at their places, and absent ones have had their time to join."""
    formation, membership = state.task.formation, state.membership
    assert formation is not None
    in_place = followers_in_place(state)
    is_complete = len(in_place) == len(formation.members) - 1
    waits_s = state.now_boot_s - membership.n_present_since_boot_s
    return (is_complete or waits_s >= COMPLETE_S) and all(in_place.values())


def followers_in_place(state: AgentState) -> dict[int, bool]:
    """Return for each present member but the leader whether it is at its place; none without a route."""
    formation, route, along = state.task.formation, state.membership.route, state.membership.along
    if formation is None or route is None or along is None:
        return {}
    places = places_of(state, formation)
    in_place = {uav: _is_in_place(state, route, uav, places[uav]) for uav in _others(state)}
    if state.membership.error_m is not None:
        in_place[state.task.uav] = state.membership.from_place_m <= IN_PLACE_M
    return {uav: is_there for uav, is_there in in_place.items() if uav != state.membership.leader}


def _others(state: AgentState) -> tuple[int, ...]:
    """Return the other members that have places, in the group's order."""
    return tuple(uav for uav in state.membership.with_places if uav != state.task.uav)


def split_in_metres(state: AgentState, plan: SplitPlan, begin_m: float, end_m: float) -> SplitStretch:
    """Return a split on the next route of the group; the ways begin at the members' present places.

    begin_m: distance of the reference point along the next route, at which the split begins [m]
    end_m: distance along the next route to the leader's cell after the meeting [m]
    """
    formation, membership, grid = state.task.formation, state.membership, state.task.grid
    route, along = membership.route, membership.along
    assert formation is not None
    assert route is not None
    assert along is not None
    here_m = along.s_m
    splice_m = max(route.reference.locate(grid.centre_m(plan.routes[0][0])), here_m)
    behind_m = min(BEHIND_M, begin_m)
    looks_m = np.linspace(here_m - behind_m, splice_m, _LOOKS).tolist()
    places = places_in(formation, membership.shape, plan.members)
    meeting_places, meeting = places_in(formation, plan.shape, plan.members), plan.routes[0][-1]
    heading_rad = math.atan2(plan.ahead[1] - meeting[1], plan.ahead[0] - meeting[0])
    points_m: dict[int, Sequence[PlanarPoint]] = {}
    for uav, cells in zip(plan.members[1:], plan.routes[1:], strict=True):
        east_m, north_m = by_heading(meeting_places[uav][:2], heading_rad)
        ends = (grid.centre_m(cell) for cell in (meeting, plan.ahead))
        points = [
            *(_place_m(route, uav, places[uav], look_m) for look_m in looks_m),
            *(grid.centre_m(cell) for cell in cells[1:-1]),
            *((east + east_m, north + north_m) for east, north in ends),
        ]
        points_m[uav] = turning_points(points)
    return SplitStretch.of(begin_m - behind_m, end_m, points_m, plan)


def cells_along(grid: Grid, legs: StraightLegs) -> list[tuple[float, Cell]]:
    """Return the cells that a route passes, each with the distance along it to the cell's centre [m].

    Between two corners of a lattice route the cells lie in a row, a column or a diagonal.
    """
    found: list[tuple[float, Cell]] = []
    for at_m, point in zip(legs.at_m, legs.points, strict=True):
        cell = grid.cell_at(*grid.frame.to_geodetic(*point))
        if cell is None or (found and found[-1][1] == cell):
            continue
        if found:
            begin_m, begin = found[-1]
            line = cells_between(begin, cell)
            each_m = (at_m - begin_m) / (len(line) - 1)
            found += [(begin_m + k * each_m, between) for k, between in enumerate(line[1:-1], 1)]
        found.append((at_m, cell))
    return found


def _place_m(route: GroupRoute, uav: int, place: ShapePlace, s_m: float) -> PlanarPoint:
    """Return a member's place with the reference point at a distance along the route, (east, north) [m]."""
    pose = route.reference.at(s_m)
    (east_m, north_m), _ = offset_of(pose, place, route.way_of(uav))
    return pose.east_m + east_m, pose.north_m + north_m


def _is_in_place(state: AgentState, route: GroupRoute, uav: int, place: ShapePlace) -> bool:
    told, along = state.membership.told[uav], state.membership.along
    assert along is not None
    age_s = max(state.now_boot_s - told.at_boot_s, 0.0)
    east_m, north_m = told.here_m
    velocity = told.message.velocity_m_s
    here_m = east_m + age_s * velocity[0], north_m + age_s * velocity[1]
    return math.dist(here_m, _place_m(route, uav, place, along.s_m)) <= IN_PLACE_M


def _rest(grid: Grid, cells: tuple[Cell, ...], place_m: PlanarPoint) -> tuple[Cell, ...]:
    """Return the cells of a member's own route from the cell nearest to its place on."""
    nearest = min(range(len(cells)), key=lambda k: math.dist(grid.centre_m(cells[k]), place_m))
    return cells[nearest:]
