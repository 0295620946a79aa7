"""What length buys: each vehicle's Pareto front of length against exposure, for an operator to choose from.

`fronts` searches; `front_table` and `write_fronts` show: a table for the terminal, `front.json` with every
route, `front.png`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table
from rich.text import Text

from swarmctl.agent import Task, before_takeoff, first_problem, first_route
from swarmctl.core.chance import Chance
from swarmctl.core.geo import LatLon
from swarmctl.picture import FrontBound, FrontPanel, FrontPoint, draw_fronts
from swarmctl.planners import Route
from swarmctl.planners.front import Front, pareto_front
from swarmctl.scenario import Scenario, Spec

ROWS = 12
"""of a front in the table, and lines of it on the map"""
PANELS_A_SHEET = 6
SAME = 1e-9
WHAT_IS_WHAT = (
    "time: from take-off to goal. ΣP_s is a sum of chances and ∏(1 − P_s) takes cells as independent: the "
    "chance of getting through is the one by simulation over what is believed at take-off, with its 95 % "
    "interval."
)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleFront:
    """One vehicle's front at take-off, and what the configuration makes of it."""

    spec: Spec
    task: Task
    exposure: NDArray[np.float64]
    """P_s (rows, cols) at take-off"""
    front: Front
    chosen: Route
    chosen_by: str
    chosen_index: int | None
    """on the front; None where the configured planner minds something else than the two"""
    shown: tuple[int, ...]
    """those worth a row"""
    chances: dict[int, Chance]
    """of the shown ones"""

    @property
    def name(self) -> str:
        return self.spec.name

    def length_m(self, route: Route) -> float:
        return route.length_cells * self.task.grid.cell_size_m

    def arrives_s(self, route: Route) -> float:
        underway = before_takeoff(self.task.arrival, self.task.altitude_m)
        return underway.arrives_s(self.task.arrival, self.length_m(route))

    def is_in_time(self, route: Route) -> bool:
        arrival = self.task.arrival
        return arrival.after_s <= self.arrives_s(route) <= arrival.within_s


def fronts(
    scenario: Scenario, names: Sequence[str] = (), max_labels: int | None = None
) -> tuple[VehicleFront, ...]:
    """The fronts of the vehicles named, or of all, over all lengths: a time bound is shown, not applied.

    `max_labels` as for `pareto_front`. Raises Unreachable.
    """
    chosen = [(index, spec) for index, spec in enumerate(scenario.specs) if not names or spec.name in names]
    return tuple(_front(scenario, index, spec, max_labels) for index, spec in chosen)


def _front(scenario: Scenario, index: int, spec: Spec, max_labels: int | None) -> VehicleFront:
    task = scenario.tasks[index]
    problem = first_problem(task, scenario.prior)
    unbounded = replace(problem, min_length_cells=0.0, max_length_cells=math.inf)
    front = pareto_front(unbounded, max_labels=max_labels)
    chosen = first_route(task, scenario.prior)
    at = next((i for i, route in enumerate(front.routes) if _equals(route, chosen)), None)
    shown = _knees(front, at)
    chances = {
        i: scenario.chance(task.uav, scenario.prior, scenario.strength, front.routes[i].cells) for i in shown
    }
    return VehicleFront(spec, task, problem.exposure, front, chosen, scenario.chosen_by, at, shown, chances)


def _equals(one: Route, other: Route) -> bool:
    return math.isclose(one.length_cells, other.length_cells, rel_tol=SAME) and math.isclose(
        one.exposure_sum, other.exposure_sum, rel_tol=SAME, abs_tol=SAME
    )


def _knees(front: Front, always: int | None) -> tuple[int, ...]:
    """At most ROWS of a front: its ends, the configured one, and then what bends most (Douglas and Peucker's
    order: always the point farthest from the line through those already there)."""
    n = len(front.routes)
    points = np.array([(route.length_cells, route.exposure_sum) for route in front.routes])
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), SAME)
    kept = {0, n - 1} | ({always} if always is not None else set())
    while len(kept) < min(ROWS, n):
        line = sorted(kept)
        between = np.interp(points[:, 0], points[line, 0], points[line, 1])
        away = np.abs(points[:, 1] - between)
        away[line] = -1.0
        kept.add(int(away.argmax()))
    return tuple(sorted(kept))


# --- the table


