"""The predicted trajectory of a copter's flight plan; `wing_trajectory` is for fixed wings. Pure."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence

import msgspec

from swarmctl.agent.replan import travel_time, wing_trajectory
from swarmctl.agent.replan.climb import DESCENT_M_S, LIFT_S, climb_s
from swarmctl.agent.replan.stopping import CORNER_M, STOPPED_M_S, MissionChange, split_track
from swarmctl.agent.state import Task
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory, brake
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace

LAND_M_S = 0.5
"""descent rate below LOW_M [m/s]: the default of LAND_SPEED"""
RAMPS_S = 20.0
"""time for which a flight shows where it speeds up and brakes; farther ahead only its corners [s]"""
REACHED_M = 3.0
"""distance from its next waypoint at which a stopped vehicle flies on from there, and not back [m]"""
LEVEL_S = 2.0
"""duration of a climb or descent below which the flight counts as level [s]"""
SAME_TIME_S = 1e-3
"""difference in time below which two points of a flight count as the same point [s]"""
LOW_M = 10.0
"""height above home at which the descent slows down [m]: the default of LAND_ALT_LOW"""


def from_takeoff(task: Task, plan: FlightPlan, start: LatLon, start_delay_s: float) -> Trajectory:
    """Return the trajectory of a whole flight from arming at `start`, with heights above home [m].

    A copter climbs vertically, flies to its waypoints, and descends vertically at its landing spot.
    `start_delay_s` is the delay of its starts from a stand.
    """
    if task.wings is not None:
        return wing_trajectory.from_takeoff(task, plan, start)
    here = (*task.grid.frame.to_local(*start), 0.0)
    path, speed_m_s = waypoints_of(task, plan), task.speed_m_s
    return climb_then_fly(here, plan.height_m, path, speed_m_s, LIFT_S, start_delay_s=start_delay_s)


def at_height(plan: FlightPlan, height_m: float) -> FlightPlan:
    """Return the plan with the same ground track, `height_m` above home."""
    return replace(
        plan,
        takeoff_alt_m=height_m if plan.approach is None else plan.takeoff_alt_m,
        track=tuple(replace(point, alt_rel_m=height_m) for point in plan.track),
        landing=replace(plan.landing, alt_rel_m=height_m),
    )


def with_level_off(
    task: Task, plan: FlightPlan, here: LocalPoint, after_s: float | None = None
) -> FlightPlan:
    """Return the plan with one more waypoint, at the point where the vehicle can reach the plan's height.

    The climb or descent begins in `after_s` [s]; None: from a stand, on the spot. Vehicles climb evenly
    between waypoints, so a plan without this waypoint reaches its height only at its first waypoint. A plan
    whose first waypoint is nearer than this point, or whose height hardly differs, stays unchanged.
    """
    height_m, first = plan.height_m, waypoints_of(task, plan)[0]
    takes_s = climb_s(height_m - here[2])
    level_m = 0.0 if after_s is None else task.speed_m_s * (after_s + takes_s)
    away_m = math.dist(here[:2], first)
    if takes_s < LEVEL_S or away_m <= 1.25 * level_m:
        return plan
    east_m, north_m = (a + level_m / away_m * (b - a) for a, b in zip(here[:2], first, strict=True))
    level = Waypoint(*task.grid.frame.to_geodetic(east_m, north_m), height_m)
    return replace(plan, track=(level, *plan.track))


def waypoints_of(task: Task, plan: FlightPlan) -> list[PlanarPoint]:
    """Return the waypoints and the landing spot of a plan, (east, north) [m]."""
    frame = task.grid.frame
    return [frame.to_local(point.lat_deg, point.lon_deg) for point in (*plan.track, plan.landing)]


def climb_then_fly(
    here: LocalPoint,
    height_m: float,
    path: Sequence[PlanarPoint],
    speed_m_s: float,
    lift_s: float = 0.0,
    *,
    start_delay_s: float,
) -> Trajectory:
    """Return the trajectory of a vertical climb after `lift_s` [s], a flight along `path`, and a landing."""
    up_s = lift_s + climb_s(max(height_m - here[2], 0.0))
    there = (here[0], here[1], height_m)
    flight = fly_along(there, height_m, path, speed_m_s, start_delay_s=start_delay_s)
    return flight if up_s == 0.0 else flight.after(here, up_s)


class FlightPart(msgspec.Struct, frozen=True):
    """A flight at one height."""

    height_m: float
    """above home [m]"""
    path: Sequence[PlanarPoint]
    """points ahead of the vehicle, and the landing spot, (east, north) [m]"""


def fly_through_change(
    here: LocalPoint,
    velocity_m_s: PlanarPoint,
    present: FlightPart,
    change: MissionChange,
    new: FlightPart,
    speed_m_s: float,
    *,
    start_delay_s: float,
    leaves_ahead: bool = False,
) -> Trajectory:
    """Return the trajectory by the present plan until a mission change, then by the new plan to its landing.

    here: east, north, height above home [m]; velocity_m_s: east, north; speed_m_s: speed of the plans

    A vehicle that brakes for the change stops straight ahead at its present height, and then flies to the
    first point of the new path, even back to it. If the new plan first follows the present plan
    (`leaves_ahead`), the vehicle does not fly to the points that it has passed before the change. If the
    present path ends before the change, the vehicle lands there.
    """
    initial_m_s, path, in_s = math.hypot(*velocity_m_s), new.path, change.in_s
    track = travel_time.timed_track(
        [here[:2], *present.path],
        speed_m_s,
        initial_m_s=initial_m_s,
        start_delay_s=start_delay_s,
        ramps_s=max(RAMPS_S, in_s),
    )
    flight = _fly_on(track, here, present.height_m, present.path)
    changes_at = flight.at(in_s)
    if changes_at is None or (present.path and in_s >= track.times_s[-1]):
        return flight
    flown_m, changes_m_s = track.after(in_s) if in_s > SAME_TIME_S else (0.0, initial_m_s)
    if leaves_ahead:
        parts = split_track([here[:2], *path], flown_m)
        path = path[-1:] if parts is None else parts[1][1:]
    n = bisect_left(flight.times_s, in_s - SAME_TIME_S) or 1
    points, times_s = [*flight.points[:n]], [*flight.times_s[:n]]
    before = points[-1]
    along = (
        velocity_m_s
        if n == 1 and flown_m <= CORNER_M
        else (changes_at[0] - before[0], changes_at[1] - before[1])
    )
    if change.brakes_m_s2 and changes_m_s > STOPPED_M_S and (away_m := math.hypot(*along)) > 0.0:
        if in_s > times_s[-1] + SAME_TIME_S:
            points.append(changes_at)
            times_s.append(in_s)
        velocity_m_s = (changes_m_s / away_m * along[0], changes_m_s / away_m * along[1])
        stop = brake(changes_at, (*velocity_m_s, 0.0), in_s, brakes_m_s2=change.brakes_m_s2)
        points += stop.points[1:]
        times_s += stop.times_s[1:]
        changes_at, in_s, changes_m_s = stop.points[-1], stop.times_s[-1], 0.0
        # A vehicle at a waypoint, but not at its height, climbs or descends there.
        if len(path) > 1 and math.dist(changes_at, (*path[0], new.height_m)) <= REACHED_M:
            path = path[1:]
    after = fly_along(
        changes_at, new.height_m, path, speed_m_s, changes_m_s, start_delay_s=start_delay_s
    ).later(in_s)
    n = bisect_left(times_s, in_s - SAME_TIME_S)
    return Trajectory((*times_s[:n], *after.times_s), (*points[:n], *after.points)).checked()


def fly_along(
    here: LocalPoint,
    height_m: float,
    path: Sequence[PlanarPoint],
    speed_m_s: float,
    initial_m_s: float = 0.0,
    *,
    start_delay_s: float,
) -> Trajectory:
    """Return the trajectory along `path` at `height_m` to the landing, from `here` at speed `initial_m_s`."""
    track = travel_time.timed_track(
        [here[:2], *path],
        speed_m_s,
        initial_m_s=initial_m_s,
        start_delay_s=start_delay_s,
        ramps_s=RAMPS_S,
    )
    return _fly_on(track, here, height_m, path)


def _fly_on(
    track: travel_time.TimedTrack, here: LocalPoint, height_m: float, path: Sequence[PlanarPoint]
) -> Trajectory:
    """Return the trajectory on a track from `here` along `path`, at `height_m` to the landing."""
    # The vehicle climbs evenly to the first point of its path. A longer climb delays all later points.
    level_m = min(math.dist(here[:2], path[0]) if path else 0.0, track.at_m[-1])
    if level_m <= CORNER_M:
        level_m = 0.0  # on the spot, before it starts
    level, level_s = track.at(level_m)
    late_s = max(climb_s(height_m - here[2]) - level_s, 0.0)
    n = bisect_left(track.at_m, level_m - CORNER_M) or 1
    points, times_s = [here], [0.0]
    for point, at_m, at_s in zip(track.points[1:n], track.at_m[1:n], track.times_s[1:n], strict=True):
        points.append((*point, here[2] + at_m / level_m * (height_m - here[2])))
        times_s.append(at_s * (1.0 + late_s / level_s))
    is_own_point = n < len(track.at_m) and (level_m == 0.0 or track.at_m[n] > level_m + CORNER_M)
    if is_own_point and height_m != here[2]:
        points.append((*level, height_m))
        times_s.append(level_s + late_s)
    for point, at_s in zip(track.points[n:], track.times_s[n:], strict=True):
        points.append((*point, height_m))
        times_s.append(at_s + late_s)
    return land_from(points, times_s)


def land_from(points: Sequence[LocalPoint], times_s: Sequence[float]) -> Trajectory:
    """Return the trajectory through these points, with a vertical landing from the last point."""
    points, times_s = [*points], [*times_s]
    east_m, north_m, up_m = points[-1]
    descends_s = (up_m - LOW_M) / DESCENT_M_S
    if descends_s > SAME_TIME_S:
        points.append((east_m, north_m, LOW_M))
        times_s.append(times_s[-1] + descends_s)
    # A vehicle on the ground keeps its place for a moment, so that the trajectory has a duration.
    points.append((east_m, north_m, min(up_m, 0.0)))
    times_s.append(times_s[-1] + max(min(up_m, LOW_M), LOW_M / 100.0) / LAND_M_S)
    return Trajectory(tuple(times_s), tuple(points)).checked()
