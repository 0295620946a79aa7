"""Where a new plan of a fixed wing leaves the old one: it cannot turn on the spot, nor wait for its mission.

Until the new plan is on it, it flies on along the old one, and then needs room for its turn. So a new route
branches off at a cell that lies that far ahead, and keeps the old one's cells until there. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.state import AgentState, Phase, Task
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.turns import tangent

CHANGE_S = 2.0
"""for so long, at least, it flies on along its old plan while the new one is put on it"""
TURN = math.tan(math.pi / 8.0)
"""So many radii before a turn by 45 degrees it turns off; routes turn by more only where they have room."""


def kept_cells(state: AgentState, start: Cell) -> tuple[Cell, ...]:
    """Of the route being flown, the cells from `start` on that a new one begins with as well; the last of
    them is where it may turn off. `start` alone for what hovers, and where no route is flown."""
    task, swap, vehicle = state.task, state.route, state.vehicle
    if task.wings is None or state.phase is not Phase.FLYING or swap is None or start not in swap.cells:
        return (start,)
    if vehicle.lat_deg is None or vehicle.lon_deg is None:
        return (start,)
    here = task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    ahead = swap.cells[swap.cells.index(start) :]
    change_s = max(CHANGE_S, state.swap_times.expected_s)
    least_m = TURN * task.turn_radius_m + change_s * task.arrival.speed_m_s
    for last in range(1, len(ahead)):
        if math.dist(here, task.grid.centre_m(ahead[last])) >= least_m:
            return ahead[: last + 1]
    return ahead


def still_ahead(task: Task, corners: Sequence[Cell], position: LatLon) -> Sequence[Cell]:
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
