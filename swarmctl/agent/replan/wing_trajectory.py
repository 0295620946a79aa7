"""The predicted trajectory of a fixed wing: ground roll, climb on the track, rounded turns, approach. Pure.

The speed is constant. The autopilot chooses the climb and sink rates; the rates here are assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from swarmctl.agent.replan.landing_pattern import LandingPattern, Pose, path_to_circle, pattern_from
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint

ROLL_S = 4.0
"""time from arming to leaving the ground [s]"""
CLIMB_M_S, SINK_M_S = 3.0, 3.0
"""assumed climb and sink rates [m/s]; defaults: TECS_CLMB_MAX 5, TECS_SINK_MIN 2, TECS_SINK_MAX 5"""
ROLL_OUT_S = 8.0
"""time on the ground after the touchdown [s]"""


def from_takeoff(task: Task, plan: FlightPlan, start: LatLon) -> Trajectory:
    """Return the trajectory of a whole flight, from arming at `start` to the stop, heights above home [m]."""
    begin = task.grid.frame.to_local(*start)
    builder = _TrajectoryBuilder((*begin, 0.0), task.speed_m_s)
    builder.stay(ROLL_S)
    _fly_and_land(builder, task, plan, [begin, *_points_of(task, plan)])
    return builder.trajectory()


def in_flight(
    task: Task, plan: FlightPlan, here: LocalPoint, remaining: Sequence[PlanarPoint], speed_m_s: float
) -> Trajectory:
    """Return the trajectory from `here` at 0 s, along the `remaining` track of a plan, to the stop."""
    builder = _TrajectoryBuilder(here, speed_m_s)
    _fly_and_land(builder, task, plan, [here[:2], *remaining])
    return builder.trajectory()


def approach_from(
    task: Task, plan: FlightPlan, here: LocalPoint, heading_rad: float, speed_m_s: float
) -> Trajectory:
    """Return the trajectory of the approach from `here`, a point over or past the goal, from 0 s."""
    builder = _TrajectoryBuilder(here, speed_m_s)
    _land(builder, task, plan, heading_rad)
    return builder.trajectory()


def _points_of(task: Task, plan: FlightPlan) -> list[PlanarPoint]:
    return [task.grid.frame.to_local(point.lat_deg, point.lon_deg) for point in plan.track]


def _fly_and_land(
    builder: _TrajectoryBuilder, task: Task, plan: FlightPlan, track: list[PlanarPoint]
) -> None:
    flown, _ = rounded(_distinct(track), task.turn_radius_m)
    builder.fly_to(flown[1:], plan.height_m)
    heading_rad = 0.0
    if len(flown) > 1:
        (e0, n0), (e1, n1) = flown[-2:]
        heading_rad = math.atan2(e1 - e0, n1 - n0)
    _land(builder, task, plan, heading_rad)


def _land(builder: _TrajectoryBuilder, task: Task, plan: FlightPlan, heading_rad: float) -> None:
    if plan.approach is None:
        return
    pattern, final_m = pattern_from(plan.approach, task.grid.frame), plan.approach.final.alt_rel_m
    path = path_to_circle(Pose(builder.point, heading_rad), pattern, task.turn_radius_m)
    builder.fly_to(path[1:], final_m)
    around = _circle_from(pattern, builder.point)
    while builder.up_m > final_m + 1.0:
        builder.fly_to(around, final_m)
    builder.fly_to(_to_exit(pattern, around), final_m)
    builder.fly_to([pattern.final], final_m)
    builder.descend_to(pattern.touchdown)
    builder.stay(ROLL_OUT_S)


def _circle_from(pattern: LandingPattern, point: PlanarPoint) -> list[PlanarPoint]:
    """Return points once around the circle, from the point of the circle nearest to `point` on."""
    circle = pattern.circle()[:-1]
    nearest = min(range(len(circle)), key=lambda i: math.dist(circle[i], point))
    return [*circle[nearest:], *circle[:nearest]]


def _to_exit(pattern: LandingPattern, around: list[PlanarPoint]) -> list[PlanarPoint]:
    exit_at = min(range(len(around)), key=lambda i: math.dist(around[i], pattern.circle_exit))
    return [*around[:exit_at], pattern.circle_exit]


def _distinct(track: Iterable[PlanarPoint]) -> list[PlanarPoint]:
    """Return the track without points within 0.1 m of the previous point: a leg of 0 m has no direction."""
    kept: list[PlanarPoint] = []
    for point in track:
        if not kept or math.dist(kept[-1], point) > 0.1:
            kept.append(point)
    return kept


class _TrajectoryBuilder:
    def __init__(self, begin: LocalPoint, speed_m_s: float) -> None:
        self._points, self._times_s = [begin], [0.0]
        self._speed_m_s = speed_m_s

    @property
    def point(self) -> PlanarPoint:
        return self._points[-1][:2]

    @property
    def up_m(self) -> float:
        return self._points[-1][2]

    def stay(self, seconds: float) -> None:
        self._points.append(self._points[-1])
        self._times_s.append(self._times_s[-1] + seconds)

    def fly_to(self, points: Iterable[PlanarPoint], height_m: float) -> None:
        """Add legs to the points, with a climb or descent towards `height_m`."""
        for point in points:
            took_s = math.dist(self.point, point) / self._speed_m_s
            most_m = (CLIMB_M_S if height_m > self.up_m else SINK_M_S) * took_s
            change_m = min(max(height_m - self.up_m, -most_m), most_m)
            self._add(point, self.up_m + change_m, took_s)

    def descend_to(self, point: PlanarPoint) -> None:
        """Add a straight slope to the ground."""
        self._add(point, 0.0, math.dist(self.point, point) / self._speed_m_s)

    def _add(self, point: PlanarPoint, up_m: float, took_s: float) -> None:
        if took_s > 1e-6:
            self._points.append((*point, up_m))
            self._times_s.append(self._times_s[-1] + took_s)

    def trajectory(self) -> Trajectory:
        return Trajectory(tuple(self._times_s), tuple(self._points)).checked()
