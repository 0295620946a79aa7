"""Plans by metres from home, and how a simulated vehicle flies them."""

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
    """By (east, north) of home [m]; it lands at the last."""
    track = tuple(Waypoint(*FRAME.to_geodetic(*point), ALT_M) for point in points)
    return FlightPlan(ALT_M, track, track[-1], leaves_ahead=leaves_ahead)


def place(bench: FlyingBench) -> PlanarPoint:
    return FRAME.to_local(*bench.vehicle.body.lat_lon_deg)


def most_back_m(norths_m: Sequence[float]) -> float:
    """By how much one that is to fly north came back at most, by where it was one moment after the other."""
    return max(most - now for most, now in zip(accumulate(norths_m, max), norths_m, strict=True))
