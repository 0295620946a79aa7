"""Checks of a configuration across its sections, before anything starts. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator

import numpy as np

from swarmctl.agent.formation.group_planner import leads_first
from swarmctl.agent.replan.decide import first_flight, first_problem, first_route
from swarmctl.agent.state import Task
from swarmctl.config.arrival_checks import check_arrival, check_time_bounds, unmet_time_bound
from swarmctl.config.communication_checks import check_communication
from swarmctl.config.formations_checks import check_formations, check_groups, check_planes_in_groups
from swarmctl.config.links_checks import check_links
from swarmctl.config.model import Config
from swarmctl.config.preflight_checks import check_preflight
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.scenario import Scenario, build
from swarmctl.config.separation_checks import check_separation
from swarmctl.config.specs import Spec, entry_of, on_border, simulated_goals
from swarmctl.config.threats import Binomial, Drawn, Poisson, Uniform, Weights
from swarmctl.config.wings_checks import check_landings, check_plane, check_wings
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.records import replace
from swarmctl.core.route import greatest_landing_spacing_m
from swarmctl.links.url import parse_url
from swarmctl.planners import PLANNERS, BoundTooTight, Route, Unreachable

MAX_ALTITUDE_M = 1000.0
MAX_CELLS = 4_000_000
MIN_START_DISTANCE_M = 1.0


def check_config(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems across sections. Flights are checked only if the sections agree with each other."""
    grid = config.grid
    if grid.n_cells > MAX_CELLS:
        text = f"{grid.rows} × {grid.cols} are {grid.n_cells} cells, more than {MAX_CELLS}; use larger cells"
        yield ConfigProblem(("area",), text)
        return
    problems = [*_check_unused(config), *_check_threats(config, grid), *_check_vehicles(config, grid)]
    problems += check_communication(config)
    problems += check_formations(config)
    problems += check_links(config)
    problems += check_preflight(config)
    # Other problems of planes are left out until no plane is in a group: they may concern only that plane.
    problems += list(check_planes_in_groups(config)) or check_wings(config)
    if config.simulate is None and not config.vehicles:
        text = "there is no vehicle; add `simulate: {count: 5}`, or a list of vehicles"
        problems.append(ConfigProblem(("vehicles",), text))
    yield from problems
    if not problems:
        yield from _check_flights(build(config))


def _check_flights(scenario: Scenario) -> Iterator[ConfigProblem]:
    simulate = scenario.config.simulate
    n_simulated = simulate.count if simulate is not None else 0
    yield from _check_starts(scenario)
    routes: dict[int, Route] = {}
    groups = list(check_groups(scenario))
    # Only a group without problems has shapes to plan a route for.
    tasks = [replace(task, formation=None) if groups else task for task in scenario.tasks]
    for index, (spec, task) in enumerate(zip(scenario.specs, tasks, strict=True)):
        here: KeyPath = ("simulate",) if index < n_simulated else ("vehicles", index - n_simulated)
        yield from _check_approach(scenario, spec, here)
        yield from _check_landing(scenario, task, (*here, "goal"))
        yield from check_plane(scenario, spec, task, here)
        if spec.altitude_m > MAX_ALTITUDE_M:
            text = f"{spec.name} would fly at {spec.altitude_m:g} m, above {MAX_ALTITUDE_M:g} m; lower the "
            text += "step, or flight.altitude_m"
            yield ConfigProblem(("flight", "altitude_step_m"), text)
        try:
            route = first_route(task, scenario.prior)
        except BoundTooTight as error:
            yield from unmet_time_bound(task, error.nearest, here)
        except Unreachable as error:
            if (least := _least_max_exposure(task, scenario)) is not None:
                text = f"{task.name} cannot reach its goal: {task.max_exposure:g} excludes every route"
                yield ConfigProblem(("planner", "max_exposure"), f"{text}; give {least:g} or more")
                continue
            if leads_first(task):
                yield _group_without_route(scenario, task, error)
                continue
            text = f"{task.name} cannot reach its goal: {error}; open a passage in area.no_fly"
            yield ConfigProblem((*here, "goal"), text)
        else:
            routes[spec.sysid] = route
            yield from _check_turns(scenario, task, route, (*here, "turn_radius_m"))
    yield from check_landings(scenario)
    yield from groups
    yield from check_separation(scenario, routes)


