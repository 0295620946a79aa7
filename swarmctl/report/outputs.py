"""Readable files of a flight, or of the first routes: summary, `.plan` files, Foxglove layout, map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from swarmctl.agent.replan.decide import first_flight
from swarmctl.agent.replan.landing_pattern import pattern_from
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.core.any_angle.turns import rounded as with_arcs
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan
from swarmctl.planners import Unreachable
from swarmctl.report import foxglove
from swarmctl.report.final_state import is_lost_in_air
from swarmctl.report.first_plans import FirstRoute, planned_shapes
from swarmctl.report.outcome import FlightReport
from swarmctl.report.pictures.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.report.plan_files import plan_json
from swarmctl.report.summary import known_to_any

AS_GIVEN = ("configuration", "resolved")
"""Sections of `summary.json` whose numbers are not rounded: they configure the flight."""
DECIMALS = {"m": 2, "s": 3}
"""Decimals of metres, and of seconds and speeds, in `summary.json`."""
SIGNIFICANT, LEAST_SIGNIFICANT = 6, 3
"""Significant digits of its other numbers, such as probabilities, and the least of all numbers."""


def write_run(folder: Path, scenario: Scenario, report: FlightReport) -> None:
    """Write the summary, the map, Foxglove's layout, and a `.plan` for each vehicle with an accepted plan."""
    given = {key: report.summary[key] for key in AS_GIVEN if key in report.summary}
    content = {**rounded(report.summary), **given, "ended": report.ended, "trouble": report.trouble}
    _write_json(folder / "summary.json", content)
    grid = scenario.grid
    centre = grid.frame.to_geodetic(grid.size_east_m / 2.0, grid.size_north_m / 2.0)
    _write_json(folder / "foxglove.json", foxglove.layout([spec.name for spec in scenario.specs], centre))
    for spec in scenario.specs:
        accepted = report.states[spec.sysid].plans.accepted
        if accepted is not None:
            _write_plan(folder / f"{spec.name}.plan", scenario, spec, accepted.plan)
    _draw(folder, _flown_picture(scenario, report))


def write_plans(folder: Path, scenario: Scenario, routes: dict[str, tuple[FirstRoute, ...]]) -> None:
    """Write the `.plan` files of the configured routes, and the map of all routes. Raises Unreachable."""
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
        hostiles=scenario.true_hostiles,
        known=scenario.prior.known,
        no_fly=frozenset(scenario.config.area.no_fly),
        tracks=tracks,
        groups=[places for first in routes[scenario.chosen_by] for places in planned_shapes(first)],
        title=f"{scenario.config.name}: first routes",
        subtitle=_subtitle(scenario, ", ".join(routes)),
    )
    _draw(folder, picture)


def _track(spec: Spec, first: FirstRoute) -> list[LatLon]:
    task, route = first.task, first.route
    try:
        plan = first_flight(task, first.problem, route)
    except Unreachable:  # No room for the turns or the landing: draw the lattice route.
        return [spec.start, *map(task.grid.centre, route.cells)]
    points = [spec.start, *_points(plan)]
    if task.turn_radius_m == 0.0:
        return points
    frame = task.grid.frame
    arcs, _ = with_arcs([frame.to_local(*point) for point in points[1:-1]], task.turn_radius_m)
    landing = []
    if plan.approach is not None:
        pattern = pattern_from(plan.approach, frame)
        landing = [*pattern.circle(), pattern.final]
    return [points[0], *(frame.to_geodetic(*point) for point in (*arcs, *landing)), points[-1]]


def _points(plan: FlightPlan) -> list[LatLon]:
    return [(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing)]


def _write_plan(path: Path, scenario: Scenario, spec: Spec, plan: FlightPlan) -> None:
    simulate = scenario.config.simulate
    home_alt_amsl_m = simulate.home_alt_amsl_m if simulate is not None and spec.simulated else 0.0
    path.write_text(plan_json(plan, spec.start, home_alt_amsl_m, spec.speed_m_s), encoding="utf-8")


def _flown_picture(scenario: Scenario, report: FlightReport) -> MapPicture:
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
        hostiles=scenario.true_hostiles,
        known=known_to_any(scenario, report.states),
        no_fly=frozenset(scenario.config.area.no_fly),
        tracks=tracks,
        groups=report.statistics.formations.drawn,
        title=scenario.config.name,
        subtitle=_subtitle(scenario),
    )


def _subtitle(scenario: Scenario, routes: str = "") -> str:
    config = scenario.config
    n = len(scenario.specs)
    routes = routes or ", ".join(dict.fromkeys((config.planner.name, scenario.chosen_by)))
    hostiles = scenario.true_hostiles
    n_hostiles = "unknown" if hostiles is None else len(hostiles)
    groups = "".join(f" · {group.name}: {group.approach.replace('_', ' ')}" for group in config.formations)
    vehicles = f"{n} vehicle{'s' if n != 1 else ''}"
    return f"{vehicles} · {n_hostiles} hostiles · {routes}{groups} · seed {config.seed}"


def _draw(folder: Path, picture: MapPicture) -> None:
    # Matplotlib takes a second to import.
    from swarmctl.report.pictures.sheet import draw_map  # noqa: PLC0415

    draw_map(folder / "map.png", picture)


def rounded(value: Any, digits: int | None = None) -> Any:
    """Return the content with rounded numbers.

    The unit at the end of a name gives the decimals of the number, or of all numbers in a section of that
    name, but a small number keeps LEAST_SIGNIFICANT digits. A number without a unit keeps SIGNIFICANT digits.
    """
    if isinstance(value, dict):
        return {key: rounded(part, DECIMALS.get(_unit(key), digits)) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(part, digits) for part in value]
    if not isinstance(value, float):
        return value
    if digits is None:
        return float(f"{value:.{SIGNIFICANT}g}")
    is_small = abs(value) < 10.0 ** (LEAST_SIGNIFICANT - 1 - digits)
    return float(f"{value:.{LEAST_SIGNIFICANT}g}") if is_small else round(value, digits)


def _unit(key: str) -> str:
    return str(key).rpartition("_")[2]


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(
        json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
