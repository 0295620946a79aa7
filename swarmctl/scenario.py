"""From a `Config` to what is flown: the grid, the truth, and one `Task` a vehicle. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from swarmctl.agent import Task, first_route
from swarmctl.config import Config, Problem, Side
from swarmctl.core.belief import Belief
from swarmctl.core.events import Order
from swarmctl.core.exposure import prior_inner_exposure
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.threat import FiringStrength
from swarmctl.links.url import parse_url
from swarmctl.planners import PLANNERS, Unreachable
from swarmctl.yaml_lines import Path as KeyPath

MAX_ALTITUDE_M = 1000.0
MAX_CELLS = 4_000_000
MIN_ALTITUDES_APART_M = 1.0
MIN_STARTS_APART_M = 1.0
MIN_LANDING_APART_M = 3.0


@dataclass(frozen=True, slots=True)
class Spec:
    """One vehicle: how it is reached and where it goes."""

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


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything a run needs to know before it starts."""

    config: Config
    grid: Grid
    strength: FiringStrength
    hostiles: frozenset[Cell]
    """the truth"""
    psi_per_cell: float
    specs: tuple[Spec, ...]
    tasks: tuple[Task, ...]

    @property
    def prior(self) -> Belief:
        return Belief.prior(self.grid.rows, self.grid.cols, self.config.threats.count)


def judge(config: Config) -> Iterator[Problem]:
    """What is wrong across sections; how vehicles fly only where nothing else is wrong."""
    grid = _grid(config)
    if grid.n_cells > MAX_CELLS:
        text = f"{grid.rows} × {grid.cols} are {grid.n_cells} cells, more than {MAX_CELLS}; make them larger"
        yield Problem(("area",), text)
        return
    problems = [*_judge_threats(config, grid), *_judge_vehicles(config, grid)]
    if config.simulate is None and not config.vehicles:
        text = "no vehicle: give `simulate: {count: 5}` or a list of vehicles"
        problems.append(Problem(("vehicles",), text))
    yield from problems
    if not problems:
        yield from _judge_flights(build(config))


def build(config: Config) -> Scenario:
    """For a configuration that `judge` finds nothing wrong with. Raises Unreachable, naming the vehicle."""
    grid = _grid(config)
    s = config.threats.firing_strength
    strength = FiringStrength(s.direct, s.first_neighbour, s.second_neighbour)
    specs = tuple(_simulated(config, grid)) + tuple(_configured(config, grid))
    psi = config.planner.psi_per_cell or (
        # Without any threat every ψ gives the same routes.
        prior_inner_exposure(grid.rows, grid.cols, config.threats.count, strength) or 1.0
    )
    tasks = tuple(_tasks(config, grid, strength, psi, specs))
    return Scenario(config, grid, strength, _hostiles(config), psi, specs, tasks)


def _judge_flights(scenario: Scenario) -> Iterator[Problem]:
    simulate = scenario.config.simulate
    n_simulated = simulate.count if simulate is not None else 0
    yield from _judge_apart(scenario)
    for index, (spec, task) in enumerate(zip(scenario.specs, scenario.tasks, strict=True)):
        here: KeyPath = ("simulate",) if index < n_simulated else ("vehicles", index - n_simulated)
        yield from _judge_way_in(scenario, spec, here)
        yield from _judge_landing(scenario, task, (*here, "goal"))
        if spec.altitude_m > MAX_ALTITUDE_M:
            text = f"{spec.name} would fly at {spec.altitude_m:g} m, above {MAX_ALTITUDE_M:g}; lower the step"
            yield Problem(("flight", "altitude_step_m"), text)
        try:
            first_route(task, scenario.prior)
        except Unreachable as error:
            text = f"{task.name} cannot reach its goal: {error}; open a way in area.no_fly"
            yield Problem((*here, "goal"), text)


def _judge_apart(scenario: Scenario) -> Iterator[Problem]:
    """Altitude alone keeps vehicles apart in the air, and their starts on the ground."""
    by_altitude = sorted(scenario.specs, key=lambda spec: spec.altitude_m)
    for low, high in pairwise(by_altitude):
        if high.altitude_m - low.altitude_m < MIN_ALTITUDES_APART_M:
            text = (
                f"{low.name} and {high.name} would fly at {low.altitude_m:g} and {high.altitude_m:g} m, less "
                f"than {MIN_ALTITUDES_APART_M:g} m apart"
            )
            yield Problem(("flight", "altitude_step_m"), text)
            break
    frame = scenario.grid.frame
    starts = sorted((frame.to_local(*spec.start), spec.name) for spec in scenario.specs)
    for (here, name), (there, other) in pairwise(starts):
        if math.dist(here, there) < MIN_STARTS_APART_M:
            yield Problem(("vehicles",), f"{name} and {other} start at one spot; give each its own")
            break


