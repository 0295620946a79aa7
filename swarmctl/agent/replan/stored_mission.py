"""The stored mission of a vehicle that has left it, for example to fly in a group. Pure.

The mission stays on the vehicle. So the vehicle can go on by the rest of it without an upload.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.decide import believed_exposure, planned_mission
from swarmctl.agent.replan.splice import is_wall
from swarmctl.agent.state import AgentState
from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.mission import Waypoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.route import cells_between
from swarmctl.planners.base import route_of

NEWLY_EXPOSED = 0.1
"""Rise of P_s since the mission was planned from which on the way back to it does not cross a cell."""
SAME_PLACE_M = 0.1


def rest_of_stored(state: AgentState, stored: PlannedMission) -> PlannedMission | None:
    """Return the rest of the stored mission as a new plan: straight from here to its next waypoint, and on.

    The result is None if the vehicle must not go on by it: the vehicle may store another mission, its
    position is unknown, or the straight way leads through a wall or a cell that is newly exposed. A track
    that is no lattice route is planned anew, too.
    """
    progress, lat_lon, cell, grid = state.progress, state.vehicle.lat_lon, state.cell, state.task.grid
    if stored is not state.plans.accepted or stored.track is not None or state.vehicle.other_mission:
        return None
    if progress is None or progress.flight.mission is not stored or lat_lon is None or cell is None:
        return None
    track, centres_m = stored.plan.track, progress.flight.centres_m
    n_passed = min(progress.waypoint, len(track) - 1)
    next_m = progress.flight.legs.at_m[n_passed + 1] - SAME_PLACE_M
    first = next((i for i, at_m in enumerate(centres_m) if at_m >= next_m), len(centres_m) - 1)
    cells = (*cells_between(cell, stored.cells[first])[:-1], *stored.cells[first:])
    p_s = believed_exposure(state.task, state.belief, state.strength, state.own)
    there = grid.frame.to_local(track[n_passed].lat_deg, track[n_passed].lon_deg)
    way = cells_under((progress.here, there), grid.cell_size_m)
    if any(_is_barred(state, p_s, crossed) for crossed in way):
        return None
    problem = state.task.problem(p_s, cell, state.w)
    cost = state.task.method.measure(problem, cells)
    if not math.isfinite(cost):
        return None
    route = route_of(problem, cells, cost)
    begins = Waypoint(*lat_lon, state.height_m)
    plan = replace(stored.plan, track=track[n_passed:], begins=begins, leaves_ahead=False, from_hold=True)
    return planned_mission(state, plan, route)


def _is_barred(state: AgentState, p_s: NDArray[np.float64], cell: tuple[int, int]) -> bool:
    """Return whether a cell is outside the area, a wall, or newly exposed."""
    grid, before = state.task.grid, state.plans.route_exposure
    if not grid.contains(cell):
        return True
    is_newly_exposed = before is not None and float(p_s[cell]) > float(before[cell]) + NEWLY_EXPOSED
    return is_newly_exposed or is_wall(state, p_s, cell)
