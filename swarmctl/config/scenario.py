"""The scenario of a configuration: the grid, the true hostiles, and one `Task` for each vehicle. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import IntEnum

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.arrival.common_time import ArrivalGroup
from swarmctl.agent.failsafes.base import Fence
from swarmctl.agent.failsafes.lost_link import Params as LostLink
from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.membership import Formation
from swarmctl.agent.replan.length_bounds import TimeBound
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.watch import SeparationRules
from swarmctl.config import fence
from swarmctl.config.communication import vehicle_of
from swarmctl.config.failsafes import active_rules
from swarmctl.config.formations import FormationSection
from swarmctl.config.model import Config
from swarmctl.config.specs import Spec, specs_of, wings_of
from swarmctl.config.threats import Binomial, Drawn, Poisson, Uniform, Weights
from swarmctl.core.belief import Belief
from swarmctl.core.events import FlightOrder
from swarmctl.core.exposure import prior_inner_exposure
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.inference.survival import ProbabilityEstimate, survival_probability
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import PLANNERS, method
from swarmctl.planners.benevolence import OtherVehicle
from swarmctl.sensors import SOURCES

PAPER_PLANNER = PLANNERS["dijkstra"]
"""the paper's planner, the reference for other planners"""


GROUP_SPEED = 0.7
"""default speed of a group, as a share of its slowest member's speed"""


class RandomStream(IntEnum):
    """Purposes of random numbers; each purpose and vehicle has a separate stream."""

    SENSOR = 1
    SURVIVAL = 2


class Scenario(msgspec.Struct, frozen=True):
    """All data of a run before its start."""

    config: Config
    grid: Grid
    strength: FiringStrength
    hostiles: frozenset[Cell]
    """the true cells of the hostiles"""
    psi_per_cell: float
    specs: tuple[Spec, ...]
    """the vehicles that this process flies"""
    tasks: tuple[Task, ...]
    """the tasks of `specs`, in the same order"""
    prior: Belief
    """the belief of every vehicle before take-off"""
    swarm: tuple[Spec, ...]
    """the vehicles of all processes"""

    @property
    def true_hostiles(self) -> frozenset[Cell] | None:
        """The true cells of the hostiles; None if unknown, because nothing simulates them."""
        config = self.config
        is_real = config.simulate is None and not SOURCES[config.sensor.source].is_simulated
        return None if is_real and not isinstance(config.threats.hostiles, tuple) else self.hostiles

    def only(self, uav: int) -> Scenario:
        """Return the scenario of a process that flies only vehicle `uav`."""
        here = [i for i, spec in enumerate(self.specs) if spec.sysid == uav]
        return replace(
            self, specs=tuple(self.specs[i] for i in here), tasks=tuple(self.tasks[i] for i in here)
        )

    def formation_of(self, uav: int) -> Formation | None:
        """Return the group of a vehicle of this process; None if it flies alone."""
        return next((task.formation for task in self.tasks if task.uav == uav), None)

    @property
    def fence_polygon(self) -> tuple[LatLon, ...]:
        """Return the corners of the fence [deg], in order."""
        return fence.polygon_of(self.config, self.grid, self.swarm)

    @property
    def ceiling_m(self) -> float:
        """Return the greatest allowed height above home [m]."""
        return fence.ceiling_m(self.config, self.swarm)

    @property
    def chosen_by(self) -> str:
        """Return the label of the chosen routes: `w = …` for planners that use w, or the planner's name."""
        planner = self.config.planner
        if not PLANNERS[planner.name].USES_W:
            return planner.name
        benevolence = f", benevolence {planner.benevolence:g}" if planner.benevolence else ""
        return f"w = {planner.w:g}{benevolence}"

    def generator(self, purpose: RandomStream, uav: int) -> np.random.Generator:
        """Return a new random generator. Equal seeds and arguments give equal numbers."""
        return np.random.default_rng(np.random.SeedSequence(self.config.seed, spawn_key=(purpose, uav)))

    def survival_probability(
        self, uav: int, belief: Belief, strength: FiringStrength, cells: Sequence[Cell]
    ) -> ProbabilityEstimate:
        """Return the survival probability on a route, by simulation over the belief.

        Equal arguments give equal results.
        """
        return survival_probability(belief, strength, cells, self.generator(RandomStream.SURVIVAL, uav))


