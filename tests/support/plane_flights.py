"""Flights of simulated fixed wings along a plan."""

from __future__ import annotations

import math

from flying_bench import HOME, FlyingBench

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, Waypoint

FRAME = LocalFrame(*HOME)
RADIUS_M, ALT_M, LOW_M = 60.0, 40.0, 20.0
GOAL, START = (400.0, 900.0), (0.0, 0.0)
SETUP = {
    "ardupilot": {
        "RTL_AUTOLAND": 1.0,
        "RTL_ALTITUDE": -1.0,
        "WP_LOITER_RAD": RADIUS_M,
        "LAND_DISARMDELAY": 5.0,
    },
    "px4": {
        "RTL_TYPE": 1.0,
        "RTL_RETURN_ALT": 30.0,
        "NAV_LOITER_RAD": RADIUS_M,
        "NAV_FW_ALT_RAD": 30.0,
        "FW_LND_ANG": 6.0,
    },
}
Point = tuple[float, float]


def at(east_m: float, north_m: float, up_m: float = ALT_M) -> Waypoint:
    return Waypoint(*FRAME.to_geodetic(east_m, north_m), up_m)


def landing_at(east_m: float, north_m: float) -> Approach:
    """Return a landing to the north, out of a circle to the east of the path."""
    return Approach(
        at(east_m + RADIUS_M, north_m - 250.0, LOW_M),
        RADIUS_M,
        at(east_m, north_m - 190.0, LOW_M),
        at(east_m, north_m, 0.0),
    )


def plan(*points: Point, to: Point = GOAL) -> FlightPlan:
    """Return a plan north over the points, with a landing at `to` and the home landing at the take-off."""
    track = tuple(at(*point) for point in (*points, to))
    return FlightPlan(LOW_M, track, at(*to), 40.0, approach=landing_at(*to), home_approach=landing_at(*START))


FIRST = plan((0.0, 300.0), (0.0, 600.0))
SECOND = plan((0.0, 300.0), (-200.0, 700.0))


def bench(personality: str, **params: float) -> FlyingBench:
    return FlyingBench(personality, "plane", params=SETUP[personality] | params)


def here(bench: FlyingBench) -> Point:
    state = bench.session.state
    assert state.lat_deg is not None
    assert state.lon_deg is not None
    return FRAME.to_local(state.lat_deg, state.lon_deg)


def away_m(bench: FlyingBench, point: Point) -> float:
    return math.dist(here(bench), point)


def nearest_m(bench: FlyingBench, point: Point, seconds: float) -> float:
    """Return the least distance to a point within a time."""
    found: list[float] = []

    def look() -> bool:
        found.append(away_m(bench, point))
        return False

    bench.run(seconds, look)
    return min(found)


def landed(bench: FlyingBench, limit_s: float = 400.0) -> bool:
    return bench.run(limit_s, lambda: not bench.session.state.armed)