def _judge_way_in(scenario: Scenario, spec: Spec, here: KeyPath) -> Iterator[Problem]:
    """A vehicle flies straight from its start to its entry; no route was planned for that."""
    grid = scenario.grid
    (east_m, north_m), (to_east_m, to_north_m) = grid.frame.to_local(*spec.start), grid.centre_m(spec.entry)
    n = 1 + math.ceil(20 * math.hypot(to_east_m - east_m, to_north_m - north_m) / grid.cell_size_m)
    over: set[Cell] = set()
    for k in range(n + 1):
        east, north = east_m + (to_east_m - east_m) * k / n, north_m + (to_north_m - north_m) * k / n
        cell = (math.floor(north / grid.cell_size_m), math.floor(east / grid.cell_size_m))
        if grid.contains(cell):
            over.add(cell)
    forbidden = sorted(over & set(scenario.config.area.no_fly))
    far = sorted(c for c in over if max(abs(c[0] - spec.entry[0]), abs(c[1] - spec.entry[1])) > 1)
    key = (*here, "entry") if here[0] == "vehicles" else here
    if forbidden:
        text = f"{spec.name} would fly over {forbidden[0]} of area.no_fly on its way in to {spec.entry}"
        yield Problem(key, f"{text}; give it another start or entry")
    elif far and grid.cell_at(*spec.start) is None:
        text = f"{spec.name} would cross the area over {far[0]} on its straight way in to {spec.entry}"
        yield Problem(key, f"{text}; give it an entry on its own side")


def _judge_landing(scenario: Scenario, task: Task, path: KeyPath) -> Iterator[Problem]:
    apart_m = scenario.grid.cell_size_m / (math.isqrt(max(task.landing_count - 1, 0)) + 1)
    if task.landing_count > 1 and apart_m < MIN_LANDING_APART_M:
        text = f"{task.landing_count} vehicles that share goals would land {apart_m:.1f} m apart in one cell"
        yield Problem(path, f"{text}, less than {MIN_LANDING_APART_M:g} m; give them goals of their own")


def _grid(config: Config) -> Grid:
    a = config.area
    return Grid(a.rows, a.cols, a.cell_size_m, a.origin_lat_deg, a.origin_lon_deg)


