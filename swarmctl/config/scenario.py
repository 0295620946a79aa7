"""From a `Config` to what is flown: the grid, the truth, and one `Task` a vehicle. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from swarmctl.agent.arrival.common_time import ArrivalGroup
from swarmctl.agent.failsafes.base import Fence
from swarmctl.agent.failsafes.lost_link import Params as LostLink
from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.replan.length_bounds import TimeBound
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.watch import SeparationRules
from swarmctl.config import fence
from swarmctl.config.count import Binomial, Poisson, Uniform, Weights
from swarmctl.config.failsafes import rulings
from swarmctl.config.model import Config
from swarmctl.config.specs import Spec, grid_of, specs_of, wings_of
from swarmctl.core.belief import Belief
from swarmctl.core.events import FlightOrder
from swarmctl.core.exposure import prior_inner_exposure
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.inference.survival import ProbabilityEstimate, survival_probability
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import PLANNERS, method

PAPER_PLANNER = PLANNERS["dijkstra"]
"""the paper's planner, beside which every other is shown"""


class RandomStream(IntEnum):
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

    def wings(self, spec: Spec) -> FixedWing | None:
        """What a plan for a vehicle that is a fixed wing has to know of it; None for what hovers."""
        return wings_of(self.config, spec)

    @property
    def fence_polygon(self) -> tuple[LatLon, ...]:
        """Corners of the fence [deg], in order."""
        return fence.polygon_of(self.config, self.grid, self.swarm)

    @property
    def ceiling_m(self) -> float:
        """The greatest height a vehicle may fly at, above home [m]."""
        return fence.ceiling_m(self.config, self.swarm)

    @property
    def chosen_by(self) -> str:
        """What chooses the routes: w, where it is the paper's planner, or the name of another."""
        planner = self.config.planner
        return f"w = {planner.w:g}" if PLANNERS[planner.name].USES_W else planner.name

    def generator(self, purpose: RandomStream, uav: int) -> np.random.Generator:
        """A vehicle's own source of chance, spawned from the run's seed; the same again at each call."""
        return np.random.default_rng(np.random.SeedSequence(self.config.seed, spawn_key=(purpose, uav)))

    def chance(
        self, uav: int, belief: Belief, strength: FiringStrength, cells: Sequence[Cell]
    ) -> ProbabilityEstimate:
        """The chance that a vehicle gets through on a route, by simulation over what is believed; equal
        questions get equal answers."""
        return survival_probability(belief, strength, cells, self.generator(RandomStream.CHANCE, uav))


def build(config: Config) -> Scenario:
    """For a configuration that `judge` finds nothing wrong with. Raises Unreachable, naming the vehicle."""
    grid = grid_of(config)
    s = config.threats.firing_strength
    strength = FiringStrength(s.direct, s.first_neighbour, s.second_neighbour)
    specs = specs_of(config, grid)
    count = count_of(config)
    psi = config.planner.psi_per_cell or (
        # Without any threat every ψ gives the same routes.
        prior_inner_exposure(grid.rows, grid.cols, count.mean, strength) or 1.0
    )
    tasks = tuple(_tasks(config, grid, strength, psi, specs))
    sensor = SensorModel(config.sensor.p_miss, config.sensor.p_false_alarm)
    prior = Belief.prior(grid.rows, grid.cols, count, sensor)
    scenario = Scenario(config, grid, strength, _hostiles(config, count), psi, specs, tasks, prior, specs)
    corners_m = tuple(grid.frame.to_local(*corner) for corner in scenario.fence_polygon)
    limits = Fence(corners_m, scenario.ceiling_m)
    return replace(scenario, tasks=tuple(replace(task, fence=limits) for task in tasks))


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
            fallback=FlightOrder.LAND if config.flight.on_exit == "land" else FlightOrder.RETURN,
            rules=rulings(config.rules, agreed),
            separation=separation_of(config),
            meeting=_meeting(config, specs),
        )


def _meeting(config: Config, specs: Sequence[Spec]) -> ArrivalGroup | None:
    together = config.arrival
    if together is None:
        return None
    rank = {uav: i for i, uav in enumerate(sorted(spec.sysid for spec in specs))}
    return ArrivalGroup(rank, together.spacing_s or 0.0, together.tolerance_s, together.slowest_m_s)


def separation_of(config: Config) -> SeparationRules:
    apart = config.separation
    return SeparationRules(Limits(apart.horizontal_m, apart.vertical_m), apart.look_ahead_s, apart.action)


def _arrival(grid: Grid, spec: Spec) -> TimeBound:
    approach_m = distance_m(spec.start, grid.centre(spec.entry))
    return TimeBound(spec.speed_m_s, spec.arrive_after_s, spec.arrive_within_s, approach_m)


def _sharing(specs: tuple[Spec, ...], index: int) -> list[int]:
    """Which vehicles have goals in common with this one, directly or by way of others: each needs a landing
    spot that none of them has."""
    group = {index}
    goals = set(specs[index].goals)
    while more := {i for i, s in enumerate(specs) if i not in group and goals & set(s.goals)}:
        group |= more
        goals |= {goal for i in more for goal in specs[i].goals}
    return sorted(group)