def front_table(found: Sequence[VehicleFront]) -> Table:
    """The routes worth knowing of each vehicle."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 1, 0, 0))
    grid.add_column("vehicle", no_wrap=True)
    for title in (Text("length [m]"), Text("time [s]"), "ΣP_s", "∏(1−P_s)", "chance (95 %)"):
        grid.add_column(title, justify="right", no_wrap=True)
    grid.add_column("for w", no_wrap=True)
    grid.add_column("", no_wrap=True)
    for vehicle in found:
        for row, index in enumerate(vehicle.shown):
            _add_row(grid, vehicle, index, first=row == 0)
        if vehicle.chosen_index is None:
            _add_numbers(grid, "", vehicle, vehicle.chosen, "", "not on the front", _mark(vehicle), "bold")
        grid.add_section()
    return grid


def _add_row(grid: Table, vehicle: VehicleFront, index: int, *, first: bool) -> None:
    route, front = vehicle.front.routes[index], vehicle.front
    is_chosen = index == vehicle.chosen_index
    style = "bold" if is_chosen else "" if vehicle.is_in_time(route) else "bright_black"
    mark = _mark(vehicle) if is_chosen else "" if vehicle.is_in_time(route) else "out of its time bound"
    name = vehicle.name if first else ""
    chance = str(vehicle.chances[index])
    _add_numbers(grid, name, vehicle, route, chance, weights(front, index), mark, style)


def _add_numbers(
    grid: Table, name: str, vehicle: VehicleFront, route: Route, chance: str, w: str, mark: str, style: str
) -> None:
    grid.add_row(
        name,
        f"{vehicle.length_m(route):.0f}",
        f"{vehicle.arrives_s(route):.1f}",
        f"{route.exposure_sum:.3f}",
        f"{route.safety_factor:.4f}",
        chance,
        w,
        mark,
        style=style,
    )


def _mark(vehicle: VehicleFront) -> str:
    return f"← {vehicle.chosen_by}"


def weights(front: Front, index: int) -> str:
    """For which w the planner of the paper gives a route, with as many digits as that takes."""
    w_range = front.w_ranges[index]
    if not front.supported[index] or w_range is None:
        return "none: constrained only"
    low, high = w_range
    if high - low < SAME:
        return f"{low:.4g} alone"
    for digits in count(2):
        if (a := f"{low:.{digits}g}") != (b := f"{high:.{digits}g}") or digits > 8:
            return f"{a} to {b}"
    raise AssertionError


def left_out(found: Sequence[VehicleFront]) -> list[str]:
    """What the table does not show, in words."""
    lines = []
    for vehicle in found:
        hidden = len(vehicle.front.routes) - len(vehicle.shown)
        if hidden > 0:
            lines.append(f"{vehicle.name}: {hidden} more of its {len(vehicle.front.routes)} in front.json")
        if not vehicle.front.complete:
            lines.append(
                f"{vehicle.name}: the search was cut off, so there may be more between these routes; "
                "give a greater --max-labels"
            )
    return lines


# --- the files


def write_fronts(folder: Path, scenario: Scenario, found: Sequence[VehicleFront]) -> None:
    """`front.json` and `front.png`, with `front-2.png` and so on for more vehicles than fit on a sheet."""
    content = {
        "name": scenario.config.name,
        "planner": scenario.config.planner.model_dump(mode="json"),
        "vehicles": [_vehicle(vehicle) for vehicle in found],
    }
    text = json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / "front.json").write_text(text, encoding="utf-8")
    for first in range(0, len(found), PANELS_A_SHEET):
        sheet = 1 + first // PANELS_A_SHEET
        name = "front.png" if sheet == 1 else f"front-{sheet}.png"
        panels = [_panel(vehicle) for vehicle in found[first : first + PANELS_A_SHEET]]
        title = f"{scenario.config.name}: what length buys"
        draw_fronts(folder / name, scenario.grid, panels, title, _subtitle(scenario, found))


def _vehicle(vehicle: VehicleFront) -> dict[str, Any]:
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
                **_numbers(vehicle, route),
                "supported": front.supported[index],
                "w": front.w_ranges[index],
                "chance_by_simulation": _chance(vehicle.chances.get(index)),
            }
            for index, route in enumerate(front.routes)
        ],
    }


def _numbers(vehicle: VehicleFront, route: Route) -> dict[str, Any]:
    return {
        "length_m": vehicle.length_m(route),
        "length_cells": route.length_cells,
        "arrives_s": vehicle.arrives_s(route),
        "in_time": vehicle.is_in_time(route),
        "exposure_sum": route.exposure_sum,
        "safety_factor": route.safety_factor,
        "cells": route.cells,
    }


def _chance(chance: Chance | None) -> dict[str, float] | None:
    if chance is None:
        return None
    return {"estimate": chance.estimate, "low_95": chance.low, "high_95": chance.high}


def _subtitle(scenario: Scenario, found: Sequence[VehicleFront]) -> str:
    n = len(found)
    return (
        f"{n} vehicle{'s' if n != 1 else ''} at take-off · length through the area against ΣP_s · "
        f"seed {scenario.config.seed}"
    )


def _panel(vehicle: VehicleFront) -> FrontPanel:
    front, arrival = vehicle.front, vehicle.task.arrival
    n, n_hull = len(front.routes), sum(front.supported)
    about = f"{n} route{'s' if n != 1 else ''}, {n_hull} on the hull"
    before_s = before_takeoff(arrival, vehicle.task.altitude_m).arrives_s(arrival, 0.0)
    ends = ((arrival.after_s, "not before"), (arrival.within_s, "within"))
    return FrontPanel(
        name=vehicle.name,
        about=about if front.complete else f"{about}; cut off, there may be more",
        points=[
            FrontPoint(
                vehicle.length_m(route),
                route.exposure_sum,
                front.supported[index],
                _track(vehicle, route) if index in vehicle.shown else None,
            )
            for index, route in enumerate(front.routes)
        ],
        exposure=vehicle.exposure,
        start=vehicle.spec.start,
        goal_cells=vehicle.task.goals,
        before_s=before_s,
        speed_m_s=arrival.speed_m_s,
        chosen=(vehicle.length_m(vehicle.chosen), vehicle.chosen.exposure_sum),
        chosen_by=vehicle.chosen_by,
        bounds=[
            FrontBound((end_s - before_s) * arrival.speed_m_s, f"{words} {end_s:g} s", words == "within")
            for end_s, words in ends
            if 0.0 < end_s < math.inf
        ],
    )


def _track(vehicle: VehicleFront, route: Route) -> list[LatLon]:
    return [vehicle.spec.start, *(vehicle.task.grid.centre(cell) for cell in route.cells)]
