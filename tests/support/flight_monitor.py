"""Checks of a drawn flight against the simulator's truth and the messages on the wire."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from random_flights import ANSWERS_S, RandomFlight
from recorded import effects, messages, on_the_wire

from sim_vehicle.fleet import Fleet
from sim_vehicle.truth import Truth
from sim_vehicle.vehicle.behaviour import Behaviour
from swarmctl.core.geo import LatLon, LocalFrame, distance_m
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import distance_to_leg
from swarmctl.flight.run import VIRTUAL_EPOCH_NS
from swarmctl.mavlink.dialects import Dialect, dialect_for
from swarmctl.report import record
from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.log import FILE_NAME
from swarmctl.report.outcome import FlightReport

LIMIT_S = 1500.0
"""longest drawn flight"""
UP_M = 1.5
CLOSE_FOR_S = 0.5
WARNED_S = 30.0
"""time before a loss of separation within which a warning must come"""
AT_HOME_M = 15.0
STATION = 255
TAKEOFF, LAND, JUMP, ARM = (
    int(mavlink.MAV_CMD_NAV_TAKEOFF),
    int(mavlink.MAV_CMD_NAV_LAND),
    int(mavlink.MAV_CMD_DO_JUMP),
    int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM),
)
FLOWN = {TAKEOFF, LAND, int(mavlink.MAV_CMD_NAV_WAYPOINT), int(mavlink.MAV_CMD_NAV_LOITER_TO_ALT)}
MOVES = {ARM, int(mavlink.MAV_CMD_DO_SET_MODE), int(mavlink.MAV_CMD_MISSION_START)}
MOVES |= {int(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT), int(mavlink.MAV_CMD_DO_CHANGE_SPEED)}
WRITES = {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_SET_CURRENT"}

FlownItems = tuple[tuple[int, int, int, float], ...]
"""(command, x, y, z) of the flown items in order, down to a landing"""


def items_from(items: Sequence[Any], index: int) -> FlownItems:
    """Return the items that a vehicle flies from this index on."""
    way: list[tuple[int, int, int, float]] = []
    jumps = 0
    while 0 <= index < len(items) and jumps < 3:
        item = items[index]
        if item.command == JUMP:
            index, jumps = int(item.param1), jumps + 1
            continue
        if item.command == TAKEOFF:  # a take-off has the position of the vehicle on the ground
            way.append((TAKEOFF, 0, 0, 0.0))
        elif item.command in FLOWN:
            way.append((item.command, item.x, item.y, 0.0 if item.command == LAND else item.z))
        if item.command == LAND:
            break
        index += 1
    return tuple(way)


def _same(one: FlownItems, other: FlownItems) -> bool:
    """Return whether two sequences are equal to 2 cm in height."""
    return len(one) == len(other) and all(
        a[:3] == b[:3] and abs(a[3] - b[3]) < 0.02 for a, b in zip(one, other, strict=True)
    )


@dataclass
class FlightMonitor:
    """A monitor that records several times a second what the checks need after the flight."""

    drawn: RandomFlight
    fleet: Fleet | None = None
    truth: Truth | None = None
    flown: dict[int, list[tuple[float, FlownItems, LatLon]]] = field(default_factory=dict)
    """flown items and position of each vehicle in mission mode, at each change"""
    close: dict[tuple[int, int], list[float]] = field(default_factory=dict)
    """times at which two vehicles were too close in the air"""
    bad: list[str] = field(default_factory=list)
    _was_up: dict[int, bool] = field(default_factory=dict)
    heights_m: dict[int, list[tuple[float, float]]] = field(default_factory=dict)

    def attend(self) -> None:
        """Follow the simulator of the flight."""
        self.drawn.trouble.actions.insert(0, (0.0, self._meet))
        self.drawn.trouble.on_step = self._look

    def _meet(self, fleet: Fleet) -> None:
        self.fleet = fleet

    def _look(self, now: float, truth: Truth) -> None:
        assert now < LIMIT_S, "the flight does not end"
        self.truth = truth
        if self.fleet is None:
            return
        for index, vehicle in enumerate(self.fleet.vehicles):
            uav, height_m = vehicle.sysid, float(truth.height_m[index])
            self.heights_m.setdefault(uav, []).append((now, height_m))
            up = bool(truth.armed[index]) and height_m > UP_M
            stopped = self._was_up.get(uav) and not truth.armed[index] and height_m > UP_M
            if stopped and vehicle.booted and not truth.crashed[index]:
                self.bad.append(f"{now:.1f} s: {uav} is disarmed {height_m:.1f} m above the ground")
            self._was_up[uav] = up
            if up and vehicle.booted and vehicle.mode.behaviour is Behaviour.MISSION:
                mission = vehicle.mission
                items = [mission.item(i) for i in range(mission.count)]
                way, seen = items_from(items, mission.index), self.flown.setdefault(uav, [])
                if mission.current_item is not None and (not seen or seen[-1][1] != way):
                    seen.append((now, way, (float(truth.lat_deg[index]), float(truth.lon_deg[index]))))
        self._look_apart(now, truth)

    def _look_apart(self, now: float, truth: Truth) -> None:
        limits, tasks = self.drawn.scenario.config.separation, self.drawn.scenario.tasks
        up = [i for i in range(len(tasks)) if truth.armed[i] and truth.height_m[i] > UP_M]
        for i, j in combinations(up, 2):
            here, there = ((float(truth.lat_deg[k]), float(truth.lon_deg[k])) for k in (i, j))
            vertical_m = abs(float(truth.alt_amsl_m[i] - truth.alt_amsl_m[j]))
            if vertical_m < limits.vertical_m and distance_m(here, there) < limits.horizontal_m:
                self.close.setdefault((tasks[i].uav, tasks[j].uav), []).append(now)


# --- afterwards


def findings(monitor: FlightMonitor, report: FlightReport, folder: Path) -> list[str]:
    """Return a line for each broken rule."""
    return [
        *monitor.bad,
        *_mixtures(monitor, folder),
        *_orders(monitor, folder),
        *_unwarned(monitor, folder),
        *_untrue(monitor, report),
        *_records(folder),
    ]


def _dialect(monitor: FlightMonitor, uav: int) -> Dialect:
    assert monitor.fleet is not None
    personality = monitor.fleet.vehicles[monitor.fleet.sysids.index(uav)].personality
    return dialect_for(personality.identity.autopilot, personality.identity.vehicle_type)


def _plans(monitor: FlightMonitor, folder: Path, uav: int, name: str) -> list[tuple[float, FlownItems]]:
    """Return the start time of each agent's plan, with every sequence of its items."""
    dialect, spec = _dialect(monitor, uav), monitor.drawn.scenario.specs[uav - 1]
    ways = []
    for recorded in effects(folder, "SwapMission", name):
        plan = msgspec.convert(recorded["effect"]["mission"]["plan"], FlightPlan)
        items = dialect.mission_items(plan, spec.start)
        ways += [(recorded["now_s"], items_from(items, i)) for i in range(len(items))]
    return ways


