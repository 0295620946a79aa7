"""Changes of the configuration by clicks in the set-up, and the map of it. Pure."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from typing import Any

import msgspec

from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.grid import Grid
from swarmctl.dashboard import picture_parts
from swarmctl.dashboard.picture import MapPoint, ShownRoute
from swarmctl.planners import Unreachable
from swarmctl.report import first_plans

TOOLS = {
    "no_fly": "No-fly cells",
    "goal": "Goal",
    "start": "Start",
    "hostile": "Hostiles",
    "area": "South-west corner",
}
"""what a click on the map sets"""
SIMULATED = ""
"""the choice of all simulated vehicles instead of one by URL"""

Edits = dict[KeyPath, Any]


class FirstRouteShown(msgspec.Struct, frozen=True):
    """A vehicle's first route on the map."""

    name: str
    start: MapPoint
    route: ShownRoute | None
    """None if no track of the route can be flown"""


def edits_of_click(config: Config, tool: str, whose: str, at: MapPoint) -> Edits:
    """Return the edits for a click at (east, north) [m]. Raises ValueError with the reason for a refusal."""
    grid = config.grid
    if tool == "area":
        lat_deg, lon_deg = grid.frame.to_geodetic(*at)
        return {
            ("area", "origin_lat_deg"): round(lat_deg, 6),
            ("area", "origin_lon_deg"): round(lon_deg, 6),
        }
    if tool == "start":
        return _start(config, grid, whose, at)
    row, col = (math.floor(at[1] / grid.cell_size_m), math.floor(at[0] / grid.cell_size_m))
    if not grid.contains((row, col)):
        raise ValueError(f"row {row}, column {col} is outside the area; click a cell of the area")
    cell = (row, col)
    if tool == "no_fly":
        return {("area", "no_fly"): _toggled(config.area.no_fly, cell) or None}
    if tool == "hostile":
        hostiles = config.threats.hostiles
        before = hostiles if isinstance(hostiles, tuple) else ()
        return {("threats", "hostiles"): _toggled(before, cell)}
    return {(*_section(config, whose), "goal"): [row, col]}


def _section(config: Config, whose: str) -> KeyPath:
    if whose == SIMULATED:
        return ("simulate",)
    return ("vehicles", [vehicle.name for vehicle in config.vehicles].index(whose))


def _start(config: Config, grid: Grid, whose: str, at: MapPoint) -> Edits:
    if whose != SIMULATED:
        lat_deg, lon_deg = grid.frame.to_geodetic(*at)
        place = _section(config, whose)
        return {
            (*place, "start", "lat_deg"): round(lat_deg, 6),
            (*place, "start", "lon_deg"): round(lon_deg, 6),
        }
    away_m = {
        "west": -at[0],
        "east": at[0] - grid.size_east_m,
        "south": -at[1],
        "north": at[1] - grid.size_north_m,
    }
    side = max(away_m, key=lambda name: away_m[name])
    if away_m[side] < 1.0:
        raise ValueError("simulated vehicles start outside the area; click beside it")
    return {
        ("simulate", "start_side"): side,
        ("simulate", "start_distance_m"): float(round(away_m[side])),
    }


def _toggled(cells: tuple[tuple[int, int], ...], cell: tuple[int, int]) -> list[list[int]]:
    kept = [c for c in cells if c != cell]
    return [list(c) for c in (kept if len(kept) < len(cells) else [*cells, cell])]


def first_routes(scenario: Scenario) -> list[FirstRouteShown]:
    """Return the configured first route of each vehicle, as `swarmctl plan` computes it."""
    grid, found = scenario.grid, first_plans.configured_routes(scenario)
    shown = []
    for spec, first in zip(scenario.specs, found, strict=True):
        route = None
        with contextlib.suppress(Unreachable):
            route = picture_parts.flown(first.task, first.problem, first.route)
        shown.append(FirstRouteShown(spec.name, grid.frame.to_local(*spec.start), route))
    return shown


def as_changes(routes: list[FirstRouteShown]) -> Mapping[str, Any]:
    """Return the routes in the form of `changes.changes`, for the map."""
    vehicles = {}
    for shown in routes:
        points = None if shown.route is None else (shown.start, *shown.route.points)
        vehicles[shown.name] = {
            "position": shown.start,
            "heading_deg": 0.0 if points is None else _course_deg(points[0], points[1]),
            "is_silent": False,
            "age_s": 0.0,
            "route": None if points is None else {"points": points},
        }
    return {"vehicles": vehicles}


def _course_deg(begin: MapPoint, end: MapPoint) -> float:
    return math.degrees(math.atan2(end[0] - begin[0], end[1] - begin[1])) % 360.0
