"""Routes that a vehicle would fly with other weights, from the cell below it and by its belief. Pure.

A `Question` is taken from a timeline; `route_with` and `front_of` answer it, in another thread if need be.
The answers leave out time bounds, benevolence and the way of the vehicle to the centre of its cell.
"""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.state import Task
from swarmctl.core.exposure import exposure
from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.dashboard import picture_parts
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.picture import ShownRoute
from swarmctl.planners import Problem, Unreachable
from swarmctl.planners.front import Front, pareto_front

MAX_LABELS = 200_000
"""limit on the labels of a front, about a second; a front that reaches it may lack unsupported routes"""


class NoAnswer(ValueError):
    """The reason why there is no route to show, as text."""


class Weights(msgspec.Struct, frozen=True):
    """The weights of the paper's sliders."""

    w: float
    strength: FiringStrength


class Question(msgspec.Struct, frozen=True):
    """A vehicle at one time: its task, what it believes, and where it is."""

    task: Task
    occupancy: NDArray[np.float64]
    """(rows, cols) probability that a cell is occupied, by the vehicle's belief"""
    cell: Cell
    planned: ShownRoute | None
    """the plan that is flown; None before the first"""

    def problem(self, weights: Weights) -> Problem:
        task, p_s = self.task, exposure(self.occupancy, weights.strength)
        return task.problem(p_s, self.cell, weights.w)

    def rest_of_plan(self, strength: FiringStrength) -> ShownRoute | None:
        """Return the rest of the plan, with ΣP_s by these strengths; None beside the plan."""
        if self.planned is None:
            return None
        return picture_parts.rest_of(
            self.planned, self.cell, exposure(self.occupancy, strength), self.task.grid
        )


def question_of(timeline: Timeline, name: str, time_s: float) -> Question:
    """Return the question of a vehicle at a time. Raises NoAnswer, and KeyError for an unknown name."""
    facts = timeline.vehicle(name)
    task = next((task for task in timeline.scenario.tasks if task.uav == facts.uav), None)
    here = facts.motion.at(time_s).lat_lon
    if task is None:
        raise NoAnswer(f"{name}: its task is not in this configuration")
    # On the ground a vehicle stands beside the area; its route begins in its entry cell.
    cell = None if here is None else timeline.scenario.grid.cell_at(*here)
    if cell is None and facts.track.until(time_s) and here is not None:
        raise NoAnswer(f"{name}: outside the area")
    occupancy = timeline.occupancy(name, time_s)
    return Question(task, occupancy, cell or task.entry, facts.route.at(time_s))


def weights_of(timeline: Timeline, name: str, time_s: float) -> Weights:
    """Return the weights by which a vehicle plans; for EVERYBODY those of the configuration."""
    w = timeline.words(name, time_s).w
    w = timeline.scenario.config.planner.w if w is None else w
    return Weights(w, timeline.strength(name, time_s))


def range_of(timeline: Timeline, name: str, time_s: float) -> int:
    """Return the number of nearest vehicles that a vehicle sends to; for EVERYBODY by the configuration."""
    reach = timeline.words(name, time_s).range
    reach = timeline.scenario.config.communication.range if reach is None else reach
    most = len(timeline.area.names) - 1
    return most if reach == "all" else min(reach, most)


def route_with(question: Question, weights: Weights) -> ShownRoute:
    """Return the route that the vehicle's planner finds with these weights. Raises NoAnswer."""
    problem = question.problem(weights)
    try:
        route = question.task.method.plan(problem)
        return picture_parts.flown(question.task, problem, route)
    except Unreachable as error:
        raise NoAnswer(str(error)) from error


def front_of(question: Question, weights: Weights) -> tuple[Front, tuple[ShownRoute, ...]]:
    """Return the Pareto front of length and ΣP_s, and its routes as they are flown. Raises NoAnswer."""
    problem = question.problem(weights)
    try:
        front = pareto_front(problem, max_labels=MAX_LABELS)
        return front, tuple(picture_parts.flown(question.task, problem, route) for route in front.routes)
    except Unreachable as error:
        raise NoAnswer(str(error)) from error
