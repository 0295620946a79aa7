"""From a plan to where its vehicle is at what time: the trajectory by which vehicles are kept apart. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from swarmctl.agent.replan import travel_time, wing_trajectory
from swarmctl.agent.replan.length_bounds import CLIMB_M_S, LIFT_S
from swarmctl.agent.replan.stopping import ANEW_M_S, BrakingStop, split_track
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint

DESCENT_M_S = 1.5
"""at which a landing begins: ArduCopter's WPNAV_SPEED_DN as it comes"""
LAND_M_S = 0.5
"""and goes on from LOW_M above home: LAND_SPEED"""
LEVEL_S = 0.4
"""What is climbed in less is level."""
APART_S = 1e-3
"""Two points of a flight that are nearer in time are one."""
LOW_M = 10.0
"""LAND_ALT_LOW"""


def from_takeoff(task: Task, plan: FlightPlan, start: LatLon) -> Trajectory:
    """A whole flight, from when it is armed at `start` to its touch-down; up is above home [m].

    It climbs on the spot, flies to its first waypoint as to every other, and comes down at its landing spot.
    """
    if task.wings is not None:
        return wing_trajectory.from_takeoff(task, plan, start)
    here = (*task.grid.frame.to_local(*start), 0.0)
    return climb_then_fly(here, height_of(plan), waypoints_of(task, plan), task.arrival.speed_m_s, LIFT_S)


def height_of(plan: FlightPlan) -> float:
    """The height above home at which a plan is flown [m]."""
    return plan.landing.alt_rel_m


def at_height(plan: FlightPlan, height_m: float) -> FlightPlan:
    """The same over ground, `height_m` above home."""
    return replace(
        plan,
        takeoff_alt_m=height_m if plan.approach is None else plan.takeoff_alt_m,
        track=tuple(replace(point, alt_rel_m=height_m) for point in plan.track),
        landing=replace(plan.landing, alt_rel_m=height_m),
    )


def with_level_off(task: Task, plan: FlightPlan, here: LocalPoint, after_s: float) -> FlightPlan:
    """The same with a waypoint more where it is at its height, which it begins to come to in `after_s`.

    Between waypoints vehicles rise and sink evenly: to a far one it would come to its height only there.
    """
    height_m, place = height_of(plan), waypoints_of(task, plan)[0]
    rate_m_s = CLIMB_M_S if height_m > here[2] else DESCENT_M_S
    takes_s = abs(height_m - here[2]) / rate_m_s
    level_m, away_m = task.arrival.speed_m_s * (after_s + takes_s), math.dist(here[:2], place)
    if takes_s < LEVEL_S or away_m < 2.0 * level_m:
        return plan
    east_m, north_m = (a + level_m / away_m * (b - a) for a, b in zip(here[:2], place, strict=True))
    level = Waypoint(*task.grid.frame.to_geodetic(east_m, north_m), height_m)
    return replace(plan, track=(level, *plan.track))


def waypoints_of(task: Task, plan: FlightPlan) -> list[PlanarPoint]:
    """The waypoints of a plan, and where it comes down."""
    frame = task.grid.frame
    return [frame.to_local(point.lat_deg, point.lon_deg) for point in (*plan.track, plan.landing)]


def climb_then_fly(
    here: LocalPoint, height_m: float, way: Sequence[PlanarPoint], speed_m_s: float, lift_s: float = 0.0
) -> Trajectory:
    """From when it begins to climb on the spot, after `lift_s`, along a way at that height, and down."""
    up_s = lift_s + max(height_m - here[2], 0.0) / CLIMB_M_S
    there = (here[0], here[1], height_m)
    if up_s == 0.0:
        return fly_along(there, height_m, way, speed_m_s)
    flight = fly_along(there, height_m, way, speed_m_s).later(up_s)
    return Trajectory((0.0, *flight.times_s), (here, *flight.points))


def fly_with_stop(
    here: LocalPoint,
    height_m: float,
    way: Sequence[PlanarPoint],
    speed_m_s: float,
    begins_m_s: float,
    stop: BrakingStop | None,
) -> Trajectory:
    """As `fly_along`, for one that stops on its way and keeps its height until then; None: it does not stop."""
    parts = None if stop is None else split_track([here[:2], *way], stop.in_m)
    if stop is None or parts is None:
        return fly_along(here, height_m, way, speed_m_s, begins_m_s)
    until, rest = parts
    if (brakes := split_track(until, stop.on_m)) is not None:
        until = [*brakes[0], *brakes[1][1:]]
    points, times_s, way_m = [here], [0.0], 0.0
    for a, b in pairwise(until[:-1]):
        way_m += math.dist(a, b)
        if times_s[-1] + APART_S < (at_s := stop.passed_s(way_m)) < stop.in_s - APART_S:
            points.append((*b, here[2]))
            times_s.append(at_s)
    on = fly_along((*rest[0], here[2]), height_m, rest[1:], speed_m_s, ANEW_M_S).later(stop.in_s)
    return Trajectory((*times_s, *on.times_s), (*points, *on.points))


def fly_along(
    here: LocalPoint, height_m: float, way: Sequence[PlanarPoint], speed_m_s: float, begins_m_s: float = 0.0
) -> Trajectory:
    """In flight: on from `here`, at `begins_m_s`, along a way, which it comes to at `height_m`, and down."""
    corners, passed_s = travel_time.timed([here[:2], *way], speed_m_s, begins_m_s=begins_m_s)
    if len(corners) > 1 and way[0] not in corners[:2] and way[0] != here[:2]:
        # Straight on, but it is level from there.
        share = min(math.dist(here[:2], way[0]) / math.dist(here[:2], corners[1]), 0.99)
        corners.insert(1, way[0])
        passed_s.insert(1, share * passed_s[1])
    points, times_s = [here], [0.0]
    # As steeply as it can, where that takes longer than the way.
    rate_m_s = CLIMB_M_S if height_m > here[2] else DESCENT_M_S
    late_s = max(abs(height_m - here[2]) / rate_m_s - passed_s[1], 0.0) if len(corners) > 1 else 0.0
    for corner, at_s in zip(corners[1:], passed_s[1:], strict=True):
        points.append((*corner, height_m))
        times_s.append(at_s + late_s)
    return land_from(points, times_s)


def land_from(points: Sequence[LocalPoint], times_s: Sequence[float]) -> Trajectory:
    """A flight that ends with a landing on the spot, from its last point."""
    points, times_s = [*points], [*times_s]
    east_m, north_m, up_m = points[-1]
    if up_m > LOW_M:
        points.append((east_m, north_m, LOW_M))
        times_s.append(times_s[-1] + (up_m - LOW_M) / DESCENT_M_S)
    # Who is down already is there for a moment yet.
    points.append((east_m, north_m, min(up_m, 0.0)))
    times_s.append(times_s[-1] + max(min(up_m, LOW_M), LOW_M / 100.0) / LAND_M_S)
    return Trajectory(tuple(times_s), tuple(points))
