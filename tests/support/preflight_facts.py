"""Facts of a vehicle that passes every preflight check."""

from __future__ import annotations

import math
from itertools import pairwise

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.config.specs import Spec
from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.procedures.fence import fence_items
from swarmctl.mavlink.telemetry.instruments import GpsFix, Instruments
from swarmctl.preflight.facts import Answers, OtherVehicle, PreflightFacts
from swarmctl.preflight.policy import RequiredParameter

FRAME = LocalFrame(46.0, 14.4)


def place(east_m: float, north_m: float) -> tuple[float, float]:
    return FRAME.to_geodetic(east_m, north_m)


def plan(*points_m: tuple[float, float], up_m: float = 40.0) -> FlightPlan:
    track = tuple(Waypoint(*place(*point), up_m) for point in points_m)
    return FlightPlan(up_m, track, track[-1])


def flight(*points_m: tuple[float, float]) -> Trajectory:
    """Return a trajectory at 10 m/s with a climb of 16 s to 40 m, the points, and a descent of 40 s."""
    times_s, points = [0.0, 16.0], [(*points_m[0], 0.0), (*points_m[0], 40.0)]
    for a, b in pairwise(points_m):
        times_s.append(times_s[-1] + math.dist(a, b) / 10.0)
        points.append((*b, 40.0))
    return Trajectory((*times_s, times_s[-1] + 40.0), (*points, (*points_m[-1], 0.0)))


SQUARE = tuple(
    place(*corner) for corner in ((-100.0, -100.0), (600.0, -100.0), (600.0, 600.0), (-100.0, 600.0))
)


START = place(-50.0, 0.0)


STATE = VehicleState(
    lat_deg=START[0],
    lon_deg=START[1],
    alt_rel_m=0.0,
    alt_amsl_m=300.0,
    ready=True,
    battery_percent=80,
    home_lat_deg=START[0],
    home_lon_deg=START[1],
)


FIX = GpsFix(3, 9, 1.2)


def _spec(sysid: int, altitude_m: float) -> Spec:
    return Spec(f"uav{sysid}", sysid, "", "direct", False, START, (0, 0), ((4, 3),), altitude_m, 0.0)


FIT = PreflightFacts(
    spec=_spec(1, 40.0),
    identity=Identity(1, 3, 2, "ArduPilot 4.6.2", b"\x01".ljust(18)),
    sysid_conflict="",
    no_route_because="",
    state=STATE,
    age_s=0.4,
    position_age_s=0.2,
    status_age_s=0.9,
    answers=Answers(
        Instruments(FIX, 1.8e9, 10.0, position_every_s=0.25),
        {"FENCE_ENABLE": 1.0},
        fence_items(SQUARE),
        "",
        0,
    ),
    clock_offset_s=0.3,
    clock_tolerance_s=2.0,
    required_parameters=(RequiredParameter("FENCE_ENABLE", "a fence", 1.0, (1.0,)),),
    no_table_because="",
    fly_sets={},
    may_set_parameters=False,
    fence=SQUARE,
    ceiling_m=90.0,
    plan=plan((0.0, 0.0), (400.0, 300.0)),
    trajectory=flight((-50.0, 0.0), (0.0, 0.0), (400.0, 300.0)),
    limits=Limits(10.0, 3.0),
    endurance_s=900.0,
    reserve_percent=20.0,
    frame=FRAME,
    others=(
        OtherVehicle(
            _spec(2, 45.0),
            Identity(2, 3, 2, "", b"\x02".ljust(18)),
            flight((-50.0, 0.0), (0.0, 0.0), (400.0, 300.0)),
        ),
    ),
)
