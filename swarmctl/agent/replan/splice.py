"""The splice point: the point ahead of the vehicle at which a new route leaves the present route. Pure.

The vehicle flies on during the swap. So the new route keeps the cells of the old route up to a centre that
the vehicle reaches after the swap. The distance to that centre follows from the vehicle's speed and from the
durations of its last swaps.

A wall is a no-fly cell, or a cell above `max_exposure`. If the old route has a wall before the splice point,
a copter leaves the route at once. A fixed wing stays on the route: it can neither turn on the spot nor wait.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.stopping import change_for_new_plan, distance_and_speed_after
from swarmctl.agent.state import AgentState
from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import Waypoint
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.route import max_overshoot_m

NEAR_ROUTE_M = 15.0
"""Greatest distance from the route from which a vehicle may fly on to a splice point, in small cells [m]."""
NEAR_ROUTE_CELLS = 0.5
"""The same distance in cells from 30 m on [cells]; a copter that stopped past a splice point is beside it."""
URGENT_CELLS = 3
"""Number of cells ahead in which a wall requires a new plan at once."""
CHANGE_S = 2.0
"""Least time for which a fixed wing flies on by its old plan during a swap [s]."""
GROUP_TURNS_AFTER_S = 4.0
"""Least time ahead at which a new route of a group may turn off [s]: all members brake for the turn."""
N_SPLICE_POINTS = 21
"""Number of points on the next cell's length of a track that are compared for a splice."""
TURN_OFF_RADII = math.tan(math.pi / 8.0)
"""Distance before a turn by 45° at which a fixed wing turns off [turn radii]."""


class Splice(msgspec.Struct, frozen=True):
    """The common part of the present route and a new route."""

    kept: tuple[Cell, ...]
    """common cells, from the cell beside the vehicle to the cell in which the new route may turn off"""
    index: int | None = None
    """index of the last kept cell in the present route; None: that cell is not on the present route"""
    leaves_ahead: bool = False
    """True: a copter flies `kept` by its old plan; False: a fixed wing, or the copter leaves at once"""
    previous: Cell | None = None
    """cell of the old route before `kept`; None: `kept` begins that route, or the vehicle is not on it"""
    is_first_passed: bool = False
    """True if the vehicle has passed the centre of the first kept cell"""
    path: tuple[PlanarPoint, ...] = ()
    """points from the vehicle over the centres or corners ahead, without the splice point"""
    lead_m: float = 0.0
    """length of the path to the centre of the last kept cell, or to the splice point on a track [m]"""
    lead_waypoints: tuple[Waypoint, ...] = ()
    """on a track: the corners before the splice point, and the splice point"""


def splice_on_route(state: AgentState, p_s: NDArray[np.float64]) -> Splice:
    """Return the splice for a new route from the present lattice route, or from a fixed wing's track."""
    task, mission, progress, at_once = state.task, state.plans.mission, state.progress, leaving_at_once(state)
    if mission is None or progress is None or at_once.index is None or state.phase is not Phase.FLYING:
        return at_once
    cells, index = mission.cells, progress.cell_index
    if task.wings is not None:
        change_s = max(CHANGE_S, state.plans.swap_times.expected_s)
        least_m = TURN_OFF_RADII * task.turn_radius_m + change_s * task.speed_m_s
        far = (i for i in range(index + 1, len(cells)) if progress.to_centre_m(i) >= least_m)
        last = next(far, len(cells) - 1)
        return Splice(cells[index : last + 1], last)
    near_m = max(NEAR_ROUTE_M, NEAR_ROUTE_CELLS * task.grid.cell_size_m)
    is_near = state.vehicle.mode_role == "mission" and progress.at.cross_track_m <= near_m
    if mission.track is not None or not is_near:
        return at_once
    is_passed, least_m = progress.is_centre_passed, _swap_distance_m(state)
    first = index + 1 if is_passed else index
    if first >= len(cells):
        return at_once
    for last in range(first, len(cells)):
        if is_wall(state, p_s, cells[last]):
            return at_once
        if progress.to_centre_m(last) >= least_m:
            break
    path = (progress.here, *(task.grid.centre_m(cell) for cell in cells[first:last]))
    before = cells[index - 1] if index > 0 else None
    lead_m = progress.to_centre_m(last)
    return Splice(cells[index : last + 1], last, True, before, is_passed, path, lead_m)


