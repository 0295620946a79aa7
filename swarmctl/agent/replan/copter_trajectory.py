"""The predicted trajectory of a copter's flight plan; `wing_trajectory` is for fixed wings. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from swarmctl.agent.replan import travel_time, wing_trajectory
from swarmctl.agent.replan.length_bounds import CLIMB_M_S, LIFT_S
from swarmctl.agent.replan.stopping import RESTART_M_S, BrakingStop, split_track
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint

DESCENT_M_S = 1.5
"""descent rate down to LOW_M [m/s]: the default of ArduCopter's WPNAV_SPEED_DN"""
LAND_M_S = 0.5
"""descent rate below LOW_M [m/s]: the default of LAND_SPEED"""
LEVEL_S = 0.4
"""duration of a climb or descent below which the flight counts as level [s]"""
SAME_TIME_S = 1e-3
"""difference in time below which two points of a flight count as the same point [s]"""
LOW_M = 10.0
"""height above home at which the descent slows down [m]: the default of LAND_ALT_LOW"""


def from_takeoff(task: Task, plan: FlightPlan, start: LatLon) -> Trajectory:
    """Return the trajectory of a whole flight from arming at `start`, with heights above home [m].

    A copter climbs vertically, flies to its waypoints, and descends vertically at its landing spot.
    """
    if task.wings is not None:
        return wing_trajectory.from_takeoff(task, plan, start)
    here = (*task.grid.frame.to_local(*start), 0.0)
    return climb_then_fly(here, plan.height_m, waypoints_of(task, plan), task.arrival.speed_m_s, LIFT_S)


def at_height(plan: FlightPlan, height_m: float) -> FlightPlan:
    """Return the plan with the same ground track, `height_m` above home."""
    return replace(
        plan,
        takeoff_alt_m=height_m if plan.approach is None else plan.takeoff_alt_m,
        track=tuple(replace(point, alt_rel_m=height_m) for point in plan.track),
        landing=replace(plan.landing, alt_rel_m=height_m),
    )


def with_level_off(task: Task, plan: FlightPlan, here: LocalPoint, after_s: float) -> FlightPlan:
    """Return the plan with one more waypoint, at the point where the vehicle can reach the plan's height.

    The climb or descent begins in `after_s` [s]. Vehicles climb evenly between waypoints, so a plan without
    this waypoint reaches its height only at its first waypoint. A plan whose first waypoint is near, or whose
    height hardly differs, stays unchanged.
    """
    height_m, first = plan.height_m, waypoints_of(task, plan)[0]
    rate_m_s = CLIMB_M_S if height_m > here[2] else DESCENT_M_S
    takes_s = abs(height_m - here[2]) / rate_m_s
    level_m, away_m = task.arrival.speed_m_s * (after_s + takes_s), math.dist(here[:2], first)
    if takes_s < LEVEL_S or away_m < 2.0 * level_m:
        return plan
    east_m, north_m = (a + level_m / away_m * (b - a) for a, b in zip(here[:2], first, strict=True))
    level = Waypoint(*task.grid.frame.to_geodetic(east_m, north_m), height_m)
    return replace(plan, track=(level, *plan.track))


def waypoints_of(task: Task, plan: FlightPlan) -> list[PlanarPoint]:
    """Return the waypoints and the landing spot of a plan, (east, north) [m]."""
    frame = task.grid.frame
    return [frame.to_local(point.lat_deg, point.lon_deg) for point in (*plan.track, plan.landing)]


def climb_then_fly(
    here: LocalPoint, height_m: float, path: Sequence[PlanarPoint], speed_m_s: float, lift_s: float = 0.0
) -> Trajectory:
    """Return the trajectory of a vertical climb after `lift_s` [s], a flight along `path`, and a landing."""
    up_s = lift_s + max(height_m - here[2], 0.0) / CLIMB_M_S
    there = (here[0], here[1], height_m)
    if up_s == 0.0:
        return fly_along(there, height_m, path, speed_m_s)
    flight = fly_along(there, height_m, path, speed_m_s).later(up_s)
    return Trajectory((0.0, *flight.times_s), (here, *flight.points))


