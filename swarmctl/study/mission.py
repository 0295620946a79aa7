"""The abstract mission: sections 3 and 4 of the paper, cell by cell. Pure.

A vehicle climbs, flies straight from its start to its entry cell, and then from cell to cell, by length and
speed. Two things happen for each cell of its route:

at the edge of the cell
    The hostiles fire at it (Eq. 1). The vehicle sees the 3 × 3 cells, and tells the others what is new.
at the centre of the cell
    The vehicle decides. After new observations, own or received, it searches a route by the rule of a flight
    (`agent.replan`), and keeps its route unless the new one is better.

Messages take their way by the radio model of a flight. In one moment all vehicles first see, then receive,
and then decide. docs/study/abstract-mission.md says what a flight does otherwise, and by how much.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial

import numpy as np

from swarmctl.agent.replan.decide import (
    believed_exposure,
    choose_route,
    first_problem,
    problem_from,
    route_gains,
)
from swarmctl.agent.replan.length_bounds import LeadIn, before_takeoff
from swarmctl.agent.replan.route_to_mission import pulled_track
from swarmctl.agent.state import Task
from swarmctl.bus.radio import LossReason, Radio
from swarmctl.config.radio import radio_settings
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.core import exposure as measures
from swarmctl.core.any_angle.pull import Track
from swarmctl.core.belief import Belief, news
from swarmctl.core.frames import Frame, FrameCodec
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.planners.base import Problem, Route, Unreachable
from swarmctl.planners.benevolence import OtherVehicle
from swarmctl.study.entered_cells import NONE_ENTERED, EnteredCells, along_route, along_track
from swarmctl.study.tables import SeedResult
from swarmctl.study.vehicle_result import MissionResult, measured
from swarmctl.study.world import World

MAX_ENTRIES_PER_CELL = 4
"""greatest number of entries into cells, for each cell of the area; a vehicle with more does not arrive"""

Act = Callable[[float], None]
PointM = tuple[float, float]
"""(east, north) from the south-west corner of the area [m]"""


class EventOrder(IntEnum):
    """The order of events at one moment, least first."""

    SEE = 0
    RECEIVE = 1
    DECIDE = 2


Leg = tuple[float, PointM, float, PointM]
"""time and point of its begin, time and point of its end"""


class Watcher:
    """An observer of a mission, told of each event as it happens; here each method does nothing."""

    def flies(self, uav: int, leg: Leg) -> None:
        """A vehicle flies a leg."""

    def chooses(self, uav: int, now_s: float, route: Route, track: Track | None) -> None:
        """A vehicle takes a new route, and flies its straightened track, if it has one."""

    def enters(self, uav: int, now_s: float, strikes: int) -> None:
        """A vehicle enters a cell, and so many hostiles hit it."""

    def learns(self, uav: int, now_s: float, observation: Observation, sender: int | None) -> None:
        """A vehicle makes an observation, or receives it from the sender."""

    def arrives(self, uav: int, now_s: float) -> None:
        """A vehicle is at the centre of its goal cell."""


NOBODY = Watcher()


def fly_mission(scenario: Scenario, world: World, watcher: Watcher = NOBODY) -> MissionResult:
    """Fly all vehicles of a scenario across a world; `watcher` changes nothing.

    Raises ValueError for a scenario of which the abstract mission has no model (`unsupported`).
    """
    if (why := unsupported(scenario)) is not None:
        raise ValueError(why)
    mission = _Mission(scenario, world, watcher)
    mission.begin()
    while mission.events:
        now_s, _, _, act = heapq.heappop(mission.events)
        act(now_s)
    return mission.result()


def unsupported(scenario: Scenario) -> str | None:
    """Return why the abstract mission cannot fly a scenario; None if it can."""
    if any(task.turn_radius_m > 0.0 for task in scenario.tasks):
        return "a study has no turns of a radius; set turn_radius_m to 0, and fly copters"
    if scenario.config.arrival is not None:
        return "a study has no simultaneous or staggered arrival; remove the section arrival"
    if scenario.config.formations:
        return "each vehicle flies alone; set kind: flights, or remove the section formations"
    return None


def first_route(task: Task, belief: Belief) -> Route | None:
    """Return the route by the belief before the mission; None without a way to a goal."""
    try:
        return choose_route(task, first_problem(task, belief), None)[0]
    except Unreachable:
        return None


@dataclass(slots=True)
class Vehicle:
    """The state of one vehicle; only `_Mission` changes it."""

    task: Task
    spec: Spec
    belief: Belief
    own: Belief | None
    """belief by the vehicle's own observations; None without autonomy"""
    over_entry_s: float
    """time over the centre of the entry cell"""
    leg: Leg
    """the present leg"""
    first: Route | Track | None = None
    """route by the belief before the mission; None without a way to a goal"""
    route: tuple[Cell, ...] = ()
    entered: EnteredCells = NONE_ENTERED
    """the cells entered on the route, or on its straightened track"""
    index: int = 0
    """index in `entered` of the cell that the vehicle is in"""
    track_cells: float = 0.0
    """length flown on straightened tracks [cells]"""
    has_news: bool = False
    """True after observations that no decision has considered"""
    flown: list[Cell] = field(default_factory=list)
    strikes: list[int] = field(default_factory=list)
    visits: Counter[Cell] = field(default_factory=Counter)
    looks: Counter[Cell] = field(default_factory=Counter)
    n_observations: int = 0
    searches: int = 0
    replans: int = 0
    sent: int = 0
    received: int = 0
    arrived_s: float | None = None

    @property
    def enters_s(self) -> float:
        """Time at the edge of the entry cell, half a cell before its centre, for a start outside the area."""
        half_cell_s = 0.5 * self.task.grid.cell_size_m / self.task.speed_m_s
        return max(self.over_entry_s - half_cell_s, self.leg[0])

    def position_m(self, now_s: float) -> PointM:
        """Return the vehicle's position over ground: at its start, on its leg, or at its goal."""
        begin_s, (from_x, from_y), end_s, (to_x, to_y) = self.leg
        if now_s >= end_s:
            return to_x, to_y
        share = max(now_s - begin_s, 0.0) / (end_s - begin_s)
        return from_x + share * (to_x - from_x), from_y + share * (to_y - from_y)


