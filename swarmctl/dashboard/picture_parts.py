"""The parts of a picture, from the histories of a timeline. Pure."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.route_to_mission import flown_route
from swarmctl.agent.state import ARRIVED, Task
from swarmctl.config.communication import vehicle_of
from swarmctl.config.scenario import Scenario
from swarmctl.core.exposure import exposure_sum, length_cells, safety_factor
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.vehicle import MAX_DELAY_S
from swarmctl.dashboard.facts import Motion, VehicleFacts, Words
from swarmctl.dashboard.history import last_before
from swarmctl.dashboard.motions import SLOW_M_S
from swarmctl.dashboard.picture import (
    SILENT_AFTER_S,
    AreaPicture,
    Group,
    Hearing,
    RouteChange,
    ShownRoute,
    VehiclePicture,
)
from swarmctl.planners import Problem
from swarmctl.planners import base as planners
from swarmctl.report.foxglove import colour_of
from swarmctl.report.live_rows import link_text

if TYPE_CHECKING:
    from swarmctl.dashboard.model import Timeline

HEARING_FADES_S = 30.0
"""age of the last message after which the edge of a hearing graph is left out [s]"""
LOSS_OVER_S = 60.0
"""time over which the loss is estimated [s]"""
MIN_SENT = 4
"""least number of messages for an estimate of the loss"""


def area(scenario: Scenario) -> AreaPicture:
    """Return the constant part of the pictures."""
    grid, specs, config = scenario.grid, scenario.swarm, scenario.config
    hostiles = scenario.true_hostiles
    return AreaPicture(
        config.name,
        grid.rows,
        grid.cols,
        grid.cell_size_m,
        grid.corners(),
        tuple(sorted({goal for spec in specs for goal in spec.goals})),
        tuple(sorted(config.area.no_fly)),
        tuple(grid.frame.to_local(*corner) for corner in scenario.fence_polygon),
        None if hostiles is None else tuple(sorted(hostiles)),
        tuple(spec.name for spec in specs),
        tuple(colour_of(i) for i in range(len(specs))),
        tuple(spec.simulated for spec in specs),
    )


def route(grid: Grid, mission: PlannedMission) -> ShownRoute:
    """Return a plan as a route."""
    plan = mission.plan
    points = [(p.lat_deg, p.lon_deg) for p in (*plan.waypoints, plan.landing)]
    return ShownRoute(
        mission.plan_id,
        mission.cells,
        tuple(grid.frame.to_local(*point) for point in points),
        mission.length_m,
        mission.exposure_sum,
        mission.safety_factor,
    )


def flown(task: Task, problem: Problem, route: planners.Route) -> ShownRoute:
    """Return a planner's route as it would be flown. Raises Unreachable if it cannot be flown."""
    track, grid = flown_route(task, problem, route), task.grid
    points = tuple(grid.centre_m(cell) for cell in track.corners)
    length_m = track.length_cells * grid.cell_size_m
    return ShownRoute(0, route.cells, points, length_m, track.exposure_sum, track.safety_factor)


def rest_of_old(timeline: Timeline, change: RouteChange) -> ShownRoute | None:
    """Return the rest of the old route at a change, by the belief at the decision; None: not known."""
    if change.old is None:
        return None
    at = timeline.vehicle(change.vehicle).motion.at(change.time_s).lat_lon
    cell = None if at is None else timeline.scenario.grid.cell_at(*at)
    p_s = timeline.exposure(change.vehicle, change.time_s)
    return rest_of(change.old, cell, p_s, timeline.scenario.grid)


def rest_of(old: ShownRoute, cell: Cell | None, p_s: NDArray[np.float64], grid: Grid) -> ShownRoute | None:
    """Return the rest of a route from a cell on, with length and exposure by P_s; None beside the route."""
    if cell is None or cell not in old.cells:
        return None
    rest = old.cells[len(old.cells) - 1 - old.cells[::-1].index(cell) :]
    points = tuple(grid.centre_m(cell) for cell in rest)
    length_m = length_cells(rest) * grid.cell_size_m
    return ShownRoute(old.plan_id, rest, points, length_m, exposure_sum(p_s, rest), safety_factor(p_s, rest))


