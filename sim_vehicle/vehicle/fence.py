"""The stored geofence: inclusion and exclusion polygons and circles, and the distance to their edges.

Distances are computed in metres around the checked position, so no map projection is needed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import Floats, metres_per_degree
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.numbers import to_int

POLYGONS = frozenset(
    {
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    }
)
CIRCLES = frozenset({mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION})
_INCLUSIONS = frozenset(
    {mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION}
)


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon with vertices `points_deg`, or a circle with one centre; points are (latitude, longitude)."""

    inclusion: bool
    points_deg: tuple[tuple[float, float], ...]
    radius_m: float | None = None


def zones_of(items: Sequence[Item]) -> list[Zone]:
    """Return the zones in a list of fence items.

    The first vertex of a polygon gives the number of vertices. Return points and polygons with too few
    vertices are left out.
    """
    zones, index = [], 0
    while index < len(items):
        item = items[index]
        inclusion = item.command in _INCLUSIONS
        vertices = max(to_int(item.param1), 1) if item.command in POLYGONS else 1
        places = tuple((point.x * 1e-7, point.y * 1e-7) for point in items[index : index + vertices])
        if item.command in CIRCLES:
            zones.append(Zone(inclusion, places, item.param1))
        elif item.command in POLYGONS and len(places) == vertices >= 3:
            zones.append(Zone(inclusion, places))
        index += vertices
    return zones


class Fence:
    """The fence of one vehicle: `items` are stored for downloads, `zones` are enforced."""

    def __init__(self) -> None:
        self.items: tuple[Item, ...] = ()
        self.zones: tuple[Zone, ...] = ()
        self._checked = (0.0, 0.0, 0.0, 0.0, 0.0)
        """last checked position [deg], scale there [m/deg], and distance that stays free of breaches [m]"""
        self._compile()

    def replace(self, items: Sequence[Item]) -> None:
        """Store a new fence without any check."""
        self.items = tuple(items)
        self.zones = tuple(zones_of(items))
        self._compile()

    def discard_violated(self, lat_deg: float, lon_deg: float) -> int:
        """Stop enforcing the zones that a position violates; return the number of these zones."""
        north_m, east_m = metres_per_degree(lat_deg)
        margins_m = self._margins_m(lat_deg, lon_deg, north_m, east_m)
        enforced = tuple(zone for zone, margin in zip(self.zones, margins_m, strict=True) if margin >= 0)
        discarded = len(self.zones) - len(enforced)
        self.zones = enforced
        self._compile()
        return discarded

    @property
    def total(self) -> int:
        """FENCE_TOTAL of ArduPilot: number of vertices and circles plus 2; 0 below 3 vertices and circles."""
        points = sum(item.command in POLYGONS or item.command in CIRCLES for item in self.items)
        return points + 2 if points >= 3 else 0

    @property
    def return_point_deg(self) -> tuple[float, float] | None:
        """The return point, else the centre of the first inclusion polygon's bounding box; None: neither."""
        for item in self.items:
            if item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
                return item.x * 1e-7, item.y * 1e-7
        for zone in self.zones:
            if zone.inclusion and zone.radius_m is None:
                first = np.array(zone.points_deg[0])
                offsets = _wrapped(np.array(zone.points_deg) - first)
                lat_deg, lon_deg = first + (offsets.min(axis=0) + offsets.max(axis=0)) / 2
                return float(lat_deg), (float(lon_deg) + 180.0) % 360.0 - 180.0
        return None

    def breaches(self, lat_deg: float, lon_deg: float) -> bool:
        """Return True for a position outside an inclusion zone or inside an exclusion zone."""
        if not self.zones:
            return False
        lat_checked_deg, lon_checked_deg, north_m, east_m, free_m = self._checked
        moved_m = math.hypot((lat_deg - lat_checked_deg) * north_m, (lon_deg - lon_checked_deg) * east_m)
        if moved_m < free_m:
            return False
        margin_m = self.margin_m(lat_deg, lon_deg)
        # The margin shrinks by at most the distance moved; half leaves room for the scale's change.
        self._checked = (lat_deg, lon_deg, *metres_per_degree(lat_deg), 0.5 * margin_m)
        return margin_m < 0

    def margin_m(self, lat_deg: float, lon_deg: float) -> float:
        """Return the smallest distance to a zone's edge [m], negative on the forbidden side; inf: no zone."""
        if not self.zones:
            return float("inf")
        return float(self._margins_m(lat_deg, lon_deg, *metres_per_degree(lat_deg)).min())

    def _compile(self) -> None:
        """Build arrays of all polygon edges, one polygon after the other, and of the circles."""
        self._checked = (0.0, 0.0, 0.0, 0.0, 0.0)
        polygons = [zone for zone in self.zones if zone.radius_m is None]
        sizes = [len(zone.points_deg) for zone in polygons]
        starts = np.cumsum([0, *sizes])[:-1]
        points = [point for zone in polygons for point in zone.points_deg]
        self._points_deg = np.array(points, dtype=float).reshape(-1, 2)
        next_vertex = np.arange(1, len(points) + 1)
        next_vertex[starts + np.array(sizes, dtype=int) - 1] = starts
        self._next_vertex = next_vertex
        self._starts: npt.NDArray[np.int64] = starts
        circles = [zone for zone in self.zones if zone.radius_m is not None]
        self._centres_deg = np.array([zone.points_deg[0] for zone in circles], dtype=float).reshape(-1, 2)
        self._radii_m = np.array([zone.radius_m for zone in circles], dtype=float)
        is_circle = np.array([zone.radius_m is not None for zone in self.zones], dtype=bool)
        self._zone_order = np.argsort(np.argsort(is_circle, kind="stable"), kind="stable")
        self._zone_signs = np.where([zone.inclusion for zone in self.zones], 1.0, -1.0)

    def _margins_m(self, lat_deg: float, lon_deg: float, north_m: float, east_m: float) -> Floats:
        """Return the distance of a position to each zone's edge [m], positive on the permitted side."""
        place = np.array([lat_deg, lon_deg])
        scale = np.array([north_m, east_m])
        depths_m = []
        if len(self._starts):
            offsets_m = _wrapped(self._points_deg - place) * scale
            depths_m.append(_depths_in_polygons_m(offsets_m, self._next_vertex, self._starts))
        if len(self._radii_m):
            offsets_m = _wrapped(self._centres_deg - place) * scale
            depths_m.append(self._radii_m - np.hypot(offsets_m[:, 0], offsets_m[:, 1]))
        if not depths_m:
            return np.empty(0)
        margins_m: Floats = np.concatenate(depths_m)[self._zone_order] * self._zone_signs
        return margins_m


