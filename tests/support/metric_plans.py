"""Plans in metres from home, and measures of their flights."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

from flying_bench import HOME, FlyingBench

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint

FRAME = LocalFrame(*HOME)
ALT_M = 20.0


def plan(*points: PlanarPoint, leaves_ahead: bool = False) -> FlightPlan:
    """Return a plan over points (east, north) of home [m], with a landing at the last."""
    track = tuple(Waypoint(*FRAME.to_geodetic(*point), ALT_M) for point in points)
    return FlightPlan(ALT_M, track, track[-1], leaves_ahead=leaves_ahead)


def place(bench: FlyingBench) -> PlanarPoint:
    return FRAME.to_local(*bench.vehicle.body.lat_lon_deg)


def most_backwards_m(along_m: Sequence[float]) -> float:
    """Return the greatest way back [m] in successive coordinates of a vehicle along its way."""
    return max((most - now for most, now in zip(accumulate(along_m, max), along_m, strict=True)), default=0.0)
