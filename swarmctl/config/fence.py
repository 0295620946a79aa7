"""The fence of a configuration: its polygon and its ceiling. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from swarmctl.config.model import Config
from swarmctl.config.specs import Spec, wings_of
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Grid
from swarmctl.core.planar import bounding_box, padded_hull
from swarmctl.mavlink.procedures.fence import MAX_VERTICES


def polygon_of(config: Config, grid: Grid, swarm: Sequence[Spec]) -> tuple[LatLon, ...]:
    """Return the fence's corners [deg], in order.

    By default the fence surrounds the area, all starts, and the room for landings of fixed wings at starts
    and goals, with a margin.
    """
    fence, frame = config.preflight.fence, grid.frame
    if fence.polygon is not None:
        return tuple((corner.lat_deg, corner.lon_deg) for corner in fence.polygon)
    inside = [*grid.corners(), *(spec.start for spec in swarm)]
    points = [*(frame.to_local(*place) for place in inside), *_landing_room(config, grid, swarm)]
    hull = padded_hull(points, fence.margin_m)
    if len(hull) > MAX_VERTICES:
        hull = bounding_box(hull)
    return tuple(frame.to_geodetic(*point) for point in hull)


def _landing_room(config: Config, grid: Grid, swarm: Sequence[Spec]) -> list[tuple[float, float]]:
    """Return corners of the room that fixed wings need at their starts and goals (east, north) [m]."""
    room = []
    for spec in swarm:
        wings = wings_of(config, spec)
        if wings is None:
            continue
        centres = [grid.frame.to_local(*spec.start), *(grid.centre_m(goal) for goal in spec.goals)]
        sides_m = (-wings.reach_m, wings.reach_m)
        room += [(e + de, n + dn) for e, n in centres for de in sides_m for dn in sides_m]
    return room


def ceiling_m(config: Config, swarm: Sequence[Spec]) -> float:
    """Return the greatest allowed height above home [m]."""
    fence = config.preflight.fence
    if fence.max_altitude_m is not None:
        return fence.max_altitude_m
    return max(spec.altitude_m for spec in swarm) + fence.margin_m
