"""Kind `routes` of a study: single searches on drawn beliefs, compared with the exact answers. Pure.

A seed draws the hostiles, as `fly` with this seed does, and what the sensors have shown of them. One row is
the route of one vehicle by one method. Nothing flies, so nothing is replanned.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from enum import IntEnum
from typing import Annotated

import msgspec
import numpy as np
from pydantic import Field

from swarmctl.agent.replan.decide import first_problem
from swarmctl.config.scenario import Scenario
from swarmctl.core import exposure as measures
from swarmctl.core.belief import Belief
from swarmctl.core.grid import Cell
from swarmctl.core.inference.survival import survival_among, survival_probability
from swarmctl.core.observation import Observation
from swarmctl.core.records import replace
from swarmctl.core.section import NameIn, Section
from swarmctl.planners import PLANNERS, Problem, Route, plan
from swarmctl.study import w_search
from swarmctl.study.tables import SeedResult
from swarmctl.study.world import World

SAME = 1e-9
"""relative difference of two sums below which they count as equal"""
OBSERVER = 254
"""system id under which the drawn observations stand"""


class Search(Section):
    """The section `search` of an experiment of kind `routes`. Each key may be a factor."""

    method: Annotated[str, NameIn([*PLANNERS, *w_search.METHODS])] = Field(
        "time_bound",
        description=f"Planner ({', '.join(PLANNERS)}), or a search in w ({', '.join(w_search.METHODS)}).",
    )
    searches: int = Field(8, ge=1, description="Greatest number of searches of a search in w.")
    step: float = Field(0.1, gt=0.0, le=1.0, description="Distance of neighbours in w, for a search in w.")
    longer: float | None = Field(
        None, ge=0.0, description="Bound on length, as a share above the shortest route. Default: no bound."
    )
    observed: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Share of the cells that the sensors have shown, in squares of 3 × 3.",
    )
    simulated_worlds: int = Field(
        1024, ge=2, description="Number of worlds drawn from the belief for `believed_survival`."
    )


class Stream(IntEnum):
    """Purposes of the random numbers of a seed; the draws of hostiles, looks and strikes are the world's."""

    OBSERVED = 1
    SEARCH = 2
    SURVIVAL = 3


class RouteResult(msgspec.Struct, frozen=True):
    """A route: its sums by the belief, what happens among the true hostiles, and how far it is from exact."""

    uav: int
    length_cells: float
    length_m: float
    believed_exposure_sum: float
    """ΣP_s by Eq. 3, which the methods minimise"""
    exposure_sum: float
    """ΣP_s by Eq. 2, among the true hostiles"""
    believed_safety_factor: float
    """∏(1 − P_s) by Eq. 3"""
    safety_factor: float
    """∏(1 − P_s) by Eq. 2"""
    believed_survival: float
    """chance of no hit, by simulation of the belief"""
    true_survival: float
    """chance of no hit among the true hostiles"""
    strikes: int
    """drawn hits, as in a mission along the route"""
    survived: bool
    """no strike"""
    searches: int
    """Dijkstra searches spent; 1 for planners that do not count theirs"""
    within_bound: bool
    exposure_above_exact: float
    """believed ΣP_s above that of `constrained`, as a share of the shortest route's ΣP_s"""
    exposure_above_breakpoints: float
    """believed ΣP_s above that of `time_bound`, as a share of the shortest route's ΣP_s"""
    is_exact: bool
    """no route within the bound has a smaller believed ΣP_s"""
    is_best_w: bool
    """no w has a route within the bound of a smaller believed ΣP_s"""
    safety_below_safest: float
    """believed safety factor below that of the safest route of any length"""
    is_safest: bool
    """no route has a greater believed safety factor"""


def unsupported(scenario: Scenario) -> str | None:
    """Return why routes of a scenario cannot be compared with the exact answers; None if they can."""
    if any(first_problem(task, scenario.prior).min_length_cells > 0.0 for task in scenario.tasks):
        return "planner constrained has no least length, so remove the earliest arrival (arrive_after_s)"
    return None


