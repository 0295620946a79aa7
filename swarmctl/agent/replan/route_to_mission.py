"""From a lattice route to what is flown for it: the route itself, or a track pulled straight from it.

The route stays the plan: it is what a planner measures and what a new one is compared with. A track stands
for it as long as it is no worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.landing import goal_approach, home_approach
from swarmctl.agent.replan.splice import CHANGE_S, Splice
from swarmctl.agent.state import AgentState, Task
from swarmctl.core import events as ev
from swarmctl.core.any_angle import pull
from swarmctl.core.any_angle.corners import Unflyable, Weights
from swarmctl.core.any_angle.pull import Track, pull_straight
from swarmctl.core.any_angle.track import GridPoint, ThreatMap
from swarmctl.core.any_angle.turns import tangent
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import distance_to_leg
from swarmctl.core.route import ends_and_turns, flight_plan, landing_spot, track_plan
from swarmctl.planners.base import Problem, Route, Unreachable

BESIDE_M = 5.0
"""So near to the straight way to its next corner a vehicle needs no corner more: it is no farther off there
than it rounds others."""


@dataclass(frozen=True, slots=True)
class FlownRoute:
    """What is flown for a route, and what that adds up to."""

    cells: tuple[Cell, ...]
    """passed over, in this order"""
    corners: tuple[Cell, ...]
    """both ends and where it turns"""
    length_cells: float
    exposure_sum: float
    """ΣP_s over the cells entered after the first"""
    safety_factor: float
    """∏(1 − P_s) over the same"""
    is_pulled: bool
    """a track; else the lattice route itself"""


def flown_route(task: Task, problem: Problem, route: Route) -> FlownRoute:
    """What a vehicle flies for a route. Raises Unreachable as `pulled_track` does."""
    track = pulled_track(task, problem, route)
    if track is None:
        return lattice_route(route)
    return FlownRoute(
        track.over, track.corners, track.length_cells, track.exposure_sum, track.safety_factor, is_pulled=True
    )


def lattice_route(route: Route) -> FlownRoute:
    """The lattice route itself."""
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
    """The track to fly for a route; None where the lattice route itself is flown. Raises Unreachable where
    no track has turns wide enough.

    Where turns that wide cannot be had without loss, the loss is kept small by Eq. 5 for a planner that goes
    by w, and by exposure alone for the others: no track is longer than its route, so bounds on the time are
    kept.
    """
    if task.any_angle is None:
        return None
    radius_cells = task.turn_radius_m / task.grid.cell_size_m
    threat = ThreatMap.of(problem.exposure, problem.max_exposure)
    goes_by_w = task.method.planner.USES_W
    weights = Weights(problem.w, problem.psi_per_cell) if goes_by_w else Weights(1.0, 0.0)
    try:
        track = pull_straight(threat, route.cells, task.any_angle, radius_cells=radius_cells, weights=weights)
    except Unflyable as error:
        raise Unreachable(f"{error}; the vehicle needs {task.turn_radius_m:g} m") from error
    if radius_cells == 0.0 and track.length_cells < problem.min_length_cells:
        return None  # it would be there too early
    return track


def mission_for(
    task: Task,
    p_s: NDArray[np.float64],
    route: Route,
    track: Track | None,
    position: LatLon | None = None,
    branch: Splice | None = None,
) -> FlightPlan:
    """The mission for a route or its track, begun from the entry or from where the vehicle flies; where it
    leaves the one that is flown ahead of the vehicle (`branch`), as that goes until there. Raises Unreachable
    where a fixed wing has no room to land."""
    cells = route.cells
    landing = landing_spot(task.grid, cells[-1], task.landing_index, task.landing_count)
    if task.wings is not None:
        flown = _with_wings(task, cells if track is None else track.corners, landing, position)
        return replace(flown, leaves_ahead=branch is not None and len(branch.kept) > 1)
    leaves_ahead = branch is not None and branch.leaves_ahead
    if branch is not None and leaves_ahead and track is None and not branch.passes:
        return _along_lattice(task, cells, branch, landing)
    if branch is not None and leaves_ahead:
        position = branch.passes[-1].lat_deg, branch.passes[-1].lon_deg
    passes = branch.passes if branch is not None else ()
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
        if branch is not None and _goes_straight(task, branch, plan.track[0]):
            passes = ()
        return replace(plan, track=(*passes, *plan.track), leaves_ahead=leaves_ahead)

    def may_clip(cell: Cell) -> bool:
        # DEVIATION: a vehicle past the centre of its cell would fly back to it to turn off diagonally. It
        # cuts the corner instead where the cell it passes over is no worse than the two it flies between.
        return math.isfinite(p_s[cell]) and bool(p_s[cell] <= max(p_s[cells[0]], p_s[cells[1]]))

    plan = flight_plan(
        task.grid,
        cells,
        altitude_m=task.altitude_m,
        landing_lat_lon=landing,
        position=position,
        may_clip=may_clip,
    )
    return replace(plan, track=(*passes, *plan.track), leaves_ahead=leaves_ahead)


def _goes_straight(task: Task, branch: Splice, first: Waypoint) -> bool:
    """Whether a vehicle may leave its track for `first` anywhere until the place where it is to do so."""
    if len(branch.passes) != 1:
        return False
    frame, (turns,) = task.grid.frame, branch.passes
    place, there = (frame.to_local(at.lat_deg, at.lon_deg) for at in (turns, first))
    return distance_to_leg(place, branch.path[0], there) <= BESIDE_M


def _along_lattice(task: Task, cells: Sequence[Cell], branch: Splice, landing: LatLon) -> FlightPlan:
    """Over the centres ahead of a vehicle that flies along the first of these cells already."""
    if branch.is_first_behind:
        corners = ends_and_turns(cells)[1:]
    elif branch.before is not None:
        corners = ends_and_turns((branch.before, *cells))[1:]
    else:
        corners = ends_and_turns(cells)
    plan = track_plan(task.grid, corners, altitude_m=task.altitude_m, landing_lat_lon=landing)
    return replace(plan, leaves_ahead=True)


def _with_wings(task: Task, corners: Sequence[Cell], landing: LatLon, position: LatLon | None) -> FlightPlan:
    """As a fixed wing flies it: it never goes back to a corner, and lands by an approach."""
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
    """The corners of a track that a fixed wing is on, without that which it is over or abreast of, and those
    that it is about to turn at: for what lies behind it, it would fly a circle."""
    grid = task.grid
    over, here = grid.cell_at(*position), grid.frame.to_local(*position)
    soon_m = 0.5 * CHANGE_S * task.arrival.speed_m_s
    first = 0
    while first + 1 < len(corners):
        corner, after = grid.centre_m(corners[first]), grid.centre_m(corners[first + 1])
        turns_m = min(tangent(here, corner, after, task.turn_radius_m), 2.0 * task.turn_radius_m)
        behind = first == 0 and over is not None
        if not behind and math.dist(here, corner) > turns_m + soon_m:
            break
        first += 1
    return corners[first:]


def route_index_at(swap: ev.SwapMission, cell: Cell, since: int = 0) -> int | None:
    """The index in `swap.cells` that stands for a cell it leads over; None where it does not lead."""
    if swap.track is not None:
        return pull.route_index_at(swap.track, cell, since)
    return swap.cells.index(cell) if cell in swap.cells else None


def is_track_still_good(state: AgentState, p_s: NDArray[np.float64], start: Cell) -> bool:
    """Whether the track being flown still stands for its route, of which `start` is beside the vehicle."""
    task, swap = state.task, state.route
    if swap is None or swap.track is None or task.any_angle is None or state.route_exposure is None:
        return True
    return pull.still_holds(
        ThreatMap.of(p_s, task.max_exposure),
        ThreatMap.of(state.route_exposure, task.max_exposure),
        task.any_angle,
        swap.cells,
        swap.track,
        radius_cells=task.turn_radius_m / task.grid.cell_size_m,
        cell=state.cell if state.cell is not None else start,
        index=swap.cells.index(start),
    )
