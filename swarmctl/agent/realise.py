"""From a lattice route to what is flown for it: the route itself, or a track pulled straight from it.

The route stays the plan: it is what a planner measures and what a new one is compared with. A track stands
for it as long as it is no worse.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.state import AgentState, Task
from swarmctl.core import any_angle
from swarmctl.core import events as ev
from swarmctl.core.any_angle import Track, pull_straight
from swarmctl.core.corners import Unflyable, Weights
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.mission import FlightPlan
from swarmctl.core.route import flight_plan, landing_spot, track_plan
from swarmctl.core.track import Point, Threat
from swarmctl.planners.base import Problem, Route, Unreachable


def pulled(task: Task, problem: Problem, route: Route) -> Track | None:
    """The track to fly for a route; None where the lattice route itself is flown. Raises Unreachable where
    no track has turns wide enough."""
    if task.any_angle is None:
        return None
    radius_cells = task.turn_radius_m / task.grid.cell_size_m
    threat = Threat.of(problem.exposure, problem.max_exposure)
    weights = Weights(problem.w, problem.psi_per_cell)
    try:
        track = pull_straight(threat, route.cells, task.any_angle, radius_cells=radius_cells, weights=weights)
    except Unflyable as error:
        raise Unreachable(f"{error}; the vehicle needs {task.turn_radius_m:g} m") from error
    if radius_cells == 0.0 and track.length_cells < problem.min_length_cells:
        return None  # it would be there too early
    return track


def realised(
    task: Task, p_s: NDArray[np.float64], route: Route, track: Track | None, position: LatLon | None = None
) -> FlightPlan:
    """The mission for a route or its track, begun from the entry or from where the vehicle flies."""
    cells = route.cells
    landing = landing_spot(task.grid, cells[-1], task.landing_index, task.landing_count)
    if track is not None:
        threat = Threat.of(p_s, task.max_exposure)

        def may_join(point: Point, corner: Cell) -> bool:
            return any_angle.may_join(threat, point, cells[0], corner)

        return track_plan(
            task.grid,
            track.corners,
            altitude_m=task.altitude_m,
            landing_lat_lon=landing,
            position=position,
            may_join=may_join,
        )

    def may_clip(cell: Cell) -> bool:
        # DEVIATION: a vehicle past the centre of its cell would fly back to it to turn off diagonally. It
        # cuts the corner instead where the cell it passes over is no worse than the two it flies between.
        return math.isfinite(p_s[cell]) and bool(p_s[cell] <= max(p_s[cells[0]], p_s[cells[1]]))

    return flight_plan(
        task.grid,
        cells,
        altitude_m=task.altitude_m,
        landing_lat_lon=landing,
        position=position,
        may_clip=may_clip,
    )


def index_abreast(swap: ev.SwapMission, cell: Cell, since: int = 0) -> int | None:
    """The index in `swap.cells` that stands for a cell it leads over; None where it does not lead."""
    if swap.track is not None:
        return any_angle.index_abreast(swap.track, cell, since)
    return swap.cells.index(cell) if cell in swap.cells else None


def track_holds(state: AgentState, p_s: NDArray[np.float64], start: Cell) -> bool:
    """Whether the track being flown still stands for its route, of which `start` is beside the vehicle."""
    task, swap = state.task, state.route
    if swap is None or swap.track is None or task.any_angle is None or state.held is None:
        return True
    return any_angle.still_holds(
        Threat.of(p_s, task.max_exposure),
        Threat.of(state.held, task.max_exposure),
        task.any_angle,
        swap.cells,
        swap.track,
        radius_cells=task.turn_radius_m / task.grid.cell_size_m,
        cell=state.cell if state.cell is not None else start,
        index=swap.cells.index(start),
    )