def _mixtures(monitor: FlightMonitor, folder: Path) -> Iterator[str]:
    """Yield flown missions that are not the rest of one plan."""
    for uav, flown in monitor.flown.items():
        if uav in monitor.drawn.foreign:
            continue
        plans = _plans(monitor, folder, uav, f"uav{uav}")
        for now, way, place in flown:
            if not _is_planned(way, place, [plan for since_s, plan in plans if since_s <= now]):
                yield f"{now:.1f} s: {uav} flies items that no plan has: {way} [mixture]"


def _is_planned(way: FlownItems, place: LatLon, plans: Sequence[FlownItems]) -> bool:
    """Return whether the items are the rest of one plan.

    Waypoints of earlier plans on the straight line to its first item may precede it.
    """
    known = {item[:3] for plan in plans for item in plan}
    for n in range(len(way)):
        if any(_same(way[n:], plan) for plan in plans):
            return all(item[:3] in known and _is_passed(item, place, way[n]) for item in way[:n])
    return False


def _is_passed(item: tuple[int, int, int, float], place: LatLon, first: tuple[int, int, int, float]) -> bool:
    frame = LocalFrame(*place)
    there, on_the_way = (frame.to_local(x / 1e7, y / 1e7) for _, x, y, _ in (first, item))
    return distance_to_leg(on_the_way, (0.0, 0.0), there) < 2.0


def _sent(folder: Path, name: str) -> Iterator[tuple[float, Any]]:
    """Yield the station's messages with their times."""
    for message in on_the_wire(folder, name):
        if message.get_srcSystem() == STATION:
            yield message._timestamp - VIRTUAL_EPOCH_NS / 1e9, message


