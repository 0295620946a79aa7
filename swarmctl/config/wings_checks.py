"""Checks of fixed wings: room for take-off and landing, and unsuitable settings. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations, pairwise

from swarmctl.agent.replan.landing import goal_pattern, home_approach, home_pattern
from swarmctl.agent.state import Task
from swarmctl.config.arrival_checks import time_bounds
from swarmctl.config.model import Config
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec, simulated_airframe
from swarmctl.config.vehicles import Simulate, Vehicle
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.geo import distance_m
from swarmctl.core.planar import PlanarPoint, distance_to_track
from swarmctl.links import LINKS
from swarmctl.planners import Unreachable

MAX_TAKEOFF_ROLL_M = 40.0
SAMPLE_EVERY_M = 5.0
CLIMB_SLOPE = 0.25
"""least slope of the climb after take-off, height over distance"""


def check_wings(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of settings that fixed wings exclude, and of `wings` without a fixed wing."""
    planes = [(here, section) for here, section in config.vehicle_sections if _has_planes(config, section)]
    if not planes:
        if "wings" in config.model_fields_set:
            text = "no vehicle is a fixed wing; remove this section, or set `airframe: plane` on a vehicle"
            yield ConfigProblem(("wings",), text)
        return
    if not config.flight.any_angle:
        text = "fixed wings need straightened routes, with room for their turns; set it to true"
        yield ConfigProblem(("flight", "any_angle"), text, depends_on=planes[0][0])
    for here, section in planes:
        for key in time_bounds(section):
            text = "flight times of fixed wings are not precise enough for a time bound; remove it"
            yield ConfigProblem((*here, key), text)
        if not LINKS[section.link].flies_planes:
            yield ConfigProblem((*here, "link"), "fixed wings need the link `direct`; set link: direct")


def _has_planes(config: Config, section: Simulate | Vehicle) -> bool:
    if isinstance(section, Vehicle):
        return section.airframe == "plane"
    return any(simulated_airframe(config, i) == "plane" for i in range(section.count))


def check_plane(scenario: Scenario, spec: Spec, task: Task, here: KeyPath) -> Iterator[ConfigProblem]:
    """Yield problems of a fixed wing's climb, descent and landings."""
    wings = task.wings
    if wings is None:
        return
    key = (*here, "start_distance_m") if here[0] == "simulate" else (*here, "start")
    needs_m = (
        MAX_TAKEOFF_ROLL_M
        + wings.takeoff_height_m / CLIMB_SLOPE
        + task.turn_radius_m * math.tan(math.pi / 8.0)
    )
    has_m = distance_m(spec.start, scenario.grid.centre(spec.entry))
    if has_m < needs_m:
        text = (
            f"{spec.name} starts {has_m:.0f} m from the centre of its entry cell, but needs up to "
            f"{needs_m:.0f} m to climb to {wings.takeoff_height_m:g} m; move its start farther away, or "
            "lower wings.takeoff_height_m"
        )
        yield ConfigProblem(key, text)
    if spec.altitude_m < wings.final_height_m:
        text = f"{spec.name} would fly at {spec.altitude_m:g} m, below wings.final_height_m = "
        yield ConfigProblem(
            ("wings", "final_height_m"), f"{text}{wings.final_height_m:g} m; lower it, or fly higher"
        )
    sharing = [other.name for other in scenario.swarm if _share_a_goal(spec, other)]
    if sharing:
        text = f"{spec.name} shares a goal with {', '.join(sharing)}, so their landings would meet"
        yield ConfigProblem((*here, "goal"), f"{text}; give each fixed wing a goal of its own")
    try:
        home_approach(task)
    except Unreachable as error:
        yield ConfigProblem(key, f"{spec.name}: {error}; widen preflight.fence, or move the start")


def check_landings(scenario: Scenario) -> Iterator[ConfigProblem]:
    """Yield the problem of the first two fixed wings with landings that come too close, at whatever times."""
    planes = [(spec, task) for spec, task in zip(scenario.specs, scenario.tasks, strict=True) if task.wings]
    limit_m = scenario.config.separation.horizontal_m
    landings = [(spec, list(_outlines(task))) for spec, task in planes]
    for (one, outlines), (other, other_outlines) in combinations(landings, 2):
        near = [
            (where, metres)
            for where, a in outlines
            for other_where, b in other_outlines
            if where == other_where and (metres := _nearest_m(a, b)) < limit_m
        ]
        if near:
            where, metres = near[0]
            places = "starts" if where == "at home" else "goals"
            text = (
                f"the landings of {one.name} and {other.name} {where} come within {metres:.0f} m, less than "
                f"separation.horizontal_m = {limit_m:g} m; move their {places} apart, or give "
                "wings.landing_heading_deg"
            )
            yield ConfigProblem(("separation", "horizontal_m"), text)
            return  # one change of the configuration usually resolves the other problems too


def _outlines(task: Task) -> Iterator[tuple[str, list[PlanarPoint]]]:
    try:
        home = home_pattern(task)
        goals = [goal_pattern(task, goal) for goal in task.goals]
    except Unreachable:
        return  # another check reports the landing
    yield from (("at their goals", goal.outline()) for goal in goals if goal is not None)
    if home is not None:
        yield "at home", home.outline()


def _nearest_m(a: list[PlanarPoint], b: list[PlanarPoint]) -> float:
    return min(distance_to_track(point, b) for point in _sampled(a))


def _sampled(track: list[PlanarPoint]) -> Iterator[PlanarPoint]:
    for (e0, n0), (e1, n1) in pairwise(track):
        pieces = math.ceil(math.dist((e0, n0), (e1, n1)) / SAMPLE_EVERY_M) or 1
        yield from ((e0 + (e1 - e0) * k / pieces, n0 + (n1 - n0) * k / pieces) for k in range(pieces))
    yield track[-1]


def _share_a_goal(spec: Spec, other: Spec) -> bool:
    return other.sysid != spec.sysid and bool(set(spec.goals) & set(other.goals))