def _group_without_route(scenario: Scenario, task: Task, error: Unreachable) -> ConfigProblem:
    assert task.formation is not None
    names = [section.name for section in scenario.config.formations]
    text = f"{error}; set a narrow_shape that is narrower, such as a column, or open a passage in area.no_fly"
    return ConfigProblem(("formations", names.index(task.formation.name), "shape"), text)


def _least_max_exposure(task: Task, scenario: Scenario) -> float | None:
    """Return the least `max_exposure` above the configured value that gives a route; None: no value does."""
    exposure = first_problem(task, scenario.prior).exposure
    levels = np.unique(exposure[np.isfinite(exposure) & (exposure > task.max_exposure)])

    def is_open(level: float) -> bool:
        try:
            first_route(replace(task, max_exposure=level), scenario.prior)
        except BoundTooTight:
            return True
        except Unreachable:
            return False
        return True

    index = bisect_left(levels, True, key=lambda level: is_open(float(level)))
    # The value is rounded up, so that the printed value gives a route.
    return None if index == levels.size else math.ceil(float(levels[index]) * 1e4) / 1e4


def _check_turns(scenario: Scenario, task: Task, route: Route, path: KeyPath) -> Iterator[ConfigProblem]:
    if task.turn_radius_m == 0.0:
        return
    if not scenario.config.flight.any_angle:
        text = "turns are planned on straightened routes only; set flight.any_angle: true"
        yield ConfigProblem(path, text)
        return
    if task.any_angle is None:
        return  # a member of a group, whose mission is never straightened
    side_m = max(scenario.grid.size_east_m, scenario.grid.size_north_m)
    if task.turn_radius_m > side_m:
        text = f"{task.turn_radius_m:g} m is more than the longest side of the area, {side_m:g} m; lower it"
        yield ConfigProblem(path, text)
        return
    try:
        first_flight(task, first_problem(task, scenario.prior), route)
    except Unreachable as error:
        text = f"{task.name} cannot fly its first route: {error}"
        advice = "use larger cells, or another entry or goal"
        yield ConfigProblem(path, f"{text}; {advice}{', or widen preflight.fence' if task.wings else ''}")


def _check_starts(scenario: Scenario) -> Iterator[ConfigProblem]:
    """Yield the problem of the first two vehicles that start at one position."""
    frame = scenario.grid.frame
    starts = sorted((frame.to_local(*spec.start), spec.name) for spec in scenario.specs)
    for k, (here, name) in enumerate(starts):
        for there, other in starts[k + 1 :]:
            if there[0] - here[0] >= MIN_START_DISTANCE_M:
                break
            if math.dist(here, there) < MIN_START_DISTANCE_M:
                text = f"{name} and {other} start less than {MIN_START_DISTANCE_M:g} m apart; move one start"
                yield ConfigProblem(("vehicles",), text)
                return


def _check_approach(scenario: Scenario, spec: Spec, here: KeyPath) -> Iterator[ConfigProblem]:
    """Yield the problem of a straight flight to the entry over no_fly, or across other cells of the area."""
    grid = scenario.grid
    approach = (grid.frame.to_local(*spec.start), grid.centre_m(spec.entry))
    over = {cell for cell in cells_under(approach, grid.cell_size_m) if grid.contains(cell)}
    forbidden = sorted(over & set(scenario.config.area.no_fly))
    far = sorted(c for c in over if max(abs(c[0] - spec.entry[0]), abs(c[1] - spec.entry[1])) > 1)
    key = (*here, "entry") if here[0] == "vehicles" else here
    if forbidden:
        text = f"{spec.name} would fly over {forbidden[0]} of area.no_fly from its start to {spec.entry}"
        yield ConfigProblem(key, f"{text}; give it another start or entry")
    elif far and grid.cell_at(*spec.start) is None:
        text = f"{spec.name} would cross the area over {far[0]} from its start straight to {spec.entry}"
        yield ConfigProblem(key, f"{text}; give it an entry on the side of its start")


def _check_landing(scenario: Scenario, task: Task, path: KeyPath) -> Iterator[ConfigProblem]:
    limit_m = scenario.config.separation.horizontal_m
    apart_m = greatest_landing_spacing_m(scenario.grid.cell_size_m, task.landing_count)
    if task.landing_count > 1 and apart_m < limit_m:
        text = f"{task.landing_count} vehicles with common goals would land {apart_m:.1f} m apart in one cell"
        remedy = "give them goals of their own, or use larger cells"
        yield ConfigProblem(path, f"{text}, less than separation.horizontal_m = {limit_m:g} m; {remedy}")