def vehicle(timeline: Timeline, facts: VehicleFacts, time_s: float) -> VehiclePicture:
    """Return a vehicle at a time."""
    motion, words = facts.motion.at(time_s), facts.words.at(time_s)
    word_s = last_before(facts.word_s, time_s)
    age_s = None if word_s is None else time_s - word_s
    frame, here = timeline.scenario.grid.frame, motion.lat_lon
    belief = facts.beliefs.belief(facts.beliefs.version(time_s)).belief
    has_all = timeline.kind != "bus"
    return VehiclePicture(
        facts.name,
        words.phase,
        words.mode,
        None if here is None else frame.to_local(*here),
        motion.height_m,
        motion.speed_m_s,
        motion.course_deg,
        None if motion.battery_percent is None else round(motion.battery_percent),
        progress(motion, words),
        arrives_in_s(motion, words),
        "" if timeline.kind == "abstract mission" else _link(motion, words, age_s),
        age_s,
        age_s is None or age_s > SILENT_AFTER_S,
        belief.n_observed if has_all else max(words.n_observed, belief.n_observed),
        belief.n_found if has_all else words.n_found,
        words.replans,
        None if motion.strikes is None else round(motion.strikes),
        words.waiting,
        words.outcome or words.trouble or words.group,
        facts.route.at(time_s),
        facts.track.until(time_s),
    )


def progress(motion: Motion, words: Words) -> float | None:
    """Return the share of the route, 0..1, as the terminal shows it."""
    if words.phase == "landing" or words.outcome == ARRIVED:
        return 1.0
    if motion.to_go_m is None:
        return None
    flown_m = motion.flown_m or 0.0
    return flown_m / max(flown_m + max(motion.to_go_m, 0.0), 1.0)


def arrives_in_s(motion: Motion, words: Words) -> float | None:
    """Return the predicted time to the last waypoint at the present speed."""
    if words.phase != "flying" or motion.to_go_m is None or not motion.speed_m_s:
        return None
    return max(motion.to_go_m, 0.0) / motion.speed_m_s if motion.speed_m_s > SLOW_M_S else None


def _link(motion: Motion, words: Words, age_s: float | None) -> str:
    delay_s = motion.delay_s or 0.0
    age_s = math.inf if age_s is None else age_s
    return link_text(age_s, delay_s, is_lost=words.lost_since_s is not None, is_late=delay_s > MAX_DELAY_S)


def hearing(timeline: Timeline, time_s: float) -> tuple[Hearing, ...]:
    """Return who hears whom, with the age of the last message and the share of lost messages."""
    edges = []
    for receiver in timeline.vehicles.values():
        for uav, heard_s in receiver.heard_s.items():
            last_s = last_before(heard_s, time_s)
            if last_s is not None and time_s - last_s <= HEARING_FADES_S:
                sender = timeline.vehicles[uav]
                sent_s, got_s = sender.intents.times_s, receiver.intents_heard_s[uav]
                loss = None if timeline.kind == "bus" else _loss(sent_s, got_s, time_s)
                edges.append(Hearing(sender.name, receiver.name, time_s - last_s, loss))
    return tuple(edges)


def groups(timeline: Timeline, time_s: float) -> tuple[Group, ...]:
    """Return the groups that fly together, with the members that are present."""
    shown, config = [], timeline.scenario.config
    for formation in config.formations:
        vehicles = [timeline.vehicles[vehicle_of(word, config.names)] for word in formation.members]
        members = [(vehicle.name, vehicle.words.at(time_s)) for vehicle in vehicles]
        present = [(name, words) for name, words in members if words.group]
        if len(present) < 2:
            continue
        # A station on the bus does not hear the leader's messages; the first member that is present leads.
        leader = next((name for name, words in present if words.leads), present[0][0])
        names = tuple(name for name, _ in present)
        errors_m = tuple(words.place_error_m for _, words in present)
        shown.append(Group(formation.name, names, leader, errors_m))
    return tuple(shown)


def _loss(sent_s: array[float], heard_s: array[float], time_s: float) -> float | None:
    """Return the share of the sender's messages that did not arrive over the last minute."""
    # A message that was sent just now may still arrive.
    until_s, since_s = time_s - 2.0, time_s - LOSS_OVER_S
    n_sent = bisect_right(sent_s, until_s) - bisect_right(sent_s, since_s)
    if n_sent < MIN_SENT:
        return None
    n_heard = bisect_right(heard_s, time_s) - bisect_right(heard_s, since_s)
    return max(0.0, 1.0 - n_heard / n_sent)
