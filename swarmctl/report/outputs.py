"""The files of a run for people: summary, mission files and the map."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from swarmctl.agent.replan.decide import first_flight, first_problem
from swarmctl.agent.replan.landing_pattern import pattern_from
from swarmctl.agent.replan.length_bounds import UNBOUNDED
from swarmctl.agent.replan.time_bound import route_within_bounds
from swarmctl.agent.state import Task
from swarmctl.config.scenario import PAPER_PLANNER, Scenario
from swarmctl.config.specs import Spec
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.belief import Belief
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan
from swarmctl.planners import PLANNERS, Method, Problem, Route, Unreachable
from swarmctl.report import foxglove
from swarmctl.report.final_state import is_lost_in_air
from swarmctl.report.outcome import Report
from swarmctl.report.pictures.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.report.plan_files import plan_json
from swarmctl.report.summary import known_to_any

PLAN_WEIGHTS = (0.0, 0.5, 1.0)


def write_run(folder: Path, scenario: Scenario, report: Report) -> None:
    """Write the summary, the map, Foxglove's layout, and a `.plan` for each vehicle that held a mission."""
    _write_json(folder / "summary.json", {**report.summary, "ended": report.ended, "trouble": report.trouble})
    grid = scenario.grid
    centre = grid.frame.to_geodetic(grid.width_m / 2.0, grid.height_m / 2.0)
    _write_json(folder / "foxglove.json", foxglove.layout([spec.name for spec in scenario.specs], centre))
    for spec in scenario.specs:
        accepted = report.states[spec.sysid].accepted
        if accepted is not None:
            _write_plan(folder / f"{spec.name}.plan", scenario, spec, accepted.plan)
    _draw(folder, _flown_picture(scenario, report))


@dataclass(frozen=True, slots=True)
class FirstRoute:
    """A vehicle's route before anything is observed."""

    task: Task
    """the vehicle's task, with the planner, w and time bound by which this route was chosen"""
    problem: Problem
    """the planner's input"""
    route: Route


def first_routes(scenario: Scenario) -> dict[str, tuple[FirstRoute, ...]]:
    """Return all vehicles' routes before any observation, by a label of the planner and w that chose them.

    These are the paper's routes for each w of PLAN_WEIGHTS, and the configured routes.
    """
    papers = Method("dijkstra", PAPER_PLANNER, PAPER_PLANNER.Params())
    choices = {
        w: tuple(replace(task, method=papers, arrival=UNBOUNDED, w=w) for task in scenario.tasks)
        for w in PLAN_WEIGHTS
    }
    if PLANNERS[scenario.config.planner.name].USES_W:
        choices[scenario.config.planner.w] = scenario.tasks
    named = {f"w = {w:g}": tasks for w, tasks in sorted(choices.items())}
    named[scenario.chosen_by] = scenario.tasks
    return {
        name: tuple(_first_route(task, scenario.prior) for task in tasks) for name, tasks in named.items()
    }


def _first_route(task: Task, prior: Belief) -> FirstRoute:
    problem = first_problem(task, prior)
    return FirstRoute(task, problem, route_within_bounds(task, problem))


def write_plans(folder: Path, scenario: Scenario, routes: dict[str, tuple[FirstRoute, ...]]) -> None:
    """Write the `.plan` files of the configured routes, and the map of all routes."""
    for spec, first in zip(scenario.specs, routes[scenario.chosen_by], strict=True):
        plan = first_flight(first.task, first.problem, first.route)
        _write_plan(folder / f"{spec.name}.plan", scenario, spec, plan)
    tracks = [
        VehicleTrack(
            name=spec.name,
            start=spec.start,
            goal_cells=spec.goals,
            planned=[PlannedTrack(name, _track(spec, routes[name][i])) for name in routes],
        )
        for i, spec in enumerate(scenario.specs)
    ]
    picture = MapPicture(
        grid=scenario.grid,
        hostiles=scenario.hostiles,
        known=scenario.prior.known,
        no_fly=frozenset(scenario.config.area.no_fly),
        tracks=tracks,
        title=f"{scenario.config.name}: first routes",
        subtitle=_facts(scenario, ", ".join(routes)),
    )
    _draw(folder, picture)


def _track(spec: Spec, first: FirstRoute) -> list[LatLon]:
    task, route = first.task, first.route
    try:
        plan = first_flight(task, first.problem, route)
    except Unreachable:  # too tight for this vehicle: draw the route itself
        return [spec.start, *map(task.grid.centre, route.cells)]
    points = [spec.start, *_points(plan)]
    if task.turn_radius_m == 0.0:
        return points
    frame = task.grid.frame
    flown, _ = rounded([frame.to_local(*point) for point in points[1:-1]], task.turn_radius_m)
    landing = []
    if plan.approach is not None:
        pattern = pattern_from(plan.approach, frame)
        landing = [*pattern.circle(), pattern.final]
    return [points[0], *(frame.to_geodetic(*point) for point in (*flown, *landing)), points[-1]]


def _points(plan: FlightPlan) -> list[LatLon]:
    return [(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing)]


def _write_plan(path: Path, scenario: Scenario, spec: Spec, plan: FlightPlan) -> None:
    simulate = scenario.config.simulate
    home_alt_m = simulate.home_alt_amsl_m if simulate is not None and spec.simulated else 0.0
    path.write_text(plan_json(plan, spec.start, home_alt_m, spec.speed_m_s), encoding="utf-8")


def _flown_picture(scenario: Scenario, report: Report) -> MapPicture:
    tracks = []
    for spec in scenario.specs:
        flight, state = report.statistics.vehicles[spec.sysid], report.states[spec.sysid]
        planned = [PlannedTrack("first route", [spec.start, *flight.planned])] if flight.planned else []
        tracks.append(
            VehicleTrack(
                name=spec.name,
                start=spec.start,
                goal_cells=spec.goals,
                planned=planned,
                flown=flight.flown,
                strikes=flight.strikes,
                is_lost=is_lost_in_air(state),
                outcome="lost" if is_lost_in_air(state) else state.outcome or state.phase,
            )
        )
    return MapPicture(
        grid=scenario.grid,
        hostiles=scenario.hostiles,
        known=known_to_any(scenario, report.states),
        no_fly=frozenset(scenario.config.area.no_fly),
        tracks=tracks,
        title=scenario.config.name,
        subtitle=_facts(scenario),
    )


def _facts(scenario: Scenario, routes: str = "") -> str:
    config = scenario.config
    n = len(scenario.specs)
    routes = routes or ", ".join(dict.fromkeys((config.planner.name, scenario.chosen_by)))
    return (
        f"{n} vehicle{'s' if n != 1 else ''} · {len(scenario.hostiles)} hostiles · {routes} · "
        f"seed {config.seed}"
    )


def _draw(folder: Path, picture: MapPicture) -> None:
    # matplotlib takes a second to import, and only this needs it.
    from swarmctl.report.pictures.sheet import draw_map  # noqa: PLC0415

    draw_map(folder / "map.png", picture)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(
        json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
