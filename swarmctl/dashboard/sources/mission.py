"""An abstract mission of a study, flown again and told to a timeline. Pure.

Positions are those of the mission's model: straight legs of constant speed, without heights.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import partial

from swarmctl.agent.state import ARRIVED
from swarmctl.config.scenario import Scenario
from swarmctl.core.any_angle.pull import Track
from swarmctl.core.frames import StateShared
from swarmctl.core.observation import Observation
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.picture import MapPoint, ShownRoute
from swarmctl.planners import base as planners
from swarmctl.study.mission import Leg, Watcher, fly_mission
from swarmctl.study.vehicle_result import MissionResult
from swarmctl.study.world import World

WORD_EVERY_S = 1.0
"""interval of positions between the entries into cells [s]"""
Tell = Callable[[float], None]


def replayed(scenario: Scenario, world: World) -> tuple[Timeline, MissionResult]:
    """Return the timeline and the results of a mission. Raises ValueError if it cannot be flown."""
    watcher = _MissionWatcher(scenario, world)
    result = fly_mission(scenario, world, watcher)
    return watcher.timeline(), result


class _MissionWatcher(Watcher):
    """All that a mission tells, with its times."""

    def __init__(self, scenario: Scenario, world: World) -> None:
        self._scenario = scenario
        self._timeline = Timeline(scenario, "abstract mission")
        hostiles = tuple(sorted(world.hostiles))
        self._timeline.area = replace(self._timeline.area, hostiles=hostiles)
        uavs = [task.uav for task in scenario.tasks]
        self._starts = {spec.sysid: scenario.grid.frame.to_local(*spec.start) for spec in scenario.specs}
        self._legs: dict[int, list[Leg]] = {uav: [] for uav in uavs}
        self._strikes = dict.fromkeys(uavs, 0)
        self._arrived: set[int] = set()
        self._plans = dict.fromkeys(uavs, 0)
        self._events: list[tuple[float, Tell]] = []

    def flies(self, uav: int, leg: Leg) -> None:
        self._legs[uav].append(leg)

    def chooses(self, uav: int, now_s: float, route: planners.Route, track: Track | None) -> None:
        self._events.append((now_s, partial(self._choose, uav, route, track)))

    def enters(self, uav: int, now_s: float, strikes: int) -> None:
        self._events.append((now_s, partial(self._enter, uav, strikes)))

    def learns(self, uav: int, now_s: float, observation: Observation, sender: int | None) -> None:
        self._events.append((now_s, partial(self._learn, uav, observation, sender)))

    def arrives(self, uav: int, now_s: float) -> None:
        self._events.append((now_s, partial(self._arrive, uav)))

    # --- told again, in order of time

    def timeline(self) -> Timeline:
        """Return the timeline of the whole mission."""
        end_s = max((time_s for time_s, _ in self._events), default=0.0)
        words: list[tuple[float, Tell]] = [
            (k * WORD_EVERY_S, partial(self._say, uav))
            for k in range(math.ceil(end_s / WORD_EVERY_S) + 1)
            for uav in self._legs
        ]
        for time_s, tell in sorted([*self._events, *words], key=lambda event: event[0]):
            tell(min(time_s, end_s))
        self._timeline.text = "cell by cell, with straight legs and without heights"
        return self._timeline

    def _choose(self, uav: int, route: planners.Route, track: Track | None, time_s: float) -> None:
        self._plans[uav] += 1
        grid, sums = self._scenario.grid, track or route
        corners = route.cells if track is None else track.corners
        points: tuple[MapPoint, ...] = tuple(grid.centre_m(cell) for cell in corners)
        length_m = sums.length_cells * grid.cell_size_m
        cells = route.cells
        new = ShownRoute(self._plans[uav], cells, points, length_m, sums.exposure_sum, sums.safety_factor)
        self._timeline.chosen(uav, time_s, new)

    def _enter(self, uav: int, strikes: int, time_s: float) -> None:
        self._strikes[uav] += strikes
        self._say(uav, time_s)

    def _learn(self, uav: int, observation: Observation, sender: int | None, time_s: float) -> None:
        self._timeline.learned(uav, time_s, (observation,))
        if sender is not None:
            self._timeline.heard(uav, sender, time_s)

    def _arrive(self, uav: int, time_s: float) -> None:
        self._arrived.add(uav)
        self._say(uav, time_s)

    def _say(self, uav: int, time_s: float) -> None:
        """Tell position, velocity and phase of a vehicle."""
        (east_m, north_m), (east_m_s, north_m_s) = self._motion(uav, time_s)
        lat_deg, lon_deg = self._scenario.grid.frame.to_geodetic(east_m, north_m)
        arrived = uav in self._arrived
        is_moving = (east_m_s, north_m_s) != (0.0, 0.0)
        state = VehicleState(
            time_boot_s=time_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            ground_speed_m_s=math.hypot(east_m_s, north_m_s),
            east_m_s=east_m_s,
            north_m_s=north_m_s,
            armed=is_moving or self._strikes[uav] > 0 or arrived,
            strikes=self._strikes[uav],
        )
        self._timeline.telemetry(uav, time_s, state)
        phase = ("arrived" if arrived else "flying") if self._plans[uav] else "on the ground"
        word = StateShared(
            time_s, lat_deg, lon_deg, 0.0, 0.0, phase, 0, 0,
            plan_id=self._plans[uav],
            replans=max(self._plans[uav] - 1, 0),
            outcome=ARRIVED if arrived else "",
        )  # fmt: skip
        self._timeline.shared(uav, time_s, word, has_telemetry=True)

    def _motion(self, uav: int, time_s: float) -> tuple[MapPoint, MapPoint]:
        """Return position [m] and velocity [m/s] by the legs flown."""
        legs = self._legs[uav]
        n = bisect_right(legs, time_s, key=lambda leg: leg[0])
        if n == 0:
            return self._starts[uav], (0.0, 0.0)
        begin_s, (from_x, from_y), end_s, (to_x, to_y) = legs[n - 1]
        if time_s >= end_s:
            return (to_x, to_y), (0.0, 0.0)
        share, took_s = (time_s - begin_s) / (end_s - begin_s), end_s - begin_s
        here = from_x + share * (to_x - from_x), from_y + share * (to_y - from_y)
        return here, ((to_x - from_x) / took_s, (to_y - from_y) / took_s)
