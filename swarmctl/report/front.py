"""Pareto fronts of length against exposure, one per vehicle, from which an operator chooses.

`front.json` has every route; the table and the map of `front.png` show at most MAX_ROWS routes of a vehicle.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.decide import first_problem
from swarmctl.agent.replan.length_bounds import before_takeoff
from swarmctl.agent.replan.route_to_mission import FlownRoute, flown_route, lattice_route
from swarmctl.agent.replan.time_bound import arrives_s, bounds_of, misses_by, route_within_bounds
from swarmctl.agent.state import Task
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.geo import LatLon
from swarmctl.core.inference.survival import ProbabilityEstimate
from swarmctl.core.records import replace
from swarmctl.planners import Problem, Route, Unreachable
from swarmctl.planners.front import Front, pareto_front
from swarmctl.report.pictures.panel import FrontBound, FrontPanel, FrontPoint
from swarmctl.report.tables import Column, FittedTable, estimate_texts, product_text

MAX_ROWS = 12
"""greatest number of routes of a front in the table and on the map"""
PANELS_A_SHEET = 6
TOLERANCE = 1e-9
"""difference below which lengths, exposures or weights count as equal"""
EXPLANATION = (
    "time: from take-off to goal. for w: the weights w with which the paper's planner finds the route; –: "
    "only a search with a bound finds the route. ΣP_s is a sum of probabilities, and ∏(1 − P_s) assumes "
    "independent cells. The chance by simulation is the probability of survival, by the belief at take-off."
)
PULLED_NOTE = (
    "Routes are pulled straight. Each row shows the flown track of a route, so one row may be better than "
    "another row in length and in exposure."
)


class Candidate(msgspec.Struct, frozen=True):
    """A route of the front, and the track that the vehicle would fly for this route."""

    route: Route
    flown: FlownRoute
    """the track; the lattice route if the vehicle has no flyable track"""
    is_flyable: bool
    """False if no track for the route has turns as wide as the vehicle needs"""
    chance: ProbabilityEstimate
    """chance of surviving the track"""


class VehicleFront(msgspec.Struct, frozen=True, eq=False):
    """One vehicle's front at take-off, and the configured route."""

    spec: Spec
    task: Task
    exposure: NDArray[np.float64]
    """P_s (rows, cols) at take-off"""
    front: Front
    candidates: tuple[Candidate, ...]
    """the routes of the front, shortest first"""
    chosen: Candidate
    """the configured route"""
    chosen_by: str
    """label of the configured choice, such as `w = 0.5`"""
    chosen_index: int | None
    """index of the configured route on the front; None for a route that is not on the front"""
    shown: tuple[int, ...]
    """indices of the routes in the table and on the map"""

    @property
    def name(self) -> str:
        return self.spec.name

    def length_m(self, flown: FlownRoute) -> float:
        return flown.length_cells * self.task.grid.cell_size_m

    def arrives_s(self, flown: FlownRoute) -> float:
        """Return the arrival time after take-off, with the time of turns [s]."""
        return arrives_s(self.task, flown.length_cells, flown.corners)

    def is_in_time(self, flown: FlownRoute) -> bool:
        """Return whether the track keeps the time bound, by the rule of the planner."""
        task = self.task
        bounds = bounds_of(task, before_takeoff(task.arrival, task.altitude_m, task.start_delay_s))
        return misses_by(self.task, bounds, flown.length_cells, flown.corners) == 0.0


def fronts(
    scenario: Scenario, names: Sequence[str] = (), max_labels: int | None = None
) -> tuple[VehicleFront, ...]:
    """Return the fronts of the named vehicles (no names: of all), also with routes outside the time bound.

    `max_labels` as for `pareto_front`. Raises Unreachable.
    """
    specs = [(index, spec) for index, spec in enumerate(scenario.specs) if not names or spec.name in names]
    return tuple(_front(scenario, index, spec, max_labels) for index, spec in specs)


