"""The splice point: the point ahead of the vehicle at which a new route leaves the present route. Pure.

The vehicle flies on during the swap. So the new route keeps the cells of the old route up to a centre that
the vehicle reaches after the swap. The distance to that centre follows from the vehicle's speed and from the
durations of its last swaps.

A wall is a no-fly cell, or a cell above `max_exposure`. If the old route has a wall before the splice point,
a copter leaves the route at once. A fixed wing stays on the route: it can neither turn on the spot nor wait.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.stopping import distance_and_speed_after, stop_for_new_plan
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import track_ahead
from swarmctl.core.any_angle.track import crossed_cells
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint, distance_to_leg, distance_to_track
from swarmctl.core.route import MAX_OVERSHOOT_CELLS

ON_ROUTE_M = 15.0
"""Greatest distance from the route at which a vehicle counts as on its route, in small cells [m]."""
ON_ROUTE_CELLS = 0.5
"""The same distance in cells from 30 m on [cells]; a copter that stopped past a splice point is beside it."""
OVERHEAD_M = 1.0
"""Greatest distance from a centre at which a vehicle counts as over the centre [m]."""
MOVING_M_S = 0.5
"""Least speed that shows a direction of flight [m/s]."""
URGENT_CELLS = 3
"""Number of cells ahead in which a wall requires a new plan at once."""
CHANGE_S = 2.0
"""Least time for which a fixed wing flies on by its old plan during a swap [s]."""
TURN_OFF_RADII = math.tan(math.pi / 8.0)
"""Distance before a turn by 45° at which a fixed wing turns off [turn radii]."""


@dataclass(frozen=True, slots=True)
class Splice:
    """The common part of the present route and a new route."""

    kept: tuple[Cell, ...]
    """common cells, from the cell beside the vehicle to the cell in which the new route may turn off"""
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


def splice_on_route(state: AgentState, start: Cell, p_s: NDArray[np.float64]) -> Splice:
    """Return the splice for a new route from the present route; `start` is the vehicle's route cell."""
    task, swap = state.task, state.route
    if task.wings is not None:
        return Splice(kept_cells(state, start))
    here = _position_on_route(state)
    if here is None or swap is None or start not in swap.cells:
        return Splice((start,))
    index, cells = swap.cells.index(start), swap.cells
    centre = task.grid.centre_m
    is_passed = _is_centre_passed(state, here, index)
    first = index + 1 if is_passed else index
    if first >= len(cells):
        return Splice((start,))
    path, lead_m, least_m = [here], math.dist(here, centre(cells[first])), _swap_distance_m(state)
    for last in range(first, len(cells)):
        if last > first:
            path.append(centre(cells[last - 1]))
            lead_m += math.dist(path[-1], centre(cells[last]))
        if _is_wall(state, p_s, cells[last]):
            return Splice((start,))
        if lead_m >= least_m:
            break
    before = cells[index - 1] if index > 0 else None
    return Splice(cells[index : last + 1], True, before, is_passed, tuple(path), lead_m)


def kept_cells(state: AgentState, start: Cell) -> tuple[Cell, ...]:
    """Return the cells of a fixed wing's route, from `start` on, that a new route keeps as room for the turn.

    The new route may turn off in the last cell. The result is `start` alone if the vehicle is not on a route.
    """
    task, swap, vehicle = state.task, state.route, state.vehicle
    if state.phase is not Phase.FLYING or swap is None or start not in swap.cells:
        return (start,)
    if vehicle.lat_deg is None or vehicle.lon_deg is None:
        return (start,)
    here = task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    ahead = swap.cells[swap.cells.index(start) :]
    change_s = max(CHANGE_S, state.swap_times.expected_s)
    least_m = TURN_OFF_RADII * task.turn_radius_m + change_s * task.arrival.speed_m_s
    for last in range(1, len(ahead)):
        if math.dist(here, task.grid.centre_m(ahead[last])) >= least_m:
            return ahead[: last + 1]
    return ahead


