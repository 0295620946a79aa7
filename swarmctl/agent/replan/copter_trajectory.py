"""The predicted trajectory of a copter's flight plan; `wing_trajectory` is for fixed wings. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from swarmctl.agent.replan import travel_time, wing_trajectory
from swarmctl.agent.replan.length_bounds import CLIMB_M_S, LIFT_S
from swarmctl.agent.replan.stopping import RESTART_M_S, MissionChange, split_track
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


def fly_through_change(
    here: LocalPoint,
    velocity_m_s: PlanarPoint,
    present_height_m: float,
    present_path: Sequence[PlanarPoint],
    change: MissionChange,
    height_m: float,
    path: Sequence[PlanarPoint],
    speed_m_s: float,
) -> Trajectory:
    """Return the trajectory by the present plan until a mission change, then along `path` at `height_m`.

    A vehicle that brakes for the change stops straight ahead at its present height, and then flies to the
    first point of `path`, even back to it. If the present path ends before the change, the vehicle lands.
    """
    parts = ([here[:2]], ()) if change.in_m <= 0.0 else split_track([here[:2], *present_path], change.in_m)
    if parts is None:
        return fly_along(here, present_height_m, present_path, speed_m_s, change.speed_m_s)
    flown, points, times_s, flown_m = parts[0], [here], [0.0], 0.0
    for a, b in pairwise(flown):
        flown_m += math.dist(a, b)
        if times_s[-1] + SAME_TIME_S < (at_s := change.in_s * flown_m / change.in_m):
            points.append((*b, _height_after(at_s, here[2], present_height_m)))
            times_s.append(at_s)
    end, before, initial_m_s = flown[-1], flown[-2:-1], change.speed_m_s
    if change.brakes_m_s2:
        along = tuple(b - a for a, b in zip(before[0], end, strict=True)) if before else velocity_m_s
        share = change.stopping_m / (math.hypot(*along) or 1.0)
        end, initial_m_s = (end[0] + share * along[0], end[1] + share * along[1]), RESTART_M_S
    ends_at = (*end, _height_after(change.in_s, here[2], present_height_m))
    after = fly_along(ends_at, height_m, path, speed_m_s, initial_m_s).later(change.stops_in_s)
    n = bisect_left(times_s, change.stops_in_s - SAME_TIME_S)
    return Trajectory((*times_s[:n], *after.times_s), (*points[:n], *after.points))


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