def _distance_m(one: PointM, other: PointM) -> float:
    """Return the distance between two points, rounded as in the compiled mission."""
    east_m, north_m = one[0] - other[0], one[1] - other[1]
    return math.sqrt(east_m * east_m + north_m * north_m)


class _Mission:
    """One mission under way: its vehicles, and the events to come."""

    def __init__(self, scenario: Scenario, world: World, watcher: Watcher) -> None:
        communication = scenario.config.communication
        self._scenario = scenario
        self._world = world
        self._watcher = watcher
        self._radio = Radio(radio_settings(communication, scenario.config.names), world.seed)
        self._codec = None if communication.bandwidth_bytes_s is None else FrameCodec(scenario.config.name)
        others = len(scenario.tasks) - 1
        self._range = others if communication.range == "all" else min(communication.range, others)
        self._relays = communication.relay
        pairs = zip(scenario.tasks, scenario.specs, strict=True)
        self._vehicles = [on_ground(task, spec, scenario.prior) for task, spec in pairs]
        self._message_numbers = itertools.count()
        self.events: list[tuple[float, EventOrder, int, Act]] = []
        """(time, order, number of the vehicle or message, action)"""

    def begin(self) -> None:
        """Plan the first routes, as before a flight, and schedule the entries into the area."""
        for i, vehicle in enumerate(self._vehicles):
            vehicle.searches = 1
            self._watcher.flies(vehicle.task.uav, vehicle.leg)
            first = first_route(vehicle.task, vehicle.belief)
            if first is None:
                continue
            try:
                track = self._take(vehicle, first, first_problem(vehicle.task, vehicle.belief))
            except Unreachable:
                continue
            vehicle.first = first if track is None else track
            self._watcher.chooses(vehicle.task.uav, 0.0, first, track)
            self._enters_at(i, vehicle.enters_s, vehicle.over_entry_s)

    def _take(self, vehicle: Vehicle, route: Route, problem: Problem) -> Track | None:
        """Let a vehicle fly a new route; return its straightened track, if it has one. Raises Unreachable."""
        track = pulled_track(vehicle.task, problem, route)
        vehicle.route, vehicle.index = route.cells, 0
        vehicle.entered = along_route(route.cells) if track is None else along_track(track.corners)
        return track

    def _enters_at(self, i: int, edge_s: float, centre_s: float) -> None:
        self._schedule(edge_s, EventOrder.SEE, i, partial(self._enter, i))
        self._schedule(centre_s, EventOrder.DECIDE, i, partial(self._decide, i))

    def _schedule(self, at_s: float, order: EventOrder, number: int, act: Act) -> None:
        heapq.heappush(self.events, (at_s, order, number, act))

    # --- at the edge of a cell

    def _enter(self, i: int, now_s: float) -> None:
        """Let the hostiles fire, see the 3 × 3 cells, and tell the others what is new."""
        vehicle, world = self._vehicles[i], self._world
        cell, uav = vehicle.entered.cells[vehicle.index], vehicle.task.uav
        vehicle.flown.append(cell)
        vehicle.visits[cell] += 1
        vehicle.strikes.append(world.strikes(uav, cell, vehicle.visits[cell], self._scenario.strength))
        self._watcher.enters(uav, now_s, vehicle.strikes[-1])
        around = world.around(cell)
        vehicle.looks.update(around)
        sensor = vehicle.belief.sensor
        seen = [(r, c, world.shows_hostile(uav, (r, c), vehicle.looks[r, c], sensor)) for r, c in around]
        if new := news(vehicle.belief, vehicle.own, seen):
            vehicle.n_observations += 1
            observation = Observation(uav, vehicle.n_observations, now_s, new)
            self._learn(vehicle, observation)
            self._watcher.learns(uav, now_s, observation, None)
            self._send(i, observation, self._nearest(i, now_s), now_s)

    def _learn(self, vehicle: Vehicle, observation: Observation) -> bool:
        """Merge an observation; return whether it is new to the vehicle."""
        belief = vehicle.belief.merge((observation,))
        is_new = belief is not vehicle.belief
        vehicle.belief, vehicle.has_news = belief, vehicle.has_news or is_new
        if vehicle.own is not None and observation.observer == vehicle.task.uav:
            vehicle.own = vehicle.own.merge((observation,))
        return is_new

    # --- messages

    def _nearest(self, i: int, now_s: float) -> list[int]:
        """Return the vehicles in communication range: the nearest ones, as many as the range says."""
        others = [j for j in range(len(self._vehicles)) if j != i]
        if self._range == len(others):
            return others
        here = self._vehicles[i].position_m(now_s)
        metres = {j: _distance_m(here, self._vehicles[j].position_m(now_s)) for j in others}
        return sorted(others, key=lambda j: (metres[j], j))[: self._range]

    def _send(self, i: int, observation: Observation, to: list[int], now_s: float) -> None:
        vehicle = self._vehicles[i]
        here = vehicle.position_m(now_s)
        n_bytes = 0
        if self._codec is not None:
            frame = Frame(vehicle.task.uav, 0, observation.seq, now_s, observation, *vehicle.spec.start)
            n_bytes = len(self._codec.encode(frame))
        for j in to:
            vehicle.sent += 1
            arrives_s = self._radio.send(vehicle.task.uav, self._vehicles[j].task.uav, n_bytes, now_s)
            if not isinstance(arrives_s, LossReason):
                receive = partial(self._receive, j, i, observation, here)
                self._schedule(arrives_s, EventOrder.RECEIVE, next(self._message_numbers), receive)

    def _receive(
        self, i: int, sender: int, observation: Observation, sent_from: PointM, now_s: float
    ) -> None:
        """Merge a message within the distances of the radio, and pass on what is new if vehicles relay."""
        vehicle = self._vehicles[i]
        if self._radio.range_loss(_distance_m(vehicle.position_m(now_s), sent_from)) is not None:
            return
        vehicle.received += 1
        self._watcher.learns(vehicle.task.uav, now_s, observation, self._vehicles[sender].task.uav)
        if self._learn(vehicle, observation) and self._relays:
            uavs = [other.task.uav for other in self._vehicles]
            to = [j for j in self._nearest(i, now_s) if j != sender and uavs[j] != observation.observer]
            self._send(i, observation, to, now_s)

    # --- at the centre of a cell

    def _decide(self, i: int, now_s: float) -> None:
        """Arrive, or choose the next cell and fly there."""
        vehicle = self._vehicles[i]
        task, here = vehicle.task, vehicle.entered.cells[vehicle.index]
        if here in task.goals:
            vehicle.arrived_s = now_s
            self._watcher.arrives(task.uav, now_s)
            return
        if len(vehicle.flown) >= MAX_ENTRIES_PER_CELL * task.grid.n_cells:
            return
        if vehicle.has_news and here in vehicle.route:  # a track also crosses cells beside its route
            vehicle.has_news = False
            self._replan(vehicle, here, now_s)
        entered, index = vehicle.entered, vehicle.index
        vehicle.index += 1
        cell_s = task.grid.cell_size_m / task.speed_m_s
        step_cells = entered.to_edge[index] + entered.from_edge[index]
        vehicle.track_cells += step_cells
        ends_s, there = now_s + step_cells * cell_s, entered.cells[index + 1]
        vehicle.leg = now_s, task.grid.centre_m(here), ends_s, task.grid.centre_m(there)
        self._watcher.flies(task.uav, vehicle.leg)
        self._enters_at(i, now_s + entered.to_edge[index] * cell_s, ends_s)

    def _replan(self, vehicle: Vehicle, here: Cell, now_s: float) -> None:
        """Take the best route by the present belief if it is better than the rest of the present route."""
        task, strength = vehicle.task, self._scenario.strength
        p_s = believed_exposure(task, vehicle.belief, strength, vehicle.own)
        lead_in = LeadIn(elapsed_s=now_s - vehicle.spec.delay_s, climb_m=0.0, lead_m=0.0)
        gain = route_gains(task, p_s, vehicle.belief, strength, task.w, self._others(vehicle), vehicle.own)
        problem = problem_from(task, p_s, here, task.w, lead_in, gain)
        vehicle.searches += 1
        try:
            route, keeps = choose_route(task, problem, vehicle.route[vehicle.route.index(here) :])
            if not keeps:
                track = self._take(vehicle, route, problem)
                vehicle.replans += 1
                self._watcher.chooses(task.uav, now_s, route, track)
        except Unreachable:
            pass  # a vehicle in flight keeps its route

    def _others(self, vehicle: Vehicle) -> dict[int, OtherVehicle]:
        """Return the present cells of the others that have not arrived, for a benevolent vehicle."""
        return {
            other.task.uav: OtherVehicle(other.entered.cells[other.index], other.task.goals)
            for other in self._vehicles
            if other.task.uav in vehicle.task.others and other.arrived_s is None and other.route
        }

    # --- the result

    def result(self) -> MissionResult:
        p_s = measures.exposure(self._world.occupancy(), self._scenario.strength)  # Eq. 2
        return SeedResult(
            tuple(
                measured(
                    self._scenario,
                    i,
                    vehicle.first,
                    p_s,
                    np.array(vehicle.flown, dtype=np.int64).reshape(-1, 2),
                    sum(vehicle.strikes),
                    vehicle.arrived_s,
                    None if vehicle.task.any_angle is None else vehicle.track_cells,
                    searches=vehicle.searches,
                    replans=vehicle.replans,
                    messages_sent=vehicle.sent,
                    messages_received=vehicle.received,
                    cells_known=vehicle.belief.n_observed,
                    hostiles_known=vehicle.belief.n_found,
                )
                for i, vehicle in enumerate(self._vehicles)
            ),
            tuple(tuple(vehicle.flown) for vehicle in self._vehicles),
            tuple(tuple(vehicle.strikes) for vehicle in self._vehicles),
        )


def on_ground(task: Task, spec: Spec, belief: Belief) -> Vehicle:
    """Return a vehicle before its start: it climbs, and then flies straight to its entry cell."""
    lead_in = before_takeoff(task.arrival, task.altitude_m, task.start_delay_s)
    over_entry_s = spec.delay_s + lead_in.arrives_s(task.arrival, 0.0)
    climbed_s = over_entry_s - task.arrival.approach_m / task.speed_m_s
    start_m, entry_m = task.grid.frame.to_local(*spec.start), task.grid.centre_m(task.entry)
    leg = climbed_s, start_m, over_entry_s, entry_m
    own = belief if task.autonomy > 0.0 else None
    return Vehicle(task, spec, belief, own, over_entry_s, leg)