def searched(scenario: Scenario, settings: Search, world: World) -> SeedResult[RouteResult]:
    """Return the route of each vehicle in one world.

    Raises Unreachable, and BoundTooTight if a bound of the base configuration excludes every route.
    """
    return SeedResult(tuple(_results(scenario, settings, world)))


def drawn_belief(scenario: Scenario, world: World, observed: float) -> Belief:
    """Return the prior with observations of at least this share of the cells, by the scenario's sensor.

    The sensors see the 3 × 3 cells around random cells, one after the other. So the observations of a smaller
    share are the first of a larger share.
    """
    looks: Counter[Cell] = Counter()
    observations: list[Observation] = []
    for index in _generator(world.seed, Stream.OBSERVED).permutation(world.rows * world.cols):
        if len(looks) >= observed * world.rows * world.cols:
            break
        cells = world.around((int(index) // world.cols, int(index) % world.cols))
        looks.update(cells)
        seen = [world.shows_hostile(OBSERVER, cell, looks[cell], scenario.prior.sensor) for cell in cells]
        triples = tuple((*cell, occupied) for cell, occupied in zip(cells, seen, strict=True))
        observations.append(Observation(OBSERVER, len(observations) + 1, 0.0, triples))
    return scenario.prior.merge(observations)


def _results(scenario: Scenario, settings: Search, world: World) -> Iterator[RouteResult]:
    belief = drawn_belief(scenario, world, settings.observed)
    true_p_s = measures.exposure(world.occupancy(), scenario.strength)  # Eq. 2
    for task in scenario.tasks:
        problem = first_problem(task, belief)
        shortest = plan(replace(problem, w=0.0, max_length_cells=math.inf))
        if settings.longer is not None:
            bound = min(problem.max_length_cells, (1.0 + settings.longer) * shortest.length_cells)
            problem = replace(problem, max_length_cells=bound)
        route, n_searches = _search(problem, settings, _generator(world.seed, Stream.SEARCH, task.uav))
        exact, best_w, safest = (plan(problem, name) for name in ("constrained", "time_bound", "survival"))
        believed_survival = survival_probability(
            belief,
            task.strength,
            route.cells,
            _generator(world.seed, Stream.SURVIVAL, task.uav),
            settings.simulated_worlds,
        ).estimate
        # The first entry into each cell: a route of these methods has no cell twice.
        strikes = sum(world.strikes(task.uav, cell, 1, task.strength) for cell in route.cells[1:])
        total, unit = route.exposure_sum, shortest.exposure_sum or 1.0
        yield RouteResult(
            uav=task.uav,
            length_cells=route.length_cells,
            length_m=route.length_cells * scenario.grid.cell_size_m,
            believed_exposure_sum=total,
            exposure_sum=measures.exposure_sum(true_p_s, route.cells),
            believed_safety_factor=route.safety_factor,
            safety_factor=measures.safety_factor(true_p_s, route.cells),
            believed_survival=believed_survival,
            true_survival=survival_among(
                world.hostiles, task.strength, route.cells, (world.rows, world.cols)
            ),
            strikes=strikes,
            survived=strikes == 0,
            searches=n_searches,
            within_bound=route.length_cells <= problem.max_length_cells + SAME,
            exposure_above_exact=(total - exact.exposure_sum) / unit,
            exposure_above_breakpoints=(total - best_w.exposure_sum) / unit,
            is_exact=total <= exact.exposure_sum * (1.0 + SAME),
            is_best_w=total <= best_w.exposure_sum * (1.0 + SAME),
            safety_below_safest=safest.safety_factor - route.safety_factor,
            is_safest=route.safety_factor >= safest.safety_factor * (1.0 - SAME),
        )


def _search(problem: Problem, settings: Search, rng: np.random.Generator) -> tuple[Route, int]:
    """Return the route by the method of the settings, and the number of searches."""
    if settings.method in PLANNERS:
        route = plan(problem, settings.method)
        return route, max(len(route.searched), 1)
    found = w_search.search(problem, settings.method, settings.searches, settings.step, rng)
    return found.best, len(found.tried)


def _generator(seed: int, purpose: Stream, uav: int = 0) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose, uav)))