def _front(scenario: Scenario, index: int, spec: Spec, max_labels: int | None) -> VehicleFront:
    task = scenario.tasks[index]
    problem = first_problem(task, scenario.prior)
    unbounded = replace(problem, min_length_cells=0.0, max_length_cells=math.inf)
    front = pareto_front(unbounded, max_labels=max_labels)
    chosen = _candidate(scenario, task, problem, route_within_bounds(task, problem))
    chosen_index = next((i for i, route in enumerate(front.routes) if _equals(route, chosen.route)), None)
    # A point of the front may have several routes; the configured route is preferred.
    candidates = tuple(
        chosen if i == chosen_index else _candidate(scenario, task, problem, route)
        for i, route in enumerate(front.routes)
    )
    shown = _shown_indices(front, chosen_index)
    return VehicleFront(
        spec, task, problem.exposure, front, candidates, chosen, scenario.chosen_by, chosen_index, shown
    )


def _candidate(scenario: Scenario, task: Task, problem: Problem, route: Route) -> Candidate:
    try:
        flown, is_flyable = flown_route(task, problem, route), True
    except Unreachable:
        flown, is_flyable = lattice_route(route), False
    chance = scenario.survival_probability(task.uav, scenario.prior, task.strength, flown.cells)
    return Candidate(route, flown, is_flyable, chance)


def _equals(one: Route, other: Route) -> bool:
    return math.isclose(one.length_cells, other.length_cells, rel_tol=TOLERANCE) and math.isclose(
        one.exposure_sum, other.exposure_sum, rel_tol=TOLERANCE, abs_tol=TOLERANCE
    )


def _shown_indices(front: Front, chosen_index: int | None) -> tuple[int, ...]:
    """Return up to MAX_ROWS indices: both ends, the configured route, routes on the hull, other routes.

    Each step adds the point whose exposure differs most from the line through the selected points, as in
    Douglas and Peucker's algorithm. Points inside the hull are added after all points on the hull.
    """
    n = len(front.routes)
    points = np.array([(route.length_cells, route.exposure_sum) for route in front.routes])
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), TOLERANCE)
    selected = {0, n - 1} | ({chosen_index} if chosen_index is not None else set())
    while len(selected) < min(MAX_ROWS, n):
        line = sorted(selected)
        between = np.interp(points[:, 0], points[line, 0], points[line, 1])
        away = np.abs(points[:, 1] - between)
        away[line] = -1.0
        if any(s and i not in selected for i, s in enumerate(front.supported)):
            away[~np.array(front.supported)] = -1.0
        selected.add(int(away.argmax()))
    return tuple(sorted(selected))


# --- the table


COLUMNS = (
    Column("vehicle", "left"), Column("length\n[m]"), Column("time\n[s]"), Column("ΣP_s"),
    Column("∏(1−P_s)", rank=2), Column("chance by\nsimulation"), Column("95 %\ninterval", rank=3),
    Column("for w", "left", rank=1), Column("", "left", wraps_at=16),
)  # fmt: skip


def front_table(found: Sequence[VehicleFront]) -> FittedTable:
    """Return a table of the `shown` routes and the configured route of each vehicle."""
    table = FittedTable(COLUMNS, elsewhere="front.json")
    for vehicle in found:
        for row, index in enumerate(vehicle.shown):
            _add_row(table, vehicle, index, with_name=row == 0)
        if vehicle.chosen_index is None:
            _add_numbers(
                table, "", vehicle, vehicle.chosen, "not on the front", _chosen_note(vehicle), "bold"
            )
        table.end_section()
    return table


def _add_row(table: FittedTable, vehicle: VehicleFront, index: int, *, with_name: bool) -> None:
    candidate = vehicle.candidates[index]
    is_chosen = index == vehicle.chosen_index
    note = _chosen_note(vehicle) if is_chosen else _fault(vehicle, candidate)
    style = "bold" if is_chosen else "bright_black" if note else ""
    name = vehicle.name if with_name else ""
    _add_numbers(table, name, vehicle, candidate, w_range_text(vehicle.front, index), note, style)


