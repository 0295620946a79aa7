"""Checks of common arrivals (`arrival`) and of time bounds (`arrive_within_s`, `arrive_after_s`). Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import compress
from operator import attrgetter

from swarmctl.agent.replan.climb import climb_s
from swarmctl.agent.replan.length_bounds import before_takeoff
from swarmctl.agent.replan.time_bound import arrives_s
from swarmctl.agent.state import Task
from swarmctl.config.model import Config
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.vehicles import Simulate, Vehicle
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.planners import PLANNERS, Route

SUPPORTS = {"arrive_within_s": attrgetter("KEEPS_LONGEST"), "arrive_after_s": attrgetter("KEEPS_SHORTEST")}
"""time bound -> the declaration of a planner that keeps it"""


def time_bounds(section: Simulate | Vehicle) -> list[str]:
    """Return the keys of the given time bounds."""
    given = (section.arrive_within_s is not None, section.arrive_after_s > 0.0)
    return list(compress(("arrive_within_s", "arrive_after_s"), given))


def check_arrival(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of a common arrival: vehicles without a speed, and time bounds beside `arrival`."""
    if config.arrival is None:
        return
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.speed_m_s is None:
            text = "is missing: `arrival` needs the vehicle's greatest speed over ground [m/s]; add it"
            yield ConfigProblem(("vehicles", i, "speed_m_s"), text)
    for here, section in config.vehicle_sections:
        for key in time_bounds(section):
            text = "`arrival` sets the arrival time of all vehicles; remove this key, or `arrival`"
            yield ConfigProblem((*here, key), text)


def check_time_bounds(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of time bounds: no speed, a contradiction, or a planner that ignores the bound."""
    for here, section in config.vehicle_sections:
        after_s, within_s = section.arrive_after_s, section.arrive_within_s
        for key in time_bounds(section):
            yield from _check_support(config.planner.name, (*here, key), key)
        if time_bounds(section) and section.speed_m_s is None:
            text = "is missing: a time bound needs the vehicle's speed over ground [m/s]; add it"
            yield ConfigProblem((*here, "speed_m_s"), text)
        if within_s is not None and after_s > within_s:
            text = f"{after_s:g} is later than arrive_within_s = {within_s:g}"
            text = f"{text}; lower arrive_after_s, or raise arrive_within_s"
            yield ConfigProblem((*here, "arrive_after_s"), text)


def _check_support(planner: str, path: KeyPath, bound: str) -> Iterator[ConfigProblem]:
    names = [name for name, other in PLANNERS.items() if SUPPORTS[bound](other)]
    if planner not in names:
        text = f"planner {planner} ignores this bound; set planner.name: {' or '.join(names)}"
        yield ConfigProblem(path, text, depends_on=("planner", "name"))


def unmet_time_bound(task: Task, nearest: Route, here: KeyPath) -> Iterator[ConfigProblem]:
    """Yield the problem of a bound that no route meets; `nearest` comes closest to the bound."""
    arrival, lead_in = task.arrival, before_takeoff(task.arrival, task.altitude_m, task.start_delay_s)
    takes_s = arrives_s(task, nearest.length_cells, nearest.cells)
    up_s, lead_s = climb_s(task.altitude_m), lead_in.lead_m / arrival.speed_m_s
    through_s = nearest.length_cells * task.grid.cell_size_m / arrival.speed_m_s
    lost_s = takes_s - up_s - lead_s - through_s
    parts = f"{up_s:.1f} s to climb, {lead_s:.1f} s to the area, {through_s:.1f} s through it and "
    parts += f"{lost_s:.1f} s for lift-off, acceleration and turns"
    if takes_s > arrival.within_s:
        needed_s = math.ceil(10.0 * takes_s) / 10.0
        text = f"{arrival.within_s:g} s is too short for {task.name}: the fastest route found takes "
        yield ConfigProblem((*here, "arrive_within_s"), f"{text}{needed_s:.1f} s ({parts}); raise the bound")
    else:
        text = f"no route of planner {task.method.name} takes {task.name} {arrival} from take-off to goal: "
        text += f"the closest route takes {takes_s:.1f} s ({parts}); widen the window"
        yield ConfigProblem((*here, "arrive_after_s"), text)