def _hostiles(config: Config) -> frozenset[Cell]:
    if config.threats.hostiles != "random":
        return frozenset(config.threats.hostiles)
    rows, cols = config.area.rows, config.area.cols
    rng = np.random.default_rng(config.seed)
    drawn = rng.choice(rows * cols, size=config.threats.count, replace=False)
    return frozenset((int(i) // cols, int(i) % cols) for i in drawn)


def _judge_threats(config: Config, grid: Grid) -> Iterator[Problem]:
    if config.threats.count > grid.n_cells:
        text = f"{config.threats.count} hostiles do not fit into {grid.n_cells} cells, one a cell"
        yield Problem(("threats", "count"), text)
    if config.threats.hostiles != "random":
        yield from _outside(grid, config.threats.hostiles, ("threats", "hostiles"), "hostile")
        if len(set(config.threats.hostiles)) < len(config.threats.hostiles):
            yield Problem(("threats", "hostiles"), "a cell is listed twice; a cell holds one hostile")
    yield from _outside(grid, config.area.no_fly, ("area", "no_fly"), "cell")


def _judge_vehicles(config: Config, grid: Grid) -> Iterator[Problem]:
    if config.simulate is not None:
        yield from _judge_simulate(config, grid)
    no_fly = set(config.area.no_fly)
    for i, vehicle in enumerate(config.vehicles):
        here: KeyPath = ("vehicles", i)
        yield from _outside(grid, vehicle.goal, (*here, "goal"), "goal")
        if no_fly.issuperset(vehicle.goal):
            yield Problem((*here, "goal"), "every goal cell is in area.no_fly")
        yield from _judge_entry(config, grid, i)
    yield from _judge_identities(config)


def _judge_simulate(config: Config, grid: Grid) -> Iterator[Problem]:
    simulate = config.simulate
    assert simulate is not None
    if simulate.goal is not None:
        yield from _outside(grid, simulate.goal, ("simulate", "goal"), "goal")
    no_fly = set(config.area.no_fly)
    for i in range(simulate.count):
        goals = _simulated_goals(config, grid, i)
        if no_fly.issuperset(goals):
            key = "goal" if simulate.goal is not None else "goal_side"
            text = f"uav{i + 1}: every goal cell, {list(goals)}, is in area.no_fly"
            yield Problem(("simulate", key), text)
    if _entry(config, grid, grid.frame.to_geodetic(-1.0, -1.0)) is None:
        yield Problem(("area", "no_fly"), "the area cannot be entered: no border cell is left free")
    if simulate.start_distance_m > config.flight.max_start_distance_m:
        text = (
            f"the area cannot be entered from {simulate.start_distance_m:g} m away, more than flight."
            f"max_start_distance_m = {config.flight.max_start_distance_m:g}"
        )
        yield Problem(("simulate", "start_distance_m"), text)
    endpoint = parse_url(simulate.url)
    if endpoint.kind not in ("udpin", "tcpin"):
        yield Problem(
            ("simulate", "url"), f"the ground station has to listen: udpin or tcpin, found {simulate.url!r}"
        )
    if simulate.speedup != 1.0 and config.vehicles:
        text = f"{simulate.speedup} beside vehicles in `vehicles`, which fly in real time; give 1"
        yield Problem(("simulate", "speedup"), text)


def _judge_entry(config: Config, grid: Grid, index: int) -> Iterator[Problem]:
    vehicle = config.vehicles[index]
    here: KeyPath = ("vehicles", index)
    start = (vehicle.start.lat_deg, vehicle.start.lon_deg)
    inside = grid.cell_at(*start)
    if inside is not None and inside in config.area.no_fly:
        yield Problem((*here, "start"), f"it stands in cell {inside}, which is in area.no_fly")
    if vehicle.entry is not None:
        where: KeyPath = (*here, "entry")
        if inside is not None:
            yield Problem(where, f"it starts inside the area, in cell {inside}; leave entry away")
            return
        if not grid.contains(vehicle.entry):
            yield from _outside(grid, [vehicle.entry], where, "entry", listed=False)
        elif not _on_border(grid, vehicle.entry):
            yield Problem(where, f"{vehicle.entry} is no border cell: it cannot be entered from outside")
        elif vehicle.entry in config.area.no_fly:
            yield Problem(where, f"{vehicle.entry} is in area.no_fly")
        return
    entry = _entry(config, grid, start)
    if entry is None:
        yield Problem((*here, "start"), "the area cannot be entered: its border is in area.no_fly all round")
        return
    away_m = distance_m(start, grid.centre(entry))
    if inside is None and away_m > config.flight.max_start_distance_m:
        text = (
            f"the area cannot be entered from here: it is {away_m:.0f} m away, more than flight."
            f"max_start_distance_m = {config.flight.max_start_distance_m:g}; is the position right?"
        )
        yield Problem((*here, "start"), text)


def _judge_identities(config: Config) -> Iterator[Problem]:
    """The second of two vehicles with one name or one system id is the one to change."""
    simulate = config.simulate
    url, count = (str(parse_url(simulate.url)), simulate.count) if simulate is not None else ("", 0)
    # sysid -> (name, link); the bus and the beliefs know a UAV by its system id, whatever link it is on.
    seen = {n: (f"uav{n}", url) for n in range(1, count + 1)}
    for i, vehicle in enumerate(config.vehicles):
        link = str(parse_url(vehicle.url))
        if vehicle.sysid in seen:
            name, its_link = seen[vehicle.sysid]
            where = f"on the same link {vehicle.url}" if its_link == link else "in the same swarm"
            text = f"{vehicle.sysid} is {name}'s {where}; give each vehicle its own"
            yield Problem(("vehicles", i, "sysid"), text)
        if vehicle.name in {name for name, _ in seen.values()}:
            yield Problem(("vehicles", i, "name"), f"{vehicle.name!r} is given twice; give each its own")
        seen.setdefault(vehicle.sysid, (vehicle.name, link))


def _outside(
    grid: Grid, cells: tuple[Cell, ...] | list[Cell], path: KeyPath, what: str, *, listed: bool = True
) -> Iterator[Problem]:
    for i, cell in enumerate(cells):
        if not grid.contains(cell):
            text = (
                f"{what} {list(cell)} is outside the area: expected row 0..{grid.rows - 1} "
                f"and column 0..{grid.cols - 1}"
            )
            yield Problem((*path, i) if listed else path, text)


def _on_border(grid: Grid, cell: Cell) -> bool:
    return cell[0] in (0, grid.rows - 1) or cell[1] in (0, grid.cols - 1)


def _entry(config: Config, grid: Grid, start: LatLon) -> Cell | None:
    """Where a vehicle comes in that starts here: its own cell, or the nearest border cell it may fly."""
    inside = grid.cell_at(*start)
    if inside is not None:
        return inside
    nearest = grid.nearest_border_cell(*start)
    no_fly = set(config.area.no_fly)
    if nearest not in no_fly:
        return nearest
    rim = ((r, c) for r in range(grid.rows) for c in range(grid.cols) if _on_border(grid, (r, c)))
    free = [cell for cell in rim if cell not in no_fly]
    return min(free, key=lambda cell: (distance_m(start, grid.centre(cell)), cell), default=None)


def _simulated(config: Config, grid: Grid) -> Iterator[Spec]:
    simulate = config.simulate
    if simulate is None:
        return
    for i in range(simulate.count):
        share = (i + 0.5) / simulate.count
        start = _beside(grid, simulate.start_side, share, simulate.start_distance_m, simulate.count)
        entry = _entry(config, grid, start)
        assert entry is not None
        yield Spec(
            name=f"uav{i + 1}",
            sysid=i + 1,
            url=simulate.url,
            link="direct",
            simulated=True,
            start=start,
            entry=entry,
            goals=_simulated_goals(config, grid, i),
            altitude_m=config.flight.altitude_m + i * config.flight.altitude_step_m,
            delay_s=i * simulate.delay_step_s,
        )


def _simulated_goals(config: Config, grid: Grid, index: int) -> tuple[Cell, ...]:
    simulate = config.simulate
    assert simulate is not None
    share = (index + 0.5) / simulate.count
    return simulate.goal or (_border_cell(grid, simulate.goal_side, share),)


def _beside(grid: Grid, side: Side, share: float, away_m: float, crowded: int) -> LatLon:
    """A point `away_m` outside a side at `share` of its length, opposite the middle of a cell if that has
    room for all."""
    east_m, north_m = share * grid.width_m, share * grid.height_m
    if crowded <= (grid.rows if side in ("west", "east") else grid.cols):
        east_m, north_m = grid.centre_m(_border_cell(grid, side, share))
    match side:
        case "west":
            east_m = -away_m
        case "east":
            east_m = grid.width_m + away_m
        case "south":
            north_m = -away_m
        case "north":
            north_m = grid.height_m + away_m
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
        entry = vehicle.entry or _entry(config, grid, start)
        assert entry is not None
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
        )


def _tasks(
    config: Config, grid: Grid, strength: FiringStrength, psi: float, specs: tuple[Spec, ...]
) -> Iterator[Task]:
    planner = PLANNERS[config.planner.name]
    params = planner.Params()
    no_fly = frozenset(config.area.no_fly)
    for index, spec in enumerate(specs):
        # DEVIATION: the paper's UAVs may share a place in the air and on the ground. Ours fly at altitudes of
        # their own (`Spec.altitude_m`) and land apart.
        sharing = _sharing(specs, index)
        yield Task(
            uav=spec.sysid,
            name=spec.name,
            grid=grid,
            strength=strength,
            w=config.planner.w,
            psi_per_cell=psi,
            entry=spec.entry,
            goals=tuple(g for g in spec.goals if g not in no_fly),
            altitude_m=spec.altitude_m,
            plan=lambda problem: planner.plan(problem, params),
            no_fly=no_fly,
            landing_index=sharing.index(index),
            landing_count=len(sharing),
            # A vehicle given up comes down in any case: nobody is there to end a hold.
            fallback=Order.LAND if config.flight.on_exit == "land" else Order.RETURN,
        )


def _sharing(specs: tuple[Spec, ...], index: int) -> list[int]:
    """Which vehicles have goals in common with this one, directly or by way of others: each needs a landing
    spot that none of them has."""
    group = {index}
    goals = set(specs[index].goals)
    while more := {i for i, s in enumerate(specs) if i not in group and goals & set(s.goals)}:
        group |= more
        goals |= {goal for i in more for goal in specs[i].goals}
    return sorted(group)