def build(config: Config) -> Scenario:
    """Return the scenario of a configuration without problems (`checks.check_config`)."""
    grid = config.grid
    s = config.threats.firing_strength
    strength = FiringStrength(s.direct, s.first_neighbour, s.second_neighbour)
    specs = specs_of(config, grid)
    count = count_of(config)
    psi = config.planner.psi_per_cell or (
        # Without threats every ψ gives the same routes.
        prior_inner_exposure(grid.rows, grid.cols, count.mean, strength) or 1.0
    )
    tasks = tuple(_tasks(config, grid, strength, psi, specs))
    sensor = SensorModel(config.sensor.p_miss, config.sensor.p_false_alarm)
    prior = Belief.prior(grid.rows, grid.cols, count, sensor)
    scenario = Scenario(
        config, grid, strength, draw_hostiles(config, count, config.seed), psi, specs, tasks, prior, specs
    )
    corners_m = tuple(grid.frame.to_local(*corner) for corner in scenario.fence_polygon)
    limits = Fence(corners_m, scenario.ceiling_m)
    return replace(scenario, tasks=tuple(replace(task, fence=limits) for task in tasks))


def count_of(config: Config) -> HostileCount:
    """Return the announced number of hostiles."""
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


def draw_hostiles(config: Config, count: HostileCount, seed: int) -> frozenset[Cell]:
    """Return the true cells of the hostiles, as a flight with this seed has them."""
    hostiles = config.threats.hostiles
    if isinstance(hostiles, tuple):
        return frozenset(hostiles)
    drawn = Drawn() if hostiles == "random" else hostiles
    rows, cols = config.area.rows, config.area.cols
    rng = np.random.default_rng(seed)
    n = count.draw(rng) if drawn.count is None else drawn.count
    chance = None
    if drawn.clusters is not None and drawn.spread_cells is not None:
        chance = _in_clusters(rng, rows, cols, drawn.clusters, drawn.spread_cells)
    cells = rng.choice(rows * cols, size=n, replace=False, p=chance)
    return frozenset((int(i) // cols, int(i) % cols) for i in cells)


def _in_clusters(
    rng: np.random.Generator, rows: int, cols: int, n_clusters: int, spread_cells: float
) -> NDArray[np.float64]:
    """Return (cells,) chances of a hostile: normal distributions of equal weight around random cells."""
    centres = np.divmod(rng.choice(rows * cols, size=n_clusters, replace=False), cols)

    def along(size: int, centre: NDArray[np.int64]) -> NDArray[np.float64]:
        density = np.exp(-0.5 * ((np.arange(size) - centre[:, None]) / spread_cells) ** 2)
        return np.asarray(density / density.sum(axis=1, keepdims=True))

    # A floor far below every other chance: hostiles that exceed their clusters' cells go elsewhere.
    chance = np.maximum((along(rows, centres[0]).T @ along(cols, centres[1])).ravel(), 1e-100)
    return np.asarray(chance / chance.sum())


def _tasks(
    config: Config, grid: Grid, strength: FiringStrength, psi: float, specs: tuple[Spec, ...]
) -> Iterator[Task]:
    planner = config.planner
    chosen = method(planner.name, PLANNERS[planner.name], planner.options)
    no_fly = frozenset(config.area.no_fly)
    names = {spec.sysid: spec.name for spec in specs}
    policy = config.preflight.policy
    groups = tuple(formation_of(config, section, specs) for section in config.formations)
    declared = LostLink(does=policy.lost_link, after_s=float(policy.lost_link_after_s))
    for index, spec in enumerate(specs):
        # DEVIATION: the paper's UAVs may share a position in the air and on the ground. These vehicles fly
        # at different altitudes (`Spec.altitude_m`) and land at different spots.
        sharing = _sharing_goals(specs, index)
        formation = next((group for group in groups if spec.sysid in group.members), None)
        # A group flies over the cells whose exposure its planner has compared.
        is_pulled = config.flight.any_angle and formation is None
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
            any_angle=config.flight.any_angle_exposure if is_pulled else None,
            turn_radius_m=spec.turn_radius_m,
            wings=wings_of(config, spec),
            start_delay_s=spec.start_delay_s,
            # An abandoned vehicle must not hold, because no agent would end the hold.
            fallback=FlightOrder.LAND if config.flight.on_exit == "land" else FlightOrder.RETURN,
            rules=active_rules(config.rules, declared),
            separation=separation_of(config),
            arrival_group=_arrival_group(config, specs),
            autonomy=planner.autonomy,
            benevolence=planner.benevolence,
            others=_others(config, specs, spec),
            formation=formation,
            names=names,
        )


def formation_of(config: Config, section: FormationSection, specs: Sequence[Spec]) -> Formation:
    """Return a group; its speed leaves each member a reserve for turns."""
    members = tuple(vehicle_of(ref, config.names) for ref in section.members)
    slowest_m_s = min(spec.speed_m_s for spec in specs if spec.sysid in members)
    approach = APPROACHES[section.approach]
    shapes = (section.shape,) if section.narrow_shape is None else (section.shape, section.narrow_shape)
    return Formation(
        name=section.name,
        members=members,
        approach=approach,
        params=approach.Params(**section.options),
        shapes=shapes,
        speed_m_s=section.speed_m_s or GROUP_SPEED * slowest_m_s,
        exposure=section.exposure,
        rate_hz=section.rate_hz,
        cell_m=config.area.cell_size_m,
        split_factor=section.split_factor,
        reach_m=config.communication.max_distance_m or math.inf,
        closes_up=section.lost_member == "close_up",
        is_level=section.heights == "level",
        lost_after_s=section.lost_after_s,
        alone_after_s=section.alone_after_s,
        max_error_m=section.max_error_m,
        max_error_s=section.max_error_s,
    )


def _others(config: Config, specs: tuple[Spec, ...], spec: Spec) -> dict[int, OtherVehicle]:
    """Return the vehicles that can learn from a benevolent vehicle; none if it sends to none."""
    if config.planner.benevolence == 0.0 or config.communication.range == 0:
        return {}
    return {other.sysid: OtherVehicle(other.entry, other.goals) for other in specs if other is not spec}


def _arrival_group(config: Config, specs: Sequence[Spec]) -> ArrivalGroup | None:
    section = config.arrival
    if section is None:
        return None
    rank = {uav: i for i, uav in enumerate(sorted(spec.sysid for spec in specs))}
    return ArrivalGroup(rank, section.spacing_s or 0.0, section.tolerance_s, section.slowest_m_s)


def separation_of(config: Config) -> SeparationRules:
    s = config.separation
    return SeparationRules(Limits(s.horizontal_m, s.vertical_m), s.look_ahead_s, s.action)


def _arrival(grid: Grid, spec: Spec) -> TimeBound:
    approach_m = distance_m(spec.start, grid.centre(spec.entry))
    return TimeBound(spec.speed_m_s, spec.arrive_after_s, spec.arrive_within_s, approach_m)


def _sharing_goals(specs: tuple[Spec, ...], index: int) -> list[int]:
    """Return the indices of the vehicles that share goals with vehicle `index`, directly or through others.

    Each of these vehicles needs a separate landing spot.
    """
    group = {index}
    goals = set(specs[index].goals)
    while more := {i for i, s in enumerate(specs) if i not in group and goals & set(s.goals)}:
        group |= more
        goals |= {goal for i in more for goal in specs[i].goals}
    return sorted(group)