def _orders(monitor: FlightMonitor, folder: Path) -> Iterator[str]:
    """Yield orders to released vehicles that no operator gave, and orders to disarm in the air."""
    for task in monitor.drawn.scenario.tasks:
        releases = effects(folder, "Release", task.name)
        released_s = next((effect["now_s"] for effect in releases), math.inf)
        ordered_s = monitor.drawn.ordered_s.get(task.uav, [])
        for now, message in _sent(folder, task.name):
            command = getattr(message, "command", 0) if message.get_type() == "COMMAND_LONG" else 0
            by_operator = any(since_s <= now <= since_s + ANSWERS_S for since_s in ordered_s)
            is_order = command in MOVES or message.get_type() in WRITES
            if now > released_s and not by_operator and is_order:
                yield f"{now:.2f} s: {task.uav} was released at {released_s:.2f} s: {message} [order]"
            if command != ARM:
                continue
            if message.param2 != 0.0:
                yield f"{now:.2f} s: {task.uav} is armed or disarmed by force: {message}"
            if message.param1 == 0.0 and _height_m(monitor, task.uav, now) > UP_M:
                yield f"{now:.2f} s: {task.uav} is ordered to disarm in the air"


def _height_m(monitor: FlightMonitor, uav: int, now: float) -> float:
    return next((height_m for at_s, height_m in monitor.heights_m.get(uav, []) if at_s >= now), 0.0)


def _unwarned(monitor: FlightMonitor, folder: Path) -> Iterator[str]:
    """Yield pairs of vehicles without faults that come too close without a warning."""
    for pair, at_s in monitor.close.items():
        if set(pair) & monitor.drawn.excused or at_s[-1] - at_s[0] < CLOSE_FOR_S:
            continue
        texts = [
            entry["log_time_ns"] / 1e9 - VIRTUAL_EPOCH_NS / 1e9
            for entry in messages(folder, "/log")
            if entry["name"] in {f"uav{uav}" for uav in pair}
            and re.search(
                r"\[(alarm|route-conflict|height-change|plan-deferred|landing-queue)", entry["message"]
            )
        ]
        if not any(at_s[0] - WARNED_S <= text_s <= at_s[0] + CLOSE_FOR_S for text_s in texts):
            yield f"{at_s[0]:.1f} s: {pair} are too close without a warning [no-warning]"


def _untrue(monitor: FlightMonitor, report: FlightReport) -> Iterator[str]:
    """Yield final states and outcomes that contradict the simulator."""
    truth = monitor.truth
    assert truth is not None
    final_states = dict(line.split(": ", 1) for line in report.final_states)
    for index, task in enumerate(monitor.drawn.scenario.tasks):
        state, line = report.states[task.uav], final_states.get(task.name, "")
        armed, height_m = bool(truth.armed[index]), float(truth.height_m[index])
        place = (float(truth.lat_deg[index]), float(truth.lon_deg[index]))
        if armed and not any(words in line for words in ("in the air", "lost", "armed on the ground")):
            yield f"{task.uav} is armed at the end, and its final state is: {line}"
        if armed and report.ended == "ended" and "lost" not in line:
            yield f"{task.uav} is armed, and the flight has ended: {line}"
        if not armed and height_m < UP_M and "in the air" in line and "lost" not in line:
            yield f"{task.uav} is down, and its final state is: {line}"
        if task.uav in monitor.drawn.excused or task.wings is not None:
            continue
        cell = monitor.drawn.scenario.grid.cell_at(*place)
        if state.outcome == "arrived" and (armed or cell not in task.goals):
            yield f"{task.uav} has not arrived: it is in cell {cell}"
        away_m = distance_m(place, monitor.drawn.scenario.specs[index].start)
        if state.outcome == "return ordered; disarmed" and (armed or away_m > AT_HOME_M):
            yield f"{task.uav} has not returned: it is {away_m:.0f} m from home"


def _records(folder: Path) -> Iterator[str]:
    verdict = record.replay(folder / "run.mcap")
    if verdict.difference:
        yield f"the replay differs: {verdict.difference}"
    with (folder / FILE_NAME).open("rb") as file:
        checked = check(file)
    if checked.closing is None:
        yield f"the evidence is not whole: {checked.fault}"
