"""The fence that a configuration asks for. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmctl.core.geo import LatLon
from swarmctl.core.plane import around, box
from swarmctl.mavlink.fence import MAX_VERTICES

if TYPE_CHECKING:
    # A scenario's tasks know their fence.
    from swarmctl.scenario import Scenario


def polygon_of(scenario: Scenario) -> tuple[LatLon, ...]:
    """Its corners [deg], in order: those given, or the area with every start of the swarm and a margin."""
    fence, frame = scenario.config.preflight.fence, scenario.grid.frame
    if fence.polygon is not None:
        return tuple((corner.lat_deg, corner.lon_deg) for corner in fence.polygon)
    inside = [*scenario.grid.corners(), *(spec.start for spec in scenario.swarm)]
    hull = around([frame.to_local(*place) for place in inside], fence.margin_m)
    if len(hull) > MAX_VERTICES:
        hull = box(hull)
    return tuple(frame.to_geodetic(*point) for point in hull)


def ceiling_m(scenario: Scenario) -> float:
    """How high a vehicle may fly, above home [m]."""
    fence = scenario.config.preflight.fence
    if fence.max_altitude_m is not None:
        return fence.max_altitude_m
    return max(spec.altitude_m for spec in scenario.swarm) + fence.margin_m