def fly_with_stop(
    here: LocalPoint,
    height_m: float,
    path: Sequence[PlanarPoint],
    speed_m_s: float,
    initial_m_s: float,
    stop: BrakingStop | None,
    present_height_m: float,
    begins_in_s: float = 0.0,
) -> Trajectory:
    """Return the trajectory of `fly_along` with a stop; until the stop the copter flies by its present plan.

    So until then it climbs or descends to the height of this plan, `present_height_m`. Without a stop it does
    so for `begins_in_s`. If the stop is beyond the path, the result is that of `fly_along`.
    """
    if stop is None:
        flight = fly_along(here, height_m, path, speed_m_s, initial_m_s)
        return _at_first(flight, begins_in_s, present_height_m)
    parts = split_track([here[:2], *path], stop.stops_in_m)
    if parts is None:
        return fly_along(here, height_m, path, speed_m_s, initial_m_s)
    until, rest = parts
    if (brakes := split_track(until, stop.brakes_in_m)) is not None:
        until = [*brakes[0], *brakes[1][1:]]
    points, times_s, flown_m = [here], [0.0], 0.0
    for a, b in pairwise(until[:-1]):
        flown_m += math.dist(a, b)
        if times_s[-1] + SAME_TIME_S < (at_s := stop.time_at(flown_m)) < stop.stops_in_s - SAME_TIME_S:
            points.append((*b, _height_after(at_s, here[2], present_height_m)))
            times_s.append(at_s)
    stops_at = (*rest[0], _height_after(stop.stops_in_s, here[2], present_height_m))
    after = fly_along(stops_at, height_m, rest[1:], speed_m_s, RESTART_M_S).later(stop.stops_in_s)
    return Trajectory((*times_s, *after.times_s), (*points, *after.points))


def _at_first(flight: Trajectory, until_s: float, to_m: float) -> Trajectory:
    """Return a flight that climbs or descends toward `to_m` until `until_s`, and then goes on as before."""
    at = flight.at(until_s)
    if at is None or until_s <= SAME_TIME_S:
        return flight
    n_before = bisect_left(flight.times_s, until_s - SAME_TIME_S)
    n = bisect_right(flight.times_s, until_s + SAME_TIME_S)
    times_s = (*flight.times_s[:n_before], until_s)
    passed, up_m = (*flight.points[:n_before], at), flight.points[0][2]
    points = [(*p[:2], _height_after(t, up_m, to_m)) for t, p in zip(times_s, passed, strict=True)]
    return Trajectory((*times_s, *flight.times_s[n:]), (*points, *flight.points[n:]))


def _height_after(seconds: float, from_m: float, to_m: float) -> float:
    """Return the height of a climb or descent after some seconds [m]."""
    return min(max(to_m, from_m - DESCENT_M_S * seconds), from_m + CLIMB_M_S * seconds)


def fly_along(
    here: LocalPoint, height_m: float, path: Sequence[PlanarPoint], speed_m_s: float, initial_m_s: float = 0.0
) -> Trajectory:
    """Return the trajectory along `path` at `height_m` to the landing, from `here` at speed `initial_m_s`."""
    corners, passed_s = travel_time.corner_times([here[:2], *path], speed_m_s, initial_m_s=initial_m_s)
    if len(corners) > 1 and path[0] not in corners[:2] and path[0] != here[:2]:
        # The first point of the path is no corner, but the flight is level from this point on.
        share = min(math.dist(here[:2], path[0]) / math.dist(here[:2], corners[1]), 0.99)
        corners.insert(1, path[0])
        passed_s.insert(1, share * passed_s[1])
    points, times_s = [here], [0.0]
    # A climb that takes longer than the first leg delays all later points.
    rate_m_s = CLIMB_M_S if height_m > here[2] else DESCENT_M_S
    late_s = max(abs(height_m - here[2]) / rate_m_s - passed_s[1], 0.0) if len(corners) > 1 else 0.0
    for corner, at_s in zip(corners[1:], passed_s[1:], strict=True):
        points.append((*corner, height_m))
        times_s.append(at_s + late_s)
    return land_from(points, times_s)


def land_from(points: Sequence[LocalPoint], times_s: Sequence[float]) -> Trajectory:
    """Return the trajectory through these points, with a vertical landing from the last point."""
    points, times_s = [*points], [*times_s]
    east_m, north_m, up_m = points[-1]
    if up_m > LOW_M:
        points.append((east_m, north_m, LOW_M))
        times_s.append(times_s[-1] + (up_m - LOW_M) / DESCENT_M_S)
    # A vehicle on the ground keeps its place for a moment, so that the trajectory has a duration.
    points.append((east_m, north_m, min(up_m, 0.0)))
    times_s.append(times_s[-1] + max(min(up_m, LOW_M), LOW_M / 100.0) / LAND_M_S)
    return Trajectory(tuple(times_s), tuple(points))
