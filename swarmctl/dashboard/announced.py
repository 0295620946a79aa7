"""Routes of vehicles that announce their flights, but not their costs nor their reasons. Pure.

A swarm of agents tells a station only the points of each flight. Length and exposure follow from the points
and from what the station knows. Reasons are the observations near the old or the new route since the last
change.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.exposure import exposure_sum, safety_factor
from swarmctl.core.frames import IntentShared
from swarmctl.core.grid import Cell, Grid
from swarmctl.dashboard.belief_history import Name
from swarmctl.dashboard.picture import Point, Route

if TYPE_CHECKING:
    from swarmctl.dashboard.facts import VehicleFacts
    from swarmctl.dashboard.model import Timeline

NEAR_CELLS = 2
"""distance from a route within which an observation may have changed it [cells]"""
MAX_REASONS = 5
STEPS_A_CELL = 4


def route(grid: Grid, intent: IntentShared, p_s: NDArray[np.float64]) -> Route:
    """Return an announced flight as a route, with length and exposure by P_s."""
    points = tuple(grid.frame.to_local(p.lat_deg, p.lon_deg) for p in intent.points)
    cells = _cells(grid, points)
    length_m = sum(math.dist(a, b) for a, b in pairwise(points))
    return Route(intent.plan_id, cells, points, length_m, exposure_sum(p_s, cells), safety_factor(p_s, cells))


def _cells(grid: Grid, points: tuple[Point, ...]) -> tuple[Cell, ...]:
    """Return the cells of the area below a path, in the order of the flight."""
    cells: list[Cell] = []
    for (east_a, north_a), (east_b, north_b) in pairwise(points):
        steps = math.ceil(STEPS_A_CELL * math.dist((east_a, north_a), (east_b, north_b)) / grid.cell_size_m)
        for i in range(steps + 1):
            share = i / max(steps, 1)
            east_m, north_m = east_a + share * (east_b - east_a), north_a + share * (north_b - north_a)
            cell = (math.floor(north_m / grid.cell_size_m), math.floor(east_m / grid.cell_size_m))
            if grid.contains(cell) and cells[-1:] != [cell]:
                cells.append(cell)
    return tuple(cells)


def because(timeline: Timeline, vehicle: VehicleFacts, new: Route) -> tuple[Name, ...]:
    """Return the newest observations that may have led from a vehicle's route to a new one."""
    old = vehicle.route.last
    if old is None:
        return ()
    since_s = max((c.time_s for c in timeline.changes.items if c.vehicle == vehicle.name), default=0.0)
    near = {
        (row + rows, col + cols)
        for row, col in (*old.cells, *new.cells)
        for rows in range(-NEAR_CELLS, NEAR_CELLS + 1)
        for cols in range(-NEAR_CELLS, NEAR_CELLS + 1)
    }
    found: list[Name] = []
    for name, (observation, heard_s) in reversed(timeline.observations.items()):
        if heard_s < since_s or len(found) == MAX_REASONS:
            break
        if any((row, col) in near for row, col, _ in observation.cells):
            found.append(name)
    return tuple(found)
