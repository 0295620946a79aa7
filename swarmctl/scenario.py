"""From a `Config` to what is flown: the grid, the truth, and one `Task` a vehicle. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from swarmctl.agent import Arrival, Task
from swarmctl.agent.approach import Wings
from swarmctl.config import Config
from swarmctl.config_count import Binomial, Poisson, Uniform, Weights
from swarmctl.config_rules import rulings
from swarmctl.config_vehicles import Autopilot, Side
from swarmctl.core.belief import Belief
from swarmctl.core.chance import Chance, chance_of_getting_through
from swarmctl.core.events import Order
from swarmctl.core.exposure import prior_inner_exposure
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.hostiles import HostileCount
from swarmctl.core.sensor import SensorModel
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import Airframe
from swarmctl.planners import PLANNERS, method
from swarmctl.preflight.fence import ceiling_m, polygon_of
from swarmctl.rules import Fence
from swarmctl.rules.lost_link import Params as LostLink
from swarmctl.separation import Limits
from swarmctl.separation.meet import Meeting
from swarmctl.separation.watch import Separation

PAPERS = PLANNERS["dijkstra"]
"""the paper's planner, beside which every other is shown"""

PLANES = frozenset({"arduplane", "px4plane"})
"""of the simulator's autopilots"""

DEFAULT_SPEED_M_S = 10.0
"""what a vehicle is taken to fly where nobody says: ArduCopter's WPNAV_SPEED as it comes"""


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
    speed_m_s: float = DEFAULT_SPEED_M_S
    arrive_after_s: float = 0.0
    arrive_within_s: float = math.inf
    """infinite where it may take as long as it likes"""
    turn_radius_m: float = 0.0
    airframe: Airframe = "copter"


class Purpose(IntEnum):
    """What chance is drawn for."""

    SENSOR = 1
    CHANCE = 2


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
    """the vehicles that this process flies"""
    tasks: tuple[Task, ...]
    """theirs, in the same order"""
    prior: Belief
    """what every vehicle believes before it takes off"""
    swarm: tuple[Spec, ...]
    """all vehicles, wherever their agents run"""

    def only(self, uav: int) -> Scenario:
        """The same scenario, of which this process flies one vehicle."""
        here = [i for i, spec in enumerate(self.specs) if spec.sysid == uav]
        return replace(
            self, specs=tuple(self.specs[i] for i in here), tasks=tuple(self.tasks[i] for i in here)
        )

    def wings(self, spec: Spec) -> Wings | None:
        """What a plan for a vehicle that is a fixed wing has to know of it; None for what hovers."""
        return wings_of(self.config, spec)

    @property
    def chosen_by(self) -> str:
        """What chooses the routes: w, where it is the paper's planner, or the name of another."""
        planner = self.config.planner
        return f"w = {planner.w:g}" if PLANNERS[planner.name].USES_W else planner.name

    def generator(self, purpose: Purpose, uav: int) -> np.random.Generator:
        """A vehicle's own source of chance, spawned from the run's seed; the same again at each call."""
        return np.random.default_rng(np.random.SeedSequence(self.config.seed, spawn_key=(purpose, uav)))

    def chance(self, uav: int, belief: Belief, strength: FiringStrength, cells: Sequence[Cell]) -> Chance:
        """The chance that a vehicle gets through on a route, by simulation over what is believed; equal
        questions get equal answers."""
        return chance_of_getting_through(belief, strength, cells, self.generator(Purpose.CHANCE, uav))


def build(config: Config) -> Scenario:
    """For a configuration that `judge` finds nothing wrong with. Raises Unreachable, naming the vehicle."""
    grid = grid_of(config)
    s = config.threats.firing_strength
    strength = FiringStrength(s.direct, s.first_neighbour, s.second_neighbour)
    specs = tuple(_simulated(config, grid)) + tuple(_configured(config, grid))
    count = count_of(config)
    psi = config.planner.psi_per_cell or (
        # Without any threat every ψ gives the same routes.
        prior_inner_exposure(grid.rows, grid.cols, count.mean, strength) or 1.0
    )
    tasks = tuple(_tasks(config, grid, strength, psi, specs))
    sensor = SensorModel(config.sensor.p_miss, config.sensor.p_false_alarm)
    prior = Belief.prior(grid.rows, grid.cols, count, sensor)
    scenario = Scenario(config, grid, strength, _hostiles(config, count), psi, specs, tasks, prior, specs)
    corners_m = tuple(grid.frame.to_local(*corner) for corner in polygon_of(scenario))
    fence = Fence(corners_m, ceiling_m(scenario))
    return replace(scenario, tasks=tuple(replace(task, fence=fence) for task in tasks))


def grid_of(config: Config) -> Grid:
    a = config.area
    return Grid(a.rows, a.cols, a.cell_size_m, a.origin_lat_deg, a.origin_lon_deg)


def count_of(config: Config) -> HostileCount:
    """How many hostiles the UAVs are told there are."""
    match config.threats.count:
        case Poisson(mean=mean):
            return HostileCount.poisson(mean, config.area.rows * config.area.cols)
        case Binomial(trials=trials, p=p):
            return HostileCount.binomial(trials, p)
        case Uniform(min=least, max=greatest):
            return HostileCount.uniform(least, greatest)
        case Weights(weights=weights):
            return HostileCount.weighted(weights)
        case n:
            return HostileCount.known(n)