def _check_unused(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of keys without effect. `psi_per_cell` always affects the paper's routes in `plan`."""
    planner, flight = config.planner, config.flight
    if "w" in planner.model_fields_set and not PLANNERS[planner.name].USES_W:
        users = " or ".join(name for name, other in PLANNERS.items() if other.USES_W)
        text = f"planner {planner.name} does not use w; remove it, or set planner.name: {users}"
        yield ConfigProblem(("planner", "w"), text)
    if planner.benevolence > 0.0 and not PLANNERS[planner.name].USES_W:
        text = f"planner {planner.name} does not use Eq. 5, which benevolence changes; set it to 0, or "
        text += "planner.name: dijkstra"
        yield ConfigProblem(("planner", "benevolence"), text)
    if planner.benevolence > 0.0 and flight.any_angle:
        text = "straightened routes lose the detours of benevolence; set it to 0, or flight.any_angle: false"
        yield ConfigProblem(("planner", "benevolence"), text)
    if "any_angle_exposure" in flight.model_fields_set and not flight.any_angle:
        text = "has no effect without flight.any_angle: true; set flight.any_angle, or remove this key"
        yield ConfigProblem(("flight", "any_angle_exposure"), text)


def _check_threats(config: Config, grid: Grid) -> Iterator[ConfigProblem]:
    key, most = _most_hostiles(config)
    if most > grid.n_cells:
        text = f"{most:g} hostiles do not fit into {grid.n_cells} cells, one in each; lower the number"
        yield ConfigProblem(("threats", "count", *key), text)
    hostiles = config.threats.hostiles
    if isinstance(hostiles, tuple):
        yield from _outside(grid, hostiles, ("threats", "hostiles"), "hostile")
        if len(set(hostiles)) < len(hostiles):
            yield ConfigProblem(("threats", "hostiles"), "a cell is listed twice; list each cell once")
    elif isinstance(hostiles, Drawn):
        for name, number in (("count", hostiles.count), ("clusters", hostiles.clusters)):
            if number is not None and number > grid.n_cells:
                text = f"{number} exceeds the {grid.n_cells} cells of the area; lower it"
                yield ConfigProblem(("threats", "hostiles", name), text)
    yield from _outside(grid, config.area.no_fly, ("area", "no_fly"), "cell")


def _most_hostiles(config: Config) -> tuple[KeyPath, float]:
    """Return the key of the greatest announced number, and the number; for `poisson` the mean."""
    match config.threats.count:
        case Poisson(mean=mean):
            return ("mean",), mean
        case Binomial(trials=trials):
            return ("trials",), trials
        case Uniform(max=greatest):
            return ("max",), greatest
        case Weights(weights=weights):
            return ("weights", str(max(weights))), max(weights)
        case n:
            return (), n


def _check_vehicles(config: Config, grid: Grid) -> Iterator[ConfigProblem]:
    if config.simulate is not None:
        yield from _check_simulate(config, grid)
    no_fly = set(config.area.no_fly)
    for i, vehicle in enumerate(config.vehicles):
        here: KeyPath = ("vehicles", i)
        yield from _outside(grid, vehicle.goal, (*here, "goal"), "goal")
        if no_fly.issuperset(vehicle.goal):
            yield ConfigProblem((*here, "goal"), "every goal cell is in area.no_fly; give another goal")
        yield from _check_entry(config, grid, i)
    yield from check_time_bounds(config)
    yield from check_arrival(config)
    yield from _check_identities(config)


def _check_simulate(config: Config, grid: Grid) -> Iterator[ConfigProblem]:
    simulate = config.simulate
    assert simulate is not None
    if simulate.goal is not None:
        yield from _outside(grid, simulate.goal, ("simulate", "goal"), "goal")
    no_fly = set(config.area.no_fly)
    for i in range(simulate.count):
        goals = simulated_goals(config, grid, i)
        if no_fly.issuperset(goals):
            key = "goal" if simulate.goal is not None else "goal_side"
            text = f"uav{i + 1}: every goal cell, {list(goals)}, is in area.no_fly; give another goal"
            yield ConfigProblem(("simulate", key), text)
    if entry_of(config, grid, grid.frame.to_geodetic(-1.0, -1.0)) is None:
        text = "every border cell is in area.no_fly, so no vehicle can enter the area; free a border cell"
        yield ConfigProblem(("area", "no_fly"), text)
    if simulate.start_distance_m > config.flight.max_start_distance_m:
        text = (
            f"{simulate.start_distance_m:g} m is more than flight.max_start_distance_m = "
            f"{config.flight.max_start_distance_m:g} m; lower it"
        )
        yield ConfigProblem(("simulate", "start_distance_m"), text)
    endpoint = parse_url(simulate.url)
    if not endpoint.listens:
        yield ConfigProblem(
            ("simulate", "url"), f"the ground station listens here; give udpin or tcpin, not {simulate.url!r}"
        )
    if simulate.speedup != 1.0 and config.vehicles:
        text = f"{simulate.speedup:g} is impossible beside `vehicles`, which fly in real time; set it to 1"
        yield ConfigProblem(("simulate", "speedup"), text)


def _check_entry(config: Config, grid: Grid, index: int) -> Iterator[ConfigProblem]:
    vehicle = config.vehicles[index]
    here: KeyPath = ("vehicles", index)
    start = (vehicle.start.lat_deg, vehicle.start.lon_deg)
    inside = grid.cell_at(*start)
    if inside is not None and inside in config.area.no_fly:
        text = f"the start is in cell {inside} of area.no_fly; move it"
        yield ConfigProblem((*here, "start"), text)
    if vehicle.entry is not None and (
        problems := list(_check_given_entry(config, grid, index, vehicle.entry))
    ):
        yield from problems
        return
    entry = vehicle.entry or entry_of(config, grid, start)
    if entry is None:
        text = "every border cell is in area.no_fly, so the vehicle cannot enter the area; free a border cell"
        yield ConfigProblem((*here, "start"), text)
        return
    away_m = distance_m(start, grid.centre(entry))
    if inside is None and away_m > config.flight.max_start_distance_m:
        text = (
            f"the start is {away_m:.0f} m from its entry cell, more than flight.max_start_distance_m = "
            f"{config.flight.max_start_distance_m:g} m; correct the start, or raise that limit"
        )
        yield ConfigProblem((*here, "start"), text)


def _check_given_entry(config: Config, grid: Grid, index: int, entry: Cell) -> Iterator[ConfigProblem]:
    """Yield the problem of a configured entry cell."""
    start, where = config.vehicles[index].start, ("vehicles", index, "entry")
    if (inside := grid.cell_at(start.lat_deg, start.lon_deg)) is not None:
        text = f"the start is inside the area, in cell {inside}, so there is no entry; remove this key"
        yield ConfigProblem(where, text)
    elif not grid.contains(entry):
        yield from _outside(grid, [entry], where, "entry", listed=False)
    elif not on_border(grid, entry):
        yield ConfigProblem(where, f"{entry} is not on the border of the area; give a border cell")
    elif entry in config.area.no_fly:
        yield ConfigProblem(where, f"{entry} is in area.no_fly; give another border cell")


def _check_identities(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of two vehicles with one name or one system id."""
    simulate = config.simulate
    url, count = (str(parse_url(simulate.url)), simulate.count) if simulate is not None else ("", 0)
    # sysid -> (name, link); the bus and the beliefs identify a UAV by its system id, on any link.
    seen = {n: (f"uav{n}", url) for n in range(1, count + 1)}
    for i, vehicle in enumerate(config.vehicles):
        link = str(parse_url(vehicle.url))
        if vehicle.sysid in seen:
            name, link_of_name = seen[vehicle.sysid]
            where = f"on the same link {vehicle.url}" if link_of_name == link else "in the same swarm"
            text = f"{vehicle.sysid} belongs to {name} {where}; give each vehicle its own system id"
            yield ConfigProblem(("vehicles", i, "sysid"), text)
        if vehicle.name in {name for name, _ in seen.values()}:
            yield ConfigProblem(
                ("vehicles", i, "name"), f"{vehicle.name!r} is given twice; give each vehicle its own name"
            )
        seen.setdefault(vehicle.sysid, (vehicle.name, link))


def _outside(
    grid: Grid, cells: tuple[Cell, ...] | list[Cell], path: KeyPath, what: str, *, listed: bool = True
) -> Iterator[ConfigProblem]:
    for i, cell in enumerate(cells):
        if not grid.contains(cell):
            text = (
                f"{what} {list(cell)} is outside the area: expected row 0..{grid.rows - 1} "
                f"and column 0..{grid.cols - 1}"
            )
            yield ConfigProblem((*path, i) if listed else path, text)
