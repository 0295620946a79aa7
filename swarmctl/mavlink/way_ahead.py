"""Where a vehicle that flies is on the route it is to take over: which of its items lies ahead. Pure.

A new route begins with what it has in common with the one that is flown. Until it can be taken over a vehicle
flies on, so its first items may lie behind by then: what lies behind is never flown to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import MissionItem
from swarmctl.core.plane import Point, distance_to_leg
from swarmctl.core.vehicle import VehicleState

TELLS_EVERY_S = 0.25
"""Positions come four times a second: half of that is what one is old on the average, beside the link."""
CORNER_S = 0.75
"""So near to a corner nobody knows whether it is passed when an order arrives: it is waited for."""
LATE_M = 12.0
"""So far beside the new route a vehicle is not on it any more: it has flown past where that turns off."""


@dataclass(frozen=True, slots=True)
class Ahead:
    """Where a vehicle is on a route."""

    item: int
    """the next to fly to, as an index of the route"""
    beside_m: float
    """from the route"""
    corner_s: float
    """until it passes that item, or since it passed the one before, whichever is nearer"""

    @property
    def is_late(self) -> bool:
        return self.beside_m > LATE_M


class WayAhead:
    """A route (items with places) as it lies before a vehicle that was at `begin` when it was told of it."""

    def __init__(self, begin: VehicleState, items: Sequence[MissionItem]) -> None:
        here = _place(begin)
        self._frame = None if here is None else LocalFrame(*here)
        self._points: list[Point] = []
        if self._frame is not None:
            places = ((i.x / 1e7, i.y / 1e7) for i in takewhile(lambda i: i.x or i.y, items))
            self._points = [(0.0, 0.0), *(self._frame.to_local(*place) for place in places)]

    def at(self, state: VehicleState, later_s: float = 0.0) -> Ahead:
        """Where the vehicle is `later_s` after it told `state`, as fast as it was then; at the first item
        where it has not told."""
        here = _place(state)
        if self._frame is None or here is None or len(self._points) < 2:
            return Ahead(0, 0.0, math.inf)
        east_m, north_m = self._frame.to_local(*here)
        place = east_m + state.east_m_s * later_s, north_m + state.north_m_s * later_s
        legs = [distance_to_leg(place, a, b) for a, b in zip(self._points, self._points[1:], strict=False)]
        # At a corner it is on both legs, and that corner is still to be passed.
        leg = next(i for i, away_m in enumerate(legs) if away_m <= min(legs) + 0.01)
        speed_m_s = max(state.ground_speed_m_s, 0.1)
        passed_m = math.dist(place, self._points[leg]) if leg else math.inf
        corner_m = min(math.dist(place, self._points[leg + 1]), passed_m)
        return Ahead(leg, legs[leg], corner_m / speed_m_s)


def _place(state: VehicleState) -> LatLon | None:
    if state.lat_deg is None or state.lon_deg is None:
        return None
    return state.lat_deg, state.lon_deg