def _hostiles(config: Config, count: HostileCount) -> frozenset[Cell]:
    if config.threats.hostiles != "random":
        return frozenset(config.threats.hostiles)
    rows, cols = config.area.rows, config.area.cols
    rng = np.random.default_rng(config.seed)
    drawn = rng.choice(rows * cols, size=count.draw(rng), replace=False)
    return frozenset((int(i) // cols, int(i) % cols) for i in drawn)


def on_border(grid: Grid, cell: Cell) -> bool:
    return cell[0] in (0, grid.rows - 1) or cell[1] in (0, grid.cols - 1)


def entry_of(config: Config, grid: Grid, start: LatLon) -> Cell | None:
    """Where a vehicle comes in that starts here: its own cell, or the nearest border cell it may fly."""
    inside = grid.cell_at(*start)
    if inside is not None:
        return inside
    nearest = grid.nearest_border_cell(*start)
    no_fly = set(config.area.no_fly)
    if nearest not in no_fly:
        return nearest
    rim = ((r, c) for r in range(grid.rows) for c in range(grid.cols) if on_border(grid, (r, c)))
    free = [cell for cell in rim if cell not in no_fly]
    return min(free, key=lambda cell: (distance_m(start, grid.centre(cell)), cell), default=None)


def _simulated(config: Config, grid: Grid) -> Iterator[Spec]:
    simulate = config.simulate
    if simulate is None:
        return
    for i in range(simulate.count):
        share = (i + 0.5) / simulate.count
        start = _beside(grid, simulate.start_side, share, simulate.start_distance_m, simulate.count)
        entry = entry_of(config, grid, start)
        assert entry is not None
        is_plane = simulated_autopilot(config, i) in PLANES
        yield Spec(
            name=f"uav{i + 1}",
            sysid=i + 1,
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
            airframe="plane" if is_plane else "copter",
            arrive_after_s=simulate.arrive_after_s,
            arrive_within_s=math.inf if simulate.arrive_within_s is None else simulate.arrive_within_s,
        )


def simulated_autopilot(config: Config, index: int) -> Autopilot:
    """What the simulated vehicle `index` speaks like."""
    simulate = config.simulate
    assert simulate is not None
    chosen = simulate.autopilot
    if isinstance(chosen, str) and chosen != "mixed":
        return chosen
    turns: tuple[Autopilot, ...] = ("ardupilot", "px4") if chosen == "mixed" else chosen
    return turns[index % len(turns)]


def simulated_goals(config: Config, grid: Grid, index: int) -> tuple[Cell, ...]:
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
        )


def _tasks(
    config: Config, grid: Grid, strength: FiringStrength, psi: float, specs: tuple[Spec, ...]
) -> Iterator[Task]:
    planner = config.planner
    chosen = method(planner.name, PLANNERS[planner.name], planner.options)
    no_fly = frozenset(config.area.no_fly)
    policy = config.preflight.policy
    agreed = LostLink(does=policy.lost_link, after_s=float(policy.lost_link_after_s))
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
            method=chosen,
            arrival=_arrival(grid, spec),
            max_exposure=math.inf if planner.max_exposure is None else planner.max_exposure,
            no_fly=no_fly,
            landing_index=sharing.index(index),
            landing_count=len(sharing),
            any_angle=config.flight.any_angle_exposure if config.flight.any_angle else None,
            turn_radius_m=spec.turn_radius_m,
            wings=wings_of(config, spec),
            # A vehicle given up comes down in any case: nobody is there to end a hold.
            fallback=Order.LAND if config.flight.on_exit == "land" else Order.RETURN,
            rules=rulings(config.rules, agreed),
            separation=separation_of(config),
            meeting=_meeting(config, specs),
        )


def wings_of(config: Config, spec: Spec) -> Wings | None:
    """None for what hovers."""
    if spec.airframe != "plane":
        return None
    w = config.wings
    return Wings(
        loiter_radius_m=w.loiter_radius_m,
        final_height_m=w.final_height_m,
        glide_deg=w.glide_deg,
        min_speed_m_s=min(w.min_speed_m_s, spec.speed_m_s),
        takeoff_height_m=w.takeoff_height_m,
        home=spec.start,
        landing_heading_deg=w.landing_heading_deg,
    )


def _meeting(config: Config, specs: Sequence[Spec]) -> Meeting | None:
    together = config.arrival
    if together is None:
        return None
    rank = {uav: i for i, uav in enumerate(sorted(spec.sysid for spec in specs))}
    return Meeting(rank, together.spacing_s or 0.0, together.tolerance_s, together.slowest_m_s)


def separation_of(config: Config) -> Separation:
    apart = config.separation
    return Separation(Limits(apart.horizontal_m, apart.vertical_m), apart.look_ahead_s, apart.action)


def _arrival(grid: Grid, spec: Spec) -> Arrival:
    approach_m = distance_m(spec.start, grid.centre(spec.entry))
    return Arrival(spec.speed_m_s, spec.arrive_after_s, spec.arrive_within_s, approach_m)


def _sharing(specs: tuple[Spec, ...], index: int) -> list[int]:
    """Which vehicles have goals in common with this one, directly or by way of others: each needs a landing
    spot that none of them has."""
    group = {index}
    goals = set(specs[index].goals)
    while more := {i for i, s in enumerate(specs) if i not in group and goals & set(s.goals)}:
        group |= more
        goals |= {goal for i in more for goal in specs[i].goals}
    return sorted(group)