def _wrapped(offsets_deg: Floats) -> Floats:
    """Wrap longitude differences (second column) into -180 to 180 degrees."""
    offsets_deg[:, 1] = (offsets_deg[:, 1] + 180.0) % 360.0 - 180.0
    return offsets_deg


def _depths_in_polygons_m(
    points_m: Floats, next_vertex: npt.NDArray[np.int64], starts: npt.NDArray[np.int64]
) -> Floats:
    """Return the depth of the origin inside each polygon [m], negative outside; points (n, 2)."""
    north_m, east_m = points_m[:, 0], points_m[:, 1]
    edge_north_m, edge_east_m = north_m[next_vertex] - north_m, east_m[next_vertex] - east_m
    # From inside, a ray to the east crosses the edges of a polygon an odd number of times.
    straddles = (north_m > 0) != (north_m[next_vertex] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing_m = east_m - north_m * edge_east_m / edge_north_m
    crosses = straddles & (crossing_m > 0)
    inside = np.add.reduceat(crosses, starts, dtype=np.int64) % 2 == 1
    length_squared = np.maximum(edge_north_m**2 + edge_east_m**2, 1e-12)
    along = np.clip(-(north_m * edge_north_m + east_m * edge_east_m) / length_squared, 0.0, 1.0)
    distance_m = np.hypot(north_m + along * edge_north_m, east_m + along * edge_east_m)
    nearest_m = np.minimum.reduceat(distance_m, starts)
    depths_m: Floats = np.where(inside, nearest_m, -nearest_m)
    return depths_m
