"""The vehicles of a configuration, simulated and by URL, with all defaults resolved. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.config.autopilots import AUTOPILOTS, MIXED
from swarmctl.config.model import Config
from swarmctl.config.vehicles import Side, Simulate
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.vehicle import START_DELAY_S, Airframe

DEFAULT_SPEED_M_S = 10.0
"""assumed speed of a copter without `speed_m_s`: ArduCopter's default of WPNAV_SPEED"""


class Spec(msgspec.Struct, frozen=True):
    """One vehicle: its link, its start, its goals and its performance."""

    name: str
    sysid: int
    url: str
    link: str
    simulated: bool
    start: LatLon
    entry: Cell
    goals: tuple[Cell, ...]
    altitude_m: float
    delay_s: float
    speed_m_s: float = DEFAULT_SPEED_M_S
    arrive_after_s: float = 0.0
    arrive_within_s: float = math.inf
    """infinite if no latest arrival is configured"""
    turn_radius_m: float = 0.0
    airframe: Airframe = "copter"
    start_delay_s: float = START_DELAY_S
    """delay of a start from a stand [s]; for an unknown copter the longest"""


def specs_of(config: Config, grid: Grid) -> tuple[Spec, ...]:
    """Return the vehicles of `simulate`, followed by `vehicles`."""
    return (*_simulated(config, grid), *_configured(config, grid))


def on_border(grid: Grid, cell: Cell) -> bool:
    return cell[0] in (0, grid.rows - 1) or cell[1] in (0, grid.cols - 1)


def entry_of(config: Config, grid: Grid, start: LatLon) -> Cell | None:
    """Return the entry cell for a start: the start's own cell, or the nearest border cell outside no_fly.

    None for a start outside the area if no border cell is free.
    """
    inside = grid.cell_at(*start)
    if inside is not None:
        return inside
    nearest = grid.nearest_border_cell(*start)
    no_fly = set(config.area.no_fly)
    if nearest not in no_fly:
        return nearest
    border = ((r, c) for r in range(grid.rows) for c in range(grid.cols) if on_border(grid, (r, c)))
    free = [cell for cell in border if cell not in no_fly]
    return min(free, key=lambda cell: (distance_m(start, grid.centre(cell)), cell), default=None)


def _simulated(config: Config, grid: Grid) -> Iterator[Spec]:
    simulate = config.simulate
    if simulate is None:
        return
    for i, (sysid, name) in enumerate(config.identities[: simulate.count]):
        start = _start(grid, simulate, i)
        entry = entry_of(config, grid, start)
        assert entry is not None
        autopilot = AUTOPILOTS[simulated_autopilot(config, i)]
        airframe = autopilot.airframe
        is_plane = airframe == "plane"
        yield Spec(
            name=name,
            sysid=sysid,
            url=simulate.url,
            link=simulate.link,
            simulated=True,
            start=start,
            entry=entry,
            goals=simulated_goals(config, grid, i),
            altitude_m=config.flight.altitude_m + i * config.flight.altitude_step_m,
            delay_s=i * simulate.delay_step_s,
            speed_m_s=config.wings.speed_m_s if is_plane else simulate.speed_m_s,
            turn_radius_m=config.wings.turn_radius_m if is_plane else 0.0,
            airframe=airframe,
            start_delay_s=autopilot.start_delay_s,
            arrive_after_s=simulate.arrive_after_s,
            arrive_within_s=math.inf if simulate.arrive_within_s is None else simulate.arrive_within_s,
        )


def airframes_of(config: Config) -> dict[int, Airframe]:
    """Return the airframe of each vehicle, by system id."""
    n_simulated = 0 if config.simulate is None else config.simulate.count
    simulated = (simulated_airframe(config, i) for i in range(n_simulated))
    airframes = (*simulated, *(vehicle.airframe for vehicle in config.vehicles))
    return {sysid: airframe for (sysid, _), airframe in zip(config.identities, airframes, strict=True)}


def simulated_autopilot(config: Config, index: int) -> str:
    """Return the autopilot of the simulated vehicle `index`, from 0."""
    simulate = config.simulate
    assert simulate is not None
    chosen = simulate.autopilot
    if isinstance(chosen, str):
        chosen = MIXED if chosen == "mixed" else (chosen,)
    return chosen[index % len(chosen)]


