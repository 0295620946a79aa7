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

from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.exposure import exposure_sum, safety_factor
from swarmctl.core.frames import IntentShared
from swarmctl.core.grid import Grid
from swarmctl.dashboard.belief_history import Name
from swarmctl.dashboard.picture import ShownRoute

if TYPE_CHECKING:
    from swarmctl.dashboard.facts import VehicleFacts
    from swarmctl.dashboard.model import Timeline

NEAR_CELLS = 2
"""distance from a route within which an observation may have changed it [cells]"""
MAX_REASONS = 5


def route(grid: Grid, intent: IntentShared, p_s: NDArray[np.float64]) -> ShownRoute:
    """Return an announced flight as a route, with length and exposure by P_s."""
    points = tuple(grid.frame.to_local(p.lat_deg, p.lon_deg) for p in intent.points)
    cells = tuple(filter(grid.contains, cells_under(points, grid.cell_size_m)))
    length_m = sum(math.dist(a, b) for a, b in pairwise(points))
    return ShownRoute(
        intent.plan_id, cells, points, length_m, exposure_sum(p_s, cells), safety_factor(p_s, cells)
    )


def because(timeline: Timeline, vehicle: VehicleFacts, new: ShownRoute) -> tuple[Name, ...]:
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