def leaving_at_once(state: AgentState) -> Splice:
    """Return the splice for a new route that begins in the cell of the present route beside the vehicle.

    If there is no route, or the vehicle is off its route, the new route begins in the vehicle's cell. Outside
    the area it begins in the last cell flown, or in the entry cell.
    """
    if state.plans.mission is not None and state.progress is not None and state.progress.is_on_route:
        return Splice((state.progress.cell,), state.progress.cell_index)
    if state.cell is not None:
        return Splice((state.cell,))
    in_flight = state.phase is Phase.FLYING and state.flown.cells
    return Splice((state.flown.cells[-1] if in_flight else state.task.entry,))


def splice_on_track(state: AgentState, p_s: NDArray[np.float64]) -> Splice:
    """Return the splice for a new route from the present track: a point abreast of its cell's centre.

    The new route begins at this centre. A splice point beyond the centre would make the vehicle fly back.
    """
    mission, progress, grid = state.plans.mission, state.progress, state.task.grid
    assert state.cell is not None
    at_once, least_m = Splice((state.cell,)), _swap_distance_m(state)
    if mission is None or progress is None or state.vehicle.mode_role != "mission":
        return at_once
    if least_m > progress.to_last_waypoint_m:
        return at_once
    most_m = min(least_m + grid.cell_size_m, progress.to_last_waypoint_m)
    corners_m = (at_m - progress.along_m for at_m in progress.flight.legs.at_m)
    compared_m = [*np.linspace(least_m, most_m, N_SPLICE_POINTS), *corners_m]
    lead_m = min(
        (float(m) for m in compared_m if least_m <= m <= most_m),
        key=lambda m: _past_centre_m(grid, (progress.here, *progress.points_within(m))),
    )
    path = (progress.here, *progress.points_within(lead_m))
    cell = grid.cell_at(*grid.frame.to_geodetic(*path[-1]))
    crossed = cells_under(path, grid.cell_size_m)[1:]
    if cell is None or any(is_wall(state, p_s, at) for at in crossed):
        return at_once
    lead_waypoints = tuple(Waypoint(*grid.frame.to_geodetic(*point), state.height_m) for point in path[1:])
    index = mission.cells.index(cell) if cell in mission.cells else None
    return Splice((cell,), index, True, None, False, path[:-1], lead_m, lead_waypoints)


def _past_centre_m(grid: Grid, path: Sequence[PlanarPoint]) -> float:
    """Return how far the end of a path is past, or short of, the centre of its cell [m]; infinite outside."""
    before, end = path[-2:]
    cell, leg_m = grid.cell_at(*grid.frame.to_geodetic(*end)), math.dist(before, end)
    if cell is None:
        return math.inf
    centre = grid.centre_m(cell)
    if leg_m == 0.0:
        return math.dist(centre, end)
    along = ((b - a) / leg_m * (b - c) for a, b, c in zip(before, end, centre, strict=True))
    return abs(sum(along))


def is_wall_close(state: AgentState, p_s: NDArray[np.float64]) -> bool:
    """Return whether a wall is among the next URGENT_CELLS cells of the route; True if there is no route."""
    mission = state.plans.mission
    if mission is None:
        return True
    entered = 0 if state.progress is None else state.progress.cell_index
    return any(is_wall(state, p_s, cell) for cell in mission.cells[entered + 1 : entered + 1 + URGENT_CELLS])


def may_learn_of_walls(state: AgentState) -> bool:
    """Return whether new observations can turn cells into walls."""
    return math.isfinite(state.task.max_exposure)


def _swap_distance_m(state: AgentState) -> float:
    """Return the least distance to the splice point [m]: the flight by the old plan until the end of a swap.

    A vehicle that brakes for the new plan may stop up to MAX_OVERSHOOT_CELLS past the splice point.
    """
    least_s = GROUP_TURNS_AFTER_S if state.leads_group and state.membership.n_present > 1 else 0.0
    flown_m, _ = distance_and_speed_after(state, max(state.plans.swap_times.expected_s, least_s))
    change = change_for_new_plan(state)
    if change is None or not change.brakes_m_s2:
        return flown_m
    return max(flown_m, change.stops_in_m - max_overshoot_m(state.task.grid))


def is_wall(state: AgentState, p_s: NDArray[np.float64], cell: Cell) -> bool:
    """Return whether a cell of the area is a no-fly cell, or above `max_exposure`."""
    return bool(p_s[cell] > state.task.max_exposure) or not math.isfinite(p_s[cell])