def splice_on_track(state: AgentState, p_s: NDArray[np.float64]) -> Splice:
    """Return the splice for a new route from the present track: the position at the end of the swap."""
    swap, vehicle, grid = state.route, state.vehicle, state.task.grid
    assert state.cell is not None
    at_once = Splice((state.cell,))
    if swap is None or vehicle.lat_deg is None or vehicle.lon_deg is None or vehicle.mode_role != "mission":
        return at_once
    here = grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    corners = [(*grid.frame.to_local(p.lat_deg, p.lon_deg), p.alt_rel_m) for p in swap.plan.waypoints]
    path, lead_m, least_m = [here], 0.0, _swap_distance_m(state)
    for east_m, north_m, _ in track_ahead(corners, (*here, 0.0)):
        leg_m = math.dist(path[-1], (east_m, north_m))
        share = min((least_m - lead_m) / leg_m, 1.0) if leg_m > 0.0 else 1.0
        (e, n), lead_m = path[-1], lead_m + share * leg_m
        path.append((e + share * (east_m - e), n + share * (north_m - n)))
        if lead_m >= least_m:
            break
    cell = grid.cell_at(*grid.frame.to_geodetic(*path[-1]))
    size_m = grid.cell_size_m
    crossed = crossed_cells([(e / size_m, n / size_m) for e, n in path]).cells[1:]
    if cell is None or lead_m < least_m or any(_is_wall(state, p_s, at) for at in crossed):
        return at_once
    lead_waypoints = [Waypoint(*grid.frame.to_geodetic(*point), state.height_m) for point in path[1:]]
    return Splice((cell,), True, None, False, tuple(path[:-1]), lead_m, tuple(lead_waypoints))


def is_wall_close(state: AgentState, p_s: NDArray[np.float64]) -> bool:
    """Return whether a wall is among the next URGENT_CELLS cells of the route; True if there is no route."""
    swap = state.route
    if swap is None:
        return True
    near = swap.cells[state.progress + 1 : state.progress + 1 + URGENT_CELLS]
    return any(_is_wall(state, p_s, cell) for cell in near)


def may_learn_of_walls(state: AgentState) -> bool:
    """Return whether new observations can turn cells into walls."""
    return math.isfinite(state.task.max_exposure)


def _position_on_route(state: AgentState) -> PlanarPoint | None:
    """Return the vehicle's position; None if the vehicle is not on the track of its lattice route."""
    vehicle, swap, grid = state.vehicle, state.route, state.task.grid
    if state.phase is not Phase.FLYING or vehicle.mode_role != "mission" or swap is None:
        return None
    if swap.track is not None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return None
    here = grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    track = flown_track(grid, swap.plan, vehicle.takeoff_lat_lon)
    greatest_m = max(ON_ROUTE_M, ON_ROUTE_CELLS * grid.cell_size_m)
    return here if distance_to_track(here, track) <= greatest_m else None


def flown_track(grid: Grid, plan: FlightPlan, takeoff: LatLon | None) -> list[PlanarPoint]:
    """Return the points of a plan's flight: its begin in the air or the take-off, waypoints, landing."""
    points = [(p.lat_deg, p.lon_deg) for p in (*plan.waypoints, plan.landing)]
    if plan.begins is None and takeoff is not None:
        points.insert(0, takeoff)
    return [grid.frame.to_local(*point) for point in points]


def _is_centre_passed(state: AgentState, here: PlanarPoint, index: int) -> bool:
    """Return whether the vehicle is over or past the centre of a cell of its route."""
    assert state.route is not None
    vehicle, cells, centre = state.vehicle, state.route.cells, state.task.grid.centre_m
    at = centre(cells[index])
    east_m, north_m = here[0] - at[0], here[1] - at[1]
    if math.hypot(east_m, north_m) <= OVERHEAD_M:
        return True
    if vehicle.ground_speed_m_s >= MOVING_M_S:
        return east_m * vehicle.east_m_s + north_m * vehicle.north_m_s >= 0.0
    # A vehicle at rest has passed the centre if the next leg is nearer than the previous leg.
    if index + 1 == len(cells):
        return False
    after = distance_to_leg(here, at, centre(cells[index + 1]))
    if index > 0:
        return after < distance_to_leg(here, centre(cells[index - 1]), at)
    # A plan that begins past the first centre has no waypoint there.
    begin, first = flown_track(state.task.grid, state.route.plan, vehicle.takeoff_lat_lon)[:2]
    return math.dist(first, at) > OVERHEAD_M or after < distance_to_leg(here, begin, first)


def _swap_distance_m(state: AgentState) -> float:
    """Return the least distance to the splice point [m]: the flight by the old plan until the end of a swap.

    A vehicle that brakes for the new plan may stop up to MAX_OVERSHOOT_CELLS past the splice point.
    """
    flown_m, stop = distance_and_speed_after(state, state.swap_times.expected_s)[0], stop_for_new_plan(state)
    if stop is None:
        return flown_m
    return max(flown_m, stop.stops_in_m - MAX_OVERSHOOT_CELLS * state.task.grid.cell_size_m)


def _is_wall(state: AgentState, p_s: NDArray[np.float64], cell: Cell) -> bool:
    return bool(p_s[cell] > state.task.max_exposure) or not math.isfinite(p_s[cell])
