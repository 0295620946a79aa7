"""Checks of the section `separation`: altitudes and first routes that come too close. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations

from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.replan.decide import first_flight, first_problem
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.clash import TIME_TOLERANCE_S
from swarmctl.agent.traffic.separation.conflicts import conflicts
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.separation.watch import HEIGHT_MARGIN
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.planners import Route, Unreachable


def check_separation(scenario: Scenario, routes: Mapping[int, Route]) -> Iterator[ConfigProblem]:
    """Yield the problem of the first two vehicles in conflict; `routes`: first routes by system id.

    Two vehicles share an altitude band if their altitudes differ by less than `separation.vertical_m`. A
    fixed wing shares every band. First routes in a shared band must not meet. Altitudes of different bands
    must differ by more than the height errors of vehicles.
    """
    limits = scenario.config.separation
    yield from _check_height_margin(scenario)
    shared = [
        {one.sysid, other.sysid}
        for one, other in combinations(scenario.specs, 2)
        if abs(one.altitude_m - other.altitude_m) < limits.vertical_m - 1e-9
        or "plane" in (one.airframe, other.airframe)  # a fixed wing climbs and descends on its route
    ]
    if not shared:
        return
    concerned = set[int]().union(*shared)
    flights = dict(_flights(scenario, {uav: routes[uav] for uav in concerned if uav in routes}))
    fastest_m_s = max(spec.speed_m_s for spec in scenario.specs)
    widened = Limits(limits.horizontal_m + TIME_TOLERANCE_S * fastest_m_s, limits.vertical_m)
    specs = {spec.sysid: spec for spec in scenario.specs}
    for conflict in conflicts(flights, widened):
        if {conflict.uav, conflict.other} not in shared:
            continue
        at = conflict.closest
        near = (
            f"{at.horizontal_m:.0f} m over ground and {at.vertical_m:.0f} m in height after {at.t_s:.0f} s "
            f"(limits, with {TIME_TOLERANCE_S:g} s for delays: {widened.horizontal_m:g} m and "
            f"{widened.vertical_m:g} m)"
        )
        yield _problem(scenario, specs[conflict.uav], specs[conflict.other], near)
        return  # one change of the configuration usually resolves the other conflicts too


def _check_height_margin(scenario: Scenario) -> Iterator[ConfigProblem]:
    """Yield the problem of two altitudes that differ by `separation.vertical_m` or slightly more.

    For planning such altitudes are separate, but height errors would raise an alarm at every crossing.
    """
    vertical_m = scenario.config.separation.vertical_m
    needed_m = HEIGHT_MARGIN * vertical_m
    for one, other in combinations(scenario.specs, 2):
        apart_m = abs(one.altitude_m - other.altitude_m)
        if vertical_m - 1e-9 <= apart_m < needed_m - 1e-9:
            text = (
                f"{one.name} and {other.name} would fly at {one.altitude_m:g} and {other.altitude_m:g} m, "
                f"{apart_m:g} m apart, too little above separation.vertical_m = {vertical_m:g} m. Vehicles "
                f"do not hold their height to the metre, so each crossing would raise an alarm; give them "
                f"altitudes that differ by {needed_m:g} m or more, or set separation.vertical_m to "
                f"{math.floor(100.0 * apart_m / HEIGHT_MARGIN) / 100.0:g} m or less"
            )
            yield ConfigProblem(("flight", "altitude_step_m"), text)
            return


def _flights(scenario: Scenario, routes: Mapping[int, Route]) -> Iterator[tuple[int, Trajectory]]:
    """Yield the first flight of each vehicle in `routes`; times count from a launch without delay [s]."""
    for spec, task in zip(scenario.specs, scenario.tasks, strict=True):
        route = routes.get(spec.sysid)
        if route is None:
            continue
        try:
            plan = first_flight(task, first_problem(task, scenario.prior), route)
        except Unreachable:
            continue  # another check reports an unflyable route
        yield spec.sysid, from_takeoff(task, plan, spec.start, task.start_delay_s).later(spec.delay_s)


def _problem(scenario: Scenario, one: Spec, other: Spec, near: str) -> ConfigProblem:
    limits = scenario.config.separation
    reason = f"less than separation.vertical_m = {limits.vertical_m:g} m apart"
    if "plane" in (one.airframe, other.airframe):
        reason = "and a fixed wing climbs and descends on its route"
    text = (
        f"{one.name} and {other.name} would fly at {one.altitude_m:g} and {other.altitude_m:g} m, {reason}, "
        f"and their first routes come too close: {near}; {_advice(one, other)}"
    )
    return ConfigProblem(("flight", "altitude_step_m"), text)


def _advice(one: Spec, other: Spec) -> str:
    delay = "simulate.delay_step_s" if one.simulated and other.simulated else "delay_s of one of them"
    return f"give them altitudes that differ by more, or raise {delay} until the routes stay apart"
