"""From a plan to where its vehicle is at what time: the trajectory by which vehicles are kept apart. Pure."""

from __future__ import annotations

from swarmctl.agent import pace
from swarmctl.agent.bounds import CLIMB_M_S, LIFT_S
from swarmctl.agent.state import Task
from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan
from swarmctl.separation import Point, Trajectory

DESCENT_M_S = 1.5
"""at which a landing begins: ArduCopter's WPNAV_SPEED_DN as it comes"""
LAND_M_S = 0.5
"""and goes on from LOW_M above home: LAND_SPEED"""
LOW_M = 10.0
"""LAND_ALT_LOW"""


def from_takeoff(task: Task, plan: FlightPlan, start: LatLon) -> Trajectory:
    """A whole flight, from when it is armed at `start` to its touch-down; up is above home [m].

    It climbs on the spot, flies to its first waypoint as to every other, and comes down at its landing spot.
    """
    frame, height_m = task.grid.frame, plan.takeoff_alt_m
    east_m, north_m = frame.to_local(*start)
    up_s = LIFT_S + height_m / CLIMB_M_S
    points: list[Point] = [(east_m, north_m, 0.0), (east_m, north_m, height_m)]
    times_s = [0.0, up_s]
    track = [(east_m, north_m), *(frame.to_local(p.lat_deg, p.lon_deg) for p in (*plan.track, plan.landing))]
    corners, passed_s = pace.timed(track, task.arrival.speed_m_s)
    points += [(*corner, height_m) for corner in corners[1:]]
    times_s += [up_s + after_s for after_s in passed_s[1:]]
    low_m = min(LOW_M, height_m)
    if height_m > low_m:
        points.append((*corners[-1], low_m))
        times_s.append(times_s[-1] + (height_m - low_m) / DESCENT_M_S)
    points.append((*corners[-1], 0.0))
    times_s.append(times_s[-1] + low_m / LAND_M_S)
    return Trajectory(tuple(times_s), tuple(points))
