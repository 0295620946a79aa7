"""The mission for a lattice route: along the route itself, or along a straightened track.

The planner measures and compares lattice routes alone. A new plan replaces a track that is no longer as good
as its lattice route.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.landing import goal_approach, home_approach
from swarmctl.agent.replan.splice import CHANGE_S, Splice
from swarmctl.agent.state import AgentState, Task
from swarmctl.core.any_angle import pull
from swarmctl.core.any_angle.corners import CostWeights, Unflyable
from swarmctl.core.any_angle.pull import Track, pull_straight
from swarmctl.core.any_angle.track import GridPoint, ThreatMap
from swarmctl.core.any_angle.turns import tangent_length
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import distance_to_leg
from swarmctl.core.records import replace
from swarmctl.core.route import ends_and_turns, flight_plan, track_plan
from swarmctl.planners.base import Problem, Route, Unreachable

NO_WAYPOINT_WITHIN_M = 5.0
"""Distance from the direct leg within which a splice point needs no waypoint [m]."""


class FlownRoute(msgspec.Struct, frozen=True):
    """The flown form of a route, and its measures."""

    cells: tuple[Cell, ...]
    """cells under the flight, in the order flown"""
    corners: tuple[Cell, ...]
    """both ends and the turns"""
    length_cells: float
    exposure_sum: float
    """ΣP_s over the cells entered after the first"""
    safety_factor: float
    """∏(1 − P_s) over the same cells"""
    is_pulled: bool
    """True for a straightened track; False for the lattice route itself"""


def flown_route(task: Task, problem: Problem, route: Route) -> FlownRoute:
    """Return the flown form of a route. Raises Unreachable as `pulled_track` does."""
    track = pulled_track(task, problem, route)
    if track is None:
        return lattice_route(route)
    return FlownRoute(
        track.over, track.corners, track.length_cells, track.exposure_sum, track.safety_factor, is_pulled=True
    )


def lattice_route(route: Route) -> FlownRoute:
    """Return a lattice route in flown form, without a straightened track."""
    cells = route.cells
    return FlownRoute(
        cells,
        ends_and_turns(cells),
        route.length_cells,
        route.exposure_sum,
        route.safety_factor,
        is_pulled=False,
    )


def pulled_track(task: Task, problem: Problem, route: Route) -> Track | None:
    """Return the straightened track of a route; None if the vehicle flies the lattice route.

    Wide turns may make every track worse than the route. Then the result is the track of least cost: Eq. 5
    for a planner that uses w, otherwise the exposure. Raises Unreachable if no track has turns wide enough.
    """
    if task.any_angle is None:
        return None
    radius_cells = task.turn_radius_m / task.grid.cell_size_m
    threat = ThreatMap.of(problem.exposure, problem.max_exposure)
    uses_w = task.method.planner.USES_W
    weights = CostWeights(problem.w, problem.psi_per_cell) if uses_w else CostWeights(1.0, 0.0)
    try:
        track = pull_straight(threat, route.cells, task.any_angle, radius_cells=radius_cells, weights=weights)
    except Unflyable as error:
        raise Unreachable(f"{error}; the vehicle needs {task.turn_radius_m:g} m") from error
    if radius_cells == 0.0 and track.length_cells < problem.min_length_cells:
        return None  # the vehicle would arrive too early
    return track


def mission_for(
    task: Task,
    p_s: NDArray[np.float64],
    route: Route,
    track: Track | None,
    position: LatLon | None = None,
    splice: Splice | None = None,
) -> FlightPlan:
    """Return the mission for a route or its track, from the entry cell or from the vehicle in flight.

    If `splice` is ahead of the vehicle, the mission follows the present mission up to the splice point.
    Raises Unreachable if a fixed wing has no room to land.
    """
    cells = route.cells
    landing = task.landing_spot(cells[-1])
    if task.wings is not None:
        flown = _fixed_wing_mission(task, cells if track is None else track.corners, landing, position)
        return replace(flown, leaves_ahead=splice is not None and len(splice.kept) > 1)
    leaves_ahead = splice is not None and splice.leaves_ahead
    if splice is not None and leaves_ahead and track is None and not splice.lead_waypoints:
        return _along_lattice(task, cells, splice, landing)
    if splice is not None and leaves_ahead:
        position = splice.lead_waypoints[-1].lat_deg, splice.lead_waypoints[-1].lon_deg
    lead_waypoints = splice.lead_waypoints if splice is not None else ()
    if track is not None:
        threat = ThreatMap.of(p_s, task.max_exposure)

        def may_join(point: GridPoint, corner: Cell) -> bool:
            return pull.may_join(threat, point, cells[0], corner)

        plan = track_plan(
            task.grid,
            track.corners,
            altitude_m=task.altitude_m,
            landing_lat_lon=landing,
            position=position,
            may_join=may_join,
        )
        if splice is not None and _goes_straight(task, splice, plan.track[0]):
            lead_waypoints = ()
        return replace(plan, track=(*lead_waypoints, *plan.track), leaves_ahead=leaves_ahead)

    def may_cross(cell: Cell) -> bool:
        # DEVIATION: a vehicle past the centre of its cell would fly back to the centre for a diagonal turn.
        # The vehicle cuts the corner if the cell under the shortcut is no worse than the step's worse cell.
        return math.isfinite(p_s[cell]) and bool(p_s[cell] <= max(p_s[cells[0]], p_s[cells[1]]))

    plan = flight_plan(
        task.grid,
        cells,
        altitude_m=task.altitude_m,
        landing_lat_lon=landing,
        position=position,
        may_cross=may_cross,
    )
    return replace(plan, track=(*lead_waypoints, *plan.track), leaves_ahead=leaves_ahead)


def _goes_straight(task: Task, splice: Splice, first: Waypoint) -> bool:
    """Return whether the splice point is so near the direct leg to `first` that it needs no waypoint."""
    if len(splice.lead_waypoints) != 1:
        return False
    frame, (splice_point,) = task.grid.frame, splice.lead_waypoints
    place, there = (frame.to_local(at.lat_deg, at.lon_deg) for at in (splice_point, first))
    return distance_to_leg(place, splice.path[0], there) <= NO_WAYPOINT_WITHIN_M


def _along_lattice(task: Task, cells: Sequence[Cell], splice: Splice, landing: LatLon) -> FlightPlan:
    """Return the mission over the centres ahead of a vehicle that is already over the first cell."""
    if splice.is_first_passed:
        corners = ends_and_turns(cells)[1:]
    elif splice.previous is not None:
        corners = ends_and_turns((splice.previous, *cells))[1:]
    else:
        corners = ends_and_turns(cells)
    plan = track_plan(task.grid, corners, altitude_m=task.altitude_m, landing_lat_lon=landing)
    return replace(plan, leaves_ahead=True)


def _fixed_wing_mission(
    task: Task, corners: Sequence[Cell], landing: LatLon, position: LatLon | None
) -> FlightPlan:
    """Return the mission of a fixed wing: the corners ahead, and landing approaches at its goal and home."""
    assert task.wings is not None
    ahead = corners if position is None else corners_ahead(task, corners, position)
    plan = track_plan(task.grid, ahead, altitude_m=task.altitude_m, landing_lat_lon=landing)
    return replace(
        plan,
        takeoff_alt_m=min(task.altitude_m, task.wings.takeoff_height_m),
        turn_radius_m=task.turn_radius_m,
        approach=goal_approach(task, corners[-1]),
        home_approach=home_approach(task),
    )


def corners_ahead(task: Task, corners: Sequence[Cell], position: LatLon) -> Sequence[Cell]:
    """Return the corners of a track that are still ahead of a fixed wing, at least the last corner.

    Inside the area the first corner is under or beside the vehicle and is left out. So are corners at which
    the vehicle turns soon: it would fly a circle back to a corner that it has passed.
    """
    grid = task.grid
    cell, here = grid.cell_at(*position), grid.frame.to_local(*position)
    soon_m = 0.5 * CHANGE_S * task.speed_m_s
    first = 0
    while first + 1 < len(corners):
        corner, after = grid.centre_m(corners[first]), grid.centre_m(corners[first + 1])
        turns_m = min(tangent_length(here, corner, after, task.turn_radius_m), 2.0 * task.turn_radius_m)
        is_passed = first == 0 and cell is not None
        if not is_passed and math.dist(here, corner) > turns_m + soon_m:
            break
        first += 1
    return corners[first:]


def is_track_still_good(state: AgentState, p_s: NDArray[np.float64]) -> bool:
    """Return whether the present track is still as good as its route; True if there is no track."""
    task, mission, progress = state.task, state.plans.mission, state.progress
    if mission is None or mission.track is None or progress is None:
        return True
    if task.any_angle is None or state.plans.route_exposure is None:
        return True
    size_m = task.grid.cell_size_m
    return pull.is_still_good(
        ThreatMap.of(p_s, task.max_exposure),
        ThreatMap.of(state.plans.route_exposure, task.max_exposure),
        task.any_angle,
        mission.cells,
        mission.track,
        radius_cells=task.turn_radius_m / size_m,
        here=(progress.here[0] / size_m, progress.here[1] / size_m),
        index=progress.cell_index,
    )