def simulated_airframe(config: Config, index: int) -> Airframe:
    """Return the airframe of the simulated vehicle `index`, from 0."""
    return AUTOPILOTS[simulated_autopilot(config, index)].airframe


def simulated_goals(config: Config, grid: Grid, index: int) -> tuple[Cell, ...]:
    """Return the goal cells of the simulated vehicle `index`, from 0."""
    simulate = config.simulate
    assert simulate is not None
    share = (index + 0.5) / simulate.count
    return simulate.goal or (_border_cell(grid, simulate.goal_side, share),)


def _start(grid: Grid, simulate: Simulate, index: int) -> LatLon:
    """Return the start of the simulated vehicle `index`, outside its side.

    Spread along the side, it is opposite the centre of a cell if the side has a cell for each vehicle.
    """
    side, away_m, count = simulate.start_side, simulate.start_distance_m, simulate.count
    share = (index + 0.5) / count
    east_m, north_m = share * grid.size_east_m, share * grid.size_north_m
    if simulate.start_spacing_m is not None:
        from_middle_m = (index - 0.5 * (count - 1)) * simulate.start_spacing_m
        east_m, north_m = 0.5 * grid.size_east_m + from_middle_m, 0.5 * grid.size_north_m + from_middle_m
    elif count <= (grid.rows if side in ("west", "east") else grid.cols):
        east_m, north_m = grid.centre_m(_border_cell(grid, side, share))
    match side:
        case "west":
            east_m = -away_m
        case "east":
            east_m = grid.size_east_m + away_m
        case "south":
            north_m = -away_m
        case "north":
            north_m = grid.size_north_m + away_m
    return grid.frame.to_geodetic(east_m, north_m)


def _border_cell(grid: Grid, side: Side, share: float) -> Cell:
    row, col = math.floor(share * grid.rows), math.floor(share * grid.cols)
    match side:
        case "west":
            return row, 0
        case "east":
            return row, grid.cols - 1
        case "south":
            return 0, col
        case "north":
            return grid.rows - 1, col


def _configured(config: Config, grid: Grid) -> Iterator[Spec]:
    n_simulated = config.simulate.count if config.simulate is not None else 0
    for i, vehicle in enumerate(config.vehicles):
        start = (vehicle.start.lat_deg, vehicle.start.lon_deg)
        entry = vehicle.entry or entry_of(config, grid, start)
        assert entry is not None
        is_plane = vehicle.airframe == "plane"
        default_m_s = config.wings.speed_m_s if is_plane else DEFAULT_SPEED_M_S
        default_m = config.flight.altitude_m + (n_simulated + i) * config.flight.altitude_step_m
        yield Spec(
            name=vehicle.name,
            sysid=vehicle.sysid,
            url=vehicle.url,
            link=vehicle.link,
            simulated=False,
            start=start,
            entry=entry,
            goals=vehicle.goal,
            altitude_m=vehicle.altitude_m or default_m,
            delay_s=vehicle.delay_s,
            speed_m_s=default_m_s if vehicle.speed_m_s is None else vehicle.speed_m_s,
            arrive_after_s=vehicle.arrive_after_s,
            arrive_within_s=math.inf if vehicle.arrive_within_s is None else vehicle.arrive_within_s,
            turn_radius_m=vehicle.turn_radius_m or (config.wings.turn_radius_m if is_plane else 0.0),
            airframe=vehicle.airframe,
            start_delay_s=0.0 if is_plane else START_DELAY_S,
        )


def wings_of(config: Config, spec: Spec) -> FixedWing | None:
    """Return the performance of a fixed wing; None for a copter."""
    if spec.airframe != "plane":
        return None
    w = config.wings
    return FixedWing(
        loiter_radius_m=w.loiter_radius_m,
        final_height_m=w.final_height_m,
        glide_deg=w.glide_deg,
        min_speed_m_s=min(w.min_speed_m_s, spec.speed_m_s),
        takeoff_height_m=w.takeoff_height_m,
        home=spec.start,
        landing_heading_deg=w.landing_heading_deg,
    )
