"""Whether vehicles keep apart by the routes they take off with, before anything starts. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations

from swarmctl.agent.replan.decide import first_flight, first_problem
from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation import conflicts
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.clash import SLACK_S
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.separation.watch import HEIGHT_MARGIN
from swarmctl.config.model import ConfigProblem
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.planners import Route, Unreachable


def check_separation(scenario: Scenario, routes: Mapping[int, Route]) -> Iterator[ConfigProblem]:
    """Vehicles that share an altitude band (closer than `separation.vertical_m`) have time slots: their first
    routes, `routes` by system id, do not meet. A fixed wing shares every band. Who flies above or below
    another does so by more than the errors of their heights."""
    limits = scenario.config.separation
    yield from _hardly_apart(scenario)
    shared = [
        {one.sysid, other.sysid}
        for one, other in combinations(scenario.specs, 2)
        if abs(one.altitude_m - other.altitude_m) < limits.vertical_m - 1e-9
        or "plane" in (one.airframe, other.airframe)  # which climbs and comes down on its way
    ]
    if not shared:
        return
    concerned = set[int]().union(*shared)
    flights = dict(_flights(scenario, {uav: routes[uav] for uav in concerned if uav in routes}))
    fastest_m_s = max(spec.speed_m_s for spec in scenario.specs)
    slots = Limits(limits.horizontal_m + SLACK_S * fastest_m_s, limits.vertical_m)
    specs = {spec.sysid: spec for spec in scenario.specs}
    for conflict in conflicts(flights, slots):
        if {conflict.uav, conflict.other} not in shared:
            continue
        at = conflict.closest
        near = f"{at.horizontal_m:.0f} m over ground and {at.vertical_m:.0f} m in height after {at.t_s:.0f} s"
        yield _problem(scenario, specs[conflict.uav], specs[conflict.other], near)
        return  # one cure mends most of them


def _hardly_apart(scenario: Scenario) -> Iterator[ConfigProblem]:
    """The first two that keep `separation.vertical_m` in height, and so little more that errors of their
    heights make them too close wherever they cross: plans take them to be apart, but the watch does not."""
    vertical_m = scenario.config.separation.vertical_m
    wanted_m = HEIGHT_MARGIN * vertical_m
    for one, other in combinations(scenario.specs, 2):
        apart_m = abs(one.altitude_m - other.altitude_m)
        if vertical_m - 1e-9 <= apart_m < wanted_m - 1e-9:
            text = (
                f"{one.name} and {other.name} would fly at {one.altitude_m:g} and {other.altitude_m:g} m, "
                f"hardly more than separation.vertical_m = {vertical_m:g} m apart: heights are not held to "
                f"the metre, and each crossing would raise an alarm; give them altitudes that differ by "
                f"{wanted_m:g} m or more, or a separation.vertical_m of "
                f"{math.floor(100.0 * apart_m / HEIGHT_MARGIN) / 100.0:g} m or less"
            )
            yield ConfigProblem(("flight", "altitude_step_m"), text)
            return


def _flights(scenario: Scenario, routes: Mapping[int, Route]) -> Iterator[tuple[int, Trajectory]]:
    """From when the first vehicle is launched."""
    for spec, task in zip(scenario.specs, scenario.tasks, strict=True):
        route = routes.get(spec.sysid)
        if route is None:
            continue
        try:
            yield spec.sysid, _flight(scenario, spec, task, route)
        except Unreachable:
            continue  # it cannot fly that route at all, which is said elsewhere


def _flight(scenario: Scenario, spec: Spec, task: Task, route: Route) -> Trajectory:
    plan = first_flight(task, first_problem(task, scenario.prior), route)
    return from_takeoff(task, plan, spec.start).later(spec.delay_s)


def _problem(scenario: Scenario, one: Spec, other: Spec, near: str) -> ConfigProblem:
    limits = scenario.config.separation
    bands = f"less than separation.vertical_m = {limits.vertical_m:g} m apart"
    if "plane" in (one.airframe, other.airframe):
        bands = "and a fixed wing climbs and comes down on its way"
    text = (
        f"{one.name} and {other.name} would fly at {one.altitude_m:g} and {other.altitude_m:g} m, {bands}, "
        f"and their first routes meet: {near}, with {SLACK_S:g} s for what delays them; "
        f"give {_cure(one, other)}"
    )
    return ConfigProblem(("flight", "altitude_step_m"), text)


def _cure(one: Spec, other: Spec) -> str:
    slots = "simulate.delay_step_s" if one.simulated and other.simulated else "one of them delay_s"
    return f"them altitudes that differ by more, or {slots} until they do not"
