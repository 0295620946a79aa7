"""What a run leaves behind for people: summary, mission files and the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from swarmctl.agent import Task, first_route
from swarmctl.app import Report
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan
from swarmctl.core.route import flight_plan, landing_spot
from swarmctl.picture import MapPicture, PlannedTrack, VehicleTrack, draw_map
from swarmctl.planfile import plan_json
from swarmctl.planners import Route
from swarmctl.scenario import Scenario, Spec
from swarmctl.summary import known_to_any

PLAN_WEIGHTS = (0.0, 0.5, 1.0)


def write_run(folder: Path, scenario: Scenario, report: Report) -> None:
    """`summary.json`, one `.plan` a vehicle that held a mission, and `map.png`."""
    _write_json(folder / "summary.json", {**report.summary, "ended": report.ended, "trouble": report.trouble})
    for spec in scenario.specs:
        accepted = report.states[spec.sysid].accepted
        if accepted is not None:
            _write_plan(folder / f"{spec.name}.plan", scenario, spec, accepted.plan)
    draw_map(folder / "map.png", _flown_picture(scenario, report))


def first_routes(scenario: Scenario) -> dict[float, tuple[Route, ...]]:
    """All vehicles' routes before anything is observed, for each w of PLAN_WEIGHTS and the configured."""
    weights = sorted({*PLAN_WEIGHTS, scenario.config.planner.w})
    return {w: tuple(first_route(task, scenario.prior, w) for task in scenario.tasks) for w in weights}


def write_plans(folder: Path, scenario: Scenario, routes: dict[float, tuple[Route, ...]]) -> None:
    """The `.plan` files for the configured w, and the map of the routes for every w."""
    for spec, task, route in zip(
        scenario.specs, scenario.tasks, routes[scenario.config.planner.w], strict=True
    ):
        _write_plan(folder / f"{spec.name}.plan", scenario, spec, _first_plan(task, route))
    tracks = [
        VehicleTrack(
            name=spec.name,
            start=spec.start,
            goal_cells=spec.goals,
            planned=[PlannedTrack(f"w = {w:g}", _track(spec, task, routes[w][i])) for w in routes],
        )
        for i, (spec, task) in enumerate(zip(scenario.specs, scenario.tasks, strict=True))
    ]
    picture = MapPicture(
        grid=scenario.grid,
        hostiles=scenario.hostiles,
        known=scenario.prior.known,
        no_fly=frozenset(scenario.config.area.no_fly),
        tracks=tracks,
        title=f"{scenario.config.name}: first routes",
        subtitle=_facts(scenario, weights=routes),
    )
    draw_map(folder / "map.png", picture)


def _first_plan(task: Task, route: Route) -> FlightPlan:
    spot = landing_spot(task.grid, route.cells[-1], task.landing_index, task.landing_count)
    return flight_plan(task.grid, route.cells, altitude_m=task.altitude_m, landing_lat_lon=spot)


def _track(spec: Spec, task: Task, route: Route) -> list[LatLon]:
    plan = _first_plan(task, route)
    return [spec.start, *_points(plan)]


def _points(plan: FlightPlan) -> list[LatLon]:
    return [(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing)]


def _write_plan(path: Path, scenario: Scenario, spec: Spec, plan: FlightPlan) -> None:
    simulate = scenario.config.simulate
    home_alt_m = simulate.home_alt_amsl_m if simulate is not None and spec.simulated else 0.0
    speed_m_s = simulate.speed_m_s if simulate is not None and spec.simulated else 10.0
    path.write_text(plan_json(plan, spec.start, home_alt_m, speed_m_s), encoding="utf-8")


def _flown_picture(scenario: Scenario, report: Report) -> MapPicture:
    tracks = []
    for spec in scenario.specs:
        ledger, state = report.ledger.vehicles[spec.sysid], report.states[spec.sysid]
        planned = [PlannedTrack("first route", [spec.start, *ledger.planned])] if ledger.planned else []
        tracks.append(
            VehicleTrack(
                name=spec.name,
                start=spec.start,
                goal_cells=spec.goals,
                planned=planned,
                flown=ledger.flown,
                strikes=ledger.strikes,
                outcome=state.outcome or state.phase,
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


def _facts(scenario: Scenario, weights: Any = None) -> str:
    config = scenario.config
    n = len(scenario.specs)
    w = config.planner.w if weights is None else ", ".join(f"{w:g}" for w in weights)
    return (
        f"{n} vehicle{'s' if n != 1 else ''} · {len(scenario.hostiles)} hostiles · "
        f"{config.planner.name}, w = {w} · seed {config.seed}"
    )


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(
        json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
