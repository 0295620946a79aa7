"""Where a new plan leaves the one that is flown: ahead of where the vehicle will be when the swap is done.

Until then it flies on as before. So a new route keeps the old one's cells up to a centre that it will not
have reached by then, by how long its own last swaps took and how fast it is. It never has to go back, nor
cuts to what lies behind it. Only where the old way leads into a wall before that, it is left at once; not
by a fixed wing, which cannot turn on the spot, nor wait for its mission. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.stopping import distance_and_speed_after
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.collision_avoidance import track_ahead
from swarmctl.core.any_angle.track import crossed_cells
from swarmctl.core.grid import Cell
from swarmctl.core.mission import Waypoint
from swarmctl.core.planar import PlanarPoint, distance_to_leg, distance_to_track

ON_ROUTE_M = 15.0
"""Farther beside its route a vehicle is not on it: it is blown off, or cuts a corner."""
OVER_M = 1.0
MOVES_M_S = 0.5
URGENT_CELLS = 3
"""A wall so near on its way is flown round at once."""


CHANGE_S = 2.0
"""for so long, at least, a fixed wing flies on along its old plan while the new one is put on it"""
TURN = math.tan(math.pi / 8.0)
"""So many radii before a turn by 45 degrees it turns off; routes turn by more only where they have room."""


@dataclass(frozen=True, slots=True)
class Splice:
    """The cells that a new route has in common with the one that is flown."""

    kept: tuple[Cell, ...]
    """from the one abreast of the vehicle on; in the last of them the new one may turn off"""
    leaves_ahead: bool = False
    """it flies these on its old plan; else it leaves that at once"""
    before: Cell | None = None
    """of the old route, before the first of them"""
    is_first_behind: bool = False
    """it has passed the centre of the first of them"""
    path: tuple[PlanarPoint, ...] = ()
    """from where it is over the centres ahead of it to the last but one (east, north) [m]"""
    lead_m: float = 0.0
    """of way to the centre of the last; or to where it leaves the track"""
    passes: tuple[Waypoint, ...] = ()
    """of a vehicle on a track: its corners until there, and that place"""


def splice_on_route(state: AgentState, start: Cell, p_s: NDArray[np.float64]) -> Splice:
    """Where a new route may leave the one that is flown, whose cell `start` is abreast of the vehicle."""
    task, swap = state.task, state.route
    if task.wings is not None:
        return Splice(kept_cells(state, start))
    here = _place_on_route(state)
    if here is None or swap is None or start not in swap.cells:
        return Splice((start,))
    index, cells = swap.cells.index(start), swap.cells
    centre = task.grid.centre_m
    is_behind = _is_behind(state, here, index)
    first = index + 1 if is_behind else index
    if first >= len(cells):
        return Splice((start,))
    way, lead_m, least_m = [here], math.dist(here, centre(cells[first])), _flies_on_m(state)
    for last in range(first, len(cells)):
        if last > first:
            way.append(centre(cells[last - 1]))
            lead_m += math.dist(way[-1], centre(cells[last]))
        if _is_wall(state, p_s, cells[last]):
            return Splice((start,))
        if lead_m >= least_m:
            break
    before = cells[index - 1] if index > 0 else None
    return Splice(cells[index : last + 1], True, before, is_behind, tuple(way), lead_m)


def kept_cells(state: AgentState, start: Cell) -> tuple[Cell, ...]:
    """Of the route that a fixed wing flies, the cells from `start` on that a new one begins with as well: it
    needs room for its turn. In the last of them it may turn off. `start` alone where no route is flown."""
    task, swap, vehicle = state.task, state.route, state.vehicle
    if state.phase is not Phase.FLYING or swap is None or start not in swap.cells:
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


def splice_on_track(state: AgentState, p_s: NDArray[np.float64]) -> Splice:
    """Where a new route may leave the track that is flown: where the vehicle will be when it has it."""
    swap, vehicle, grid = state.route, state.vehicle, state.task.grid
    assert state.cell is not None
    at_once = Splice((state.cell,))
    if swap is None or vehicle.lat_deg is None or vehicle.lon_deg is None or vehicle.mode_role != "mission":
        return at_once
    here = grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    corners = [(*grid.frame.to_local(p.lat_deg, p.lon_deg), p.alt_rel_m) for p in swap.plan.waypoints]
    passed, lead_m, least_m = [here], 0.0, _flies_on_m(state)
    for east_m, north_m, _ in track_ahead(corners, (*here, 0.0)):
        leg_m = math.dist(passed[-1], (east_m, north_m))
        share = min((least_m - lead_m) / leg_m, 1.0) if leg_m > 0.0 else 1.0
        (e, n), lead_m = passed[-1], lead_m + share * leg_m
        passed.append((e + share * (east_m - e), n + share * (north_m - n)))
        if lead_m >= least_m:
            break
    cell = grid.cell_at(*grid.frame.to_geodetic(*passed[-1]))
    size_m = grid.cell_size_m
    over = crossed_cells([(e / size_m, n / size_m) for e, n in passed]).cells[1:]
    if cell is None or lead_m < least_m or any(_is_wall(state, p_s, at) for at in over):
        return at_once
    passes = [Waypoint(*grid.frame.to_geodetic(*point), state.height_m) for point in passed[1:]]
    return Splice((cell,), True, None, False, tuple(passed[:-1]), lead_m, tuple(passes))


def is_urgent(state: AgentState, p_s: NDArray[np.float64]) -> bool:
    """Whether a wall has come up close before the vehicle: it is given another plan at once."""
    swap = state.route
    if swap is None:
        return True
    near = swap.cells[state.progress + 1 : state.progress + 1 + URGENT_CELLS]
    return any(_is_wall(state, p_s, cell) for cell in near)


def may_learn_of_walls(state: AgentState) -> bool:
    """Whether what is learned can make walls."""
    return math.isfinite(state.task.max_exposure)


def _place_on_route(state: AgentState) -> PlanarPoint | None:
    """Where a vehicle is (east, north) [m] that flies along its lattice route; None where it does not."""
    vehicle, swap, grid = state.vehicle, state.route, state.task.grid
    if state.phase is not Phase.FLYING or vehicle.mode_role != "mission" or swap is None:
        return None
    if swap.track is not None or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return None
    here = grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    near = [grid.centre_m(cell) for cell in swap.cells[max(state.progress - 1, 0) : state.progress + 3]]
    return here if distance_to_track(here, near) <= ON_ROUTE_M else None


def _is_behind(state: AgentState, here: PlanarPoint, index: int) -> bool:
    """Whether it is past the centre of a cell of its route, or over it."""
    assert state.route is not None
    vehicle, cells, centre = state.vehicle, state.route.cells, state.task.grid.centre_m
    at = centre(cells[index])
    east_m, north_m = here[0] - at[0], here[1] - at[1]
    if math.hypot(east_m, north_m) <= OVER_M:
        return True
    if vehicle.ground_speed_m_s >= MOVES_M_S:
        return east_m * vehicle.east_m_s + north_m * vehicle.north_m_s >= 0.0
    # It stands: it is past it where it is nearer to the leg behind than to the one before.
    if index + 1 == len(cells):
        return False
    after = distance_to_leg(here, at, centre(cells[index + 1]))
    return index == 0 or after < distance_to_leg(here, centre(cells[index - 1]), at)


def _flies_on_m(state: AgentState) -> float:
    """How far it flies along its old plan before it has a new one."""
    return distance_and_speed_after(state, state.swap_times.expected_s)[0]


def _is_wall(state: AgentState, p_s: NDArray[np.float64], cell: Cell) -> bool:
    return bool(p_s[cell] > state.task.max_exposure) or not math.isfinite(p_s[cell])
