"""Route progress: position of a flying vehicle on a route, and the item ahead. No I/O.

A new route may begin with a part of the flown route. During the upload the vehicle flies on, and may pass
items of this part. So the swap finds the next item by the vehicle's position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise, takewhile

import msgspec

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import MissionItem
from swarmctl.core.planar import PlanarPoint, distance_to_leg, distance_to_track
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.dialects.plan import LAND

CORNER_MARGIN_S = 0.75
"""time before and after a corner in which no command is sent: its arrival could be on either side"""
MAX_CROSS_TRACK_M = 12.0
"""greatest distance from a route at which a vehicle counts as on that route"""
SAME_PLACE_M = 1.0
"""greatest distance from a route at which an item counts as on that route"""


class RoutePosition(msgspec.Struct, frozen=True):
    """Position of a vehicle on a route."""

    item: int
    """index of the next item"""
    cross_track_m: float
    """distance from the route"""
    corner_s: float
    """time to the next item, or since the previous item if shorter"""
    past_splice_m: float = -math.inf
    """distance past the splice point, where the new route leaves the flown route; negative before"""
    to_item_m: float = math.inf
    """distance along the route to the next item; negative past that item"""

    @property
    def is_late(self) -> bool:
        return self.past_splice_m > 0.0 or self.cross_track_m > MAX_CROSS_TRACK_M


class RouteProgress:
    """A route from the vehicle's position at `begin` over `items`, up to the landing.

    A plan that was appended too late stays stored after the landing, and is not flown. An item without a
    position ends the route before that item.

    `flown`: items of the route before the swap, from the item before the current one on; empty if unknown.
    If that first item has no position, the vehicle's position at `begin` takes its place.
    """

    def __init__(
        self, begin: VehicleState, items: Sequence[MissionItem], flown: Sequence[MissionItem] = ()
    ) -> None:
        lat_lon = begin.lat_lon
        self._frame = None if lat_lon is None else LocalFrame(*lat_lon)
        self._points = [(0.0, 0.0), *self._places(items)]
        legs_m = [math.dist(a, b) for a, b in pairwise(self._points)]
        self._along_m = [0.0, *accumulate(legs_m)]
        """distance along the route to each point"""
        way = self._places(flown) or [(0.0, 0.0), *self._places(flown[1:])]
        self._splice_m = self._common_m(way) or math.inf
        """distance along the route to the splice point; infinite if the new route leaves at once"""
        self._flown_from = way[0] if self._splice_m < math.inf else None
        """begin of the flown leg, which the first leg follows; None if the new route leaves at once"""

    def _places(self, items: Sequence[MissionItem]) -> list[PlanarPoint]:
        """Return the items' positions (east, north) [m], up to the landing or an item without a position."""
        if self._frame is None:
            return []
        n_flown = next((n for n, item in enumerate(items, 1) if item.command == LAND), len(items))
        with_position = takewhile(lambda item: item.x or item.y, items[:n_flown])
        return [self._frame.to_local(item.x / 1e7, item.y / 1e7) for item in with_position]

    def _common_m(self, flown: Sequence[PlanarPoint]) -> float:
        """Return how far the new route follows the flown route, up to a corner of one of them [m]."""
        if len(flown) < 2:
            return 0.0
        n_corners = _n_first_on(self._points[1:], flown)
        # On the leg after these corners the flown route may turn off the new route. A vehicle beside its
        # route makes no difference.
        legs = [flown[0], *self._points[1 : n_corners + 2]]
        turned_off = flown[1 : 1 + _n_first_on(flown[1:], legs)]
        return max(self._along_m[n_corners], *(self._along(corner) for corner in turned_off), 0.0)

    def _along(self, place: PlanarPoint) -> float:
        """Return the distance along the route to a place on the route [m]."""
        legs = list(pairwise(self._points))
        leg = min(range(len(legs)), key=lambda i: distance_to_leg(place, *legs[i]))
        return self._along_m[leg] + math.dist(legs[leg][0], place)

    def at(self, state: VehicleState, later_s: float = 0.0) -> RoutePosition:
        """Return the position on the route `later_s` after `state`, at the same speed along the route.

        While the vehicle's position is unknown, the next item is item 0.
        """
        lat_lon = state.lat_lon
        if self._frame is None or lat_lon is None or not self.is_known:
            return RoutePosition(0, 0.0, math.inf)
        point = self._frame.to_local(*lat_lon)
        legs = [distance_to_leg(point, a, b) for a, b in pairwise(self._points)]
        if self._flown_from is not None:
            # A vehicle that began beside the flown leg may still come back to it.
            legs[0] = min(legs[0], distance_to_leg(point, self._flown_from, self._points[1]))
        # A vehicle at a corner is on both legs; the earlier leg counts, so the corner is still ahead.
        leg = next(i for i, cross_track_m in enumerate(legs) if cross_track_m <= min(legs) + 0.01)
        (ax, ay), (bx, by) = self._points[leg : leg + 2]
        leg_m = max(math.dist((ax, ay), (bx, by)), 0.01)
        east, north = (bx - ax) / leg_m, (by - ay) / leg_m
        # Distance flown straight past a corner counts as if the vehicle had turned.
        flown_m = max((point[0] - ax) * east + (point[1] - ay) * north, 0.0)
        flown_m += max(state.east_m_s * east + state.north_m_s * north, 0.0) * later_s
        return self._position(self._along_m[leg] + flown_m, legs[leg], max(state.ground_speed_m_s, 0.1))

    @property
    def is_known(self) -> bool:
        """Return whether the vehicle's position at `begin` and a first item with a position are known."""
        return len(self._points) >= 2

    def leg_over(self, item: MissionItem) -> int | None:
        """Return the index of the first leg that passes over the item's position; None if no leg does."""
        legs, places = enumerate(pairwise(self._points)), self._places((item,))
        on_item = (i for i, leg in legs for place in places if distance_to_leg(place, *leg) <= SAME_PLACE_M)
        return next(on_item, None)

    def n_behind(self, state: VehicleState) -> int:
        """Return how many of the first items are behind the vehicle, by its velocity."""
        if self._frame is None or state.lat_lon is None:
            return 0
        east_m, north_m = self._frame.to_local(*state.lat_lon)
        ahead_m2_s = (
            (e - east_m) * state.east_m_s + (n - north_m) * state.north_m_s for e, n in self._points[1:]
        )
        return sum(1 for _ in takewhile(lambda ahead: ahead < 0.0, ahead_m2_s))

    def is_near_leg_to(self, item: int, state: VehicleState) -> bool:
        """Return whether the vehicle is near the leg to an item; a number beyond the list means the last."""
        item = min(item, len(self._points) - 2)
        if self._frame is None or state.lat_lon is None or item < 0:
            return False
        point = self._frame.to_local(*state.lat_lon)
        return distance_to_leg(point, *self._points[item : item + 2]) <= MAX_CROSS_TRACK_M

    def _position(self, along_m: float, cross_track_m: float, speed_m_s: float) -> RoutePosition:
        ends_m = self._along_m[1:]
        item = min(sum(end_m < along_m - 0.01 for end_m in ends_m), len(ends_m) - 1)
        if along_m > self._splice_m:
            # The vehicle has followed the old route past the splice point, which stays the next item.
            item = min(item, sum(end_m < self._splice_m - 0.01 for end_m in ends_m))
        since_corner_m = along_m - self._along_m[item] if item else math.inf
        corner_m = min(abs(ends_m[item] - along_m), since_corner_m)
        return RoutePosition(
            item, cross_track_m, corner_m / speed_m_s, along_m - self._splice_m, ends_m[item] - along_m
        )


def _n_first_on(places: Sequence[PlanarPoint], track: Sequence[PlanarPoint]) -> int:
    """Return how many of the first places lie on a track."""
    return sum(1 for _ in takewhile(lambda p: distance_to_track(p, track) <= SAME_PLACE_M, places))