def _add_numbers(
    table: FittedTable, name: str, vehicle: VehicleFront, candidate: Candidate, w: str, note: str, style: str
) -> None:
    flown = candidate.flown
    table.add_row(
        name,
        f"{vehicle.length_m(flown):.0f}",
        f"{vehicle.arrives_s(flown):.1f}",
        f"{flown.exposure_sum:.3f}",
        product_text(flown.safety_factor),
        *estimate_texts(candidate.chance),
        w,
        note,
        style=style,
    )


def _chosen_note(vehicle: VehicleFront) -> str:
    fault = _fault(vehicle, vehicle.chosen)
    return f"← {vehicle.chosen_by}" + (f", {fault}" if fault else "")


def _fault(vehicle: VehicleFront, candidate: Candidate) -> str:
    """Return the reason against this route; empty for a route that the vehicle would fly."""
    if not candidate.is_flyable:
        return "turns too tight"
    return "" if vehicle.is_in_time(candidate.flown) else "outside the time bound"


def w_range_text(front: Front, index: int) -> str:
    """Return the range of w with which the paper's planner finds the route `index`; – if no w finds it."""
    w_range = front.w_ranges[index]
    if not front.supported[index] or w_range is None:
        return "–"
    ends = {0.0, 1.0} | {w for limits in front.w_ranges if limits is not None for w in limits}
    low, high = w_range
    if high - low < TOLERANCE:
        return f"{_weight(low, ends)} alone"
    return f"{_weight(low, ends)} to {_weight(high, ends)}"


def _weight(w: float, ends: set[float]) -> str:
    """Return w as text, rounded by at most a quarter of its distance to the nearest other value in `ends`.

    So all values in `ends` have different texts, and only w = 0 and w = 1 have the texts 0 and 1.
    """
    max_error = min(abs(w - other) for other in ends if abs(w - other) >= TOLERANCE) / 4.0
    texts = (f"{w:.{digits}g}" for digits in range(2, 18))
    return next(text for text in texts if abs(float(text) - w) <= max_error)


def front_notes(found: Sequence[VehicleFront]) -> list[str]:
    """Return notes about hidden routes, searches that reached their limit, and straightened routes."""
    lines = []
    for vehicle in found:
        hidden = len(vehicle.front.routes) - len(vehicle.shown)
        if hidden > 0:
            lines.append(
                f"{vehicle.name}: {hidden} more of {len(vehicle.front.routes)} routes are in front.json"
            )
        if not vehicle.front.complete:
            lines.append(
                f"{vehicle.name}: the search has reached its limit, so more routes may exist between these "
                "routes; raise --max-labels"
            )
    if any(candidate.flown.is_pulled for vehicle in found for candidate in vehicle.candidates):
        lines.append(PULLED_NOTE)
    return lines


# --- the files


def write_fronts(folder: Path, scenario: Scenario, found: Sequence[VehicleFront]) -> None:
    """Write `front.json` and `front.png`, and `front-2.png` … for more vehicles than fit on a sheet."""
    content = {
        "name": scenario.config.name,
        "planner": scenario.config.planner.model_dump(mode="json"),
        "vehicles": [_vehicle_content(vehicle) for vehicle in found],
    }
    text = json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / "front.json").write_text(text, encoding="utf-8")
    # Matplotlib takes a second to import.
    from swarmctl.report.pictures.front import draw_fronts  # noqa: PLC0415

    for first in range(0, len(found), PANELS_A_SHEET):
        sheet = 1 + first // PANELS_A_SHEET
        name = "front.png" if sheet == 1 else f"front-{sheet}.png"
        panels = [panel_of(vehicle) for vehicle in found[first : first + PANELS_A_SHEET]]
        title = f"{scenario.config.name}: length against exposure"
        draw_fronts(folder / name, scenario.grid, panels, title, _subtitle(scenario, found))


