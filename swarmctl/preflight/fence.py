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
    """Its corners [deg], in order: those given, or the area with every start of the swarm and a margin;
    around the starts and goals of fixed wings it has room for their landings."""
    fence, frame = scenario.config.preflight.fence, scenario.grid.frame
    if fence.polygon is not None:
        return tuple((corner.lat_deg, corner.lon_deg) for corner in fence.polygon)
    inside = [*scenario.grid.corners(), *(spec.start for spec in scenario.swarm)]
    points = [*(frame.to_local(*place) for place in inside), *_landing_room(scenario)]
    hull = around(points, fence.margin_m)
    if len(hull) > MAX_VERTICES:
        hull = box(hull)
    return tuple(frame.to_geodetic(*point) for point in hull)


def _landing_room(scenario: Scenario) -> list[tuple[float, float]]:
    """Corners of what fixed wings need around their starts and goals (east, north) [m]."""
    grid = scenario.grid
    room = []
    for spec in scenario.swarm:
        wings = scenario.wings(spec)
        if wings is None:
            continue
        centres = [grid.frame.to_local(*spec.start), *(grid.centre_m(goal) for goal in spec.goals)]
        sides_m = (-wings.reach_m, wings.reach_m)
        room += [(e + de, n + dn) for e, n in centres for de in sides_m for dn in sides_m]
    return room


def ceiling_m(scenario: Scenario) -> float:
    """How high a vehicle may fly, above home [m]."""
    fence = scenario.config.preflight.fence
    if fence.max_altitude_m is not None:
        return fence.max_altitude_m
    return max(spec.altitude_m for spec in scenario.swarm) + fence.margin_m