def _vehicle_content(vehicle: VehicleFront) -> dict[str, Any]:
    arrival, front = vehicle.task.arrival, vehicle.front
    return {
        "name": vehicle.name,
        "complete": front.complete,
        "speed_m_s": arrival.speed_m_s,
        "arrive_after_s": arrival.after_s,
        "arrive_within_s": None if math.isinf(arrival.within_s) else arrival.within_s,
        "configured": {**_numbers(vehicle, vehicle.chosen), "index": vehicle.chosen_index},
        "routes": [
            {
                **_numbers(vehicle, candidate),
                "supported": front.supported[index],
                "w": front.w_ranges[index],
            }
            for index, candidate in enumerate(vehicle.candidates)
        ],
    }


def _numbers(vehicle: VehicleFront, candidate: Candidate) -> dict[str, Any]:
    """Return the numbers of the track; for a straightened track also the numbers of the lattice route."""
    flown, route, chance = candidate.flown, candidate.route, candidate.chance
    pulled_from = {
        "length_m": route.length_cells * vehicle.task.grid.cell_size_m,
        "exposure_sum": route.exposure_sum,
        "safety_factor": route.safety_factor,
        "cells": route.cells,
    }
    return {
        "length_m": vehicle.length_m(flown),
        "length_cells": flown.length_cells,
        "arrives_s": vehicle.arrives_s(flown),
        "in_time": vehicle.is_in_time(flown),
        "flyable": candidate.is_flyable,
        "exposure_sum": flown.exposure_sum,
        "safety_factor": flown.safety_factor,
        "chance_by_simulation": {"estimate": chance.estimate, "low_95": chance.low, "high_95": chance.high},
        "cells": flown.cells,
        "corners": flown.corners,
        "pulled_from": pulled_from if flown.is_pulled else None,
    }


def _subtitle(scenario: Scenario, found: Sequence[VehicleFront]) -> str:
    n = len(found)
    return (
        f"{n} vehicle{'s' if n != 1 else ''} at take-off · length through the area against ΣP_s · "
        f"seed {scenario.config.seed}"
    )


def panel_of(vehicle: VehicleFront) -> FrontPanel:
    """Return the content of the picture of a vehicle's front."""
    front, arrival, chosen = vehicle.front, vehicle.task.arrival, vehicle.chosen
    n, n_hull = len(front.routes), sum(front.supported)
    about = f"{n} route{'s' if n != 1 else ''}, {n_hull} on the hull"
    entry_s = before_takeoff(arrival, vehicle.task.altitude_m, vehicle.task.start_delay_s).arrives_s(
        arrival, 0.0
    )
    ends = ((arrival.after_s, "not before"), (arrival.within_s, "within"))
    return FrontPanel(
        name=vehicle.name,
        about=about if front.complete else f"{about}; search limit reached",
        points=[
            FrontPoint(
                vehicle.length_m(candidate.flown),
                candidate.flown.exposure_sum,
                front.supported[index],
                _track(vehicle, candidate) if index in vehicle.shown else None,
            )
            for index, candidate in enumerate(vehicle.candidates)
        ],
        exposure=vehicle.exposure,
        start=vehicle.spec.start,
        goal_cells=vehicle.task.goals,
        entry_s=entry_s,
        speed_m_s=arrival.speed_m_s,
        chosen=(vehicle.length_m(chosen.flown), chosen.flown.exposure_sum),
        chosen_label=vehicle.chosen_by,
        chosen_track=_track(vehicle, chosen) if vehicle.chosen_index is None else None,
        bounds=[
            FrontBound((end_s - entry_s) * arrival.speed_m_s, f"{words} {end_s:g} s", words == "within")
            for end_s, words in ends
            if 0.0 < end_s < math.inf
        ],
    )


def _track(vehicle: VehicleFront, candidate: Candidate) -> list[LatLon]:
    """Return the line from the start over the corners, with arcs if the track is flyable with wide turns."""
    grid, radius_m = vehicle.task.grid, vehicle.task.turn_radius_m
    points = [grid.frame.to_local(*grid.centre(cell)) for cell in candidate.flown.corners]
    if candidate.is_flyable and radius_m > 0.0:
        points, _ = rounded(points, radius_m)
    return [vehicle.spec.start, *(grid.frame.to_geodetic(*point) for point in points)]
