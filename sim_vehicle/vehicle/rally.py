"""Rally points: positions to return to instead of home."""

import math
from collections.abc import Sequence

from sim_vehicle.physics.geodesy import metres_per_degree
from sim_vehicle.vehicle.mission import Item


class Rally:
    """The stored rally points of one vehicle, as mission items."""

    def __init__(self) -> None:
        self.items: tuple[Item, ...] = ()

    def replace(self, items: Sequence[Item]) -> None:
        self.items = tuple(items)

    def nearest(
        self,
        here_deg: tuple[float, float],
        home_deg: tuple[float, float],
        *,
        limit_m: float = math.inf,
        include_home: bool = True,
    ) -> Item | None:
        """Return the nearest rally point closer than `limit_m`, or None for home.

        include_home: only points closer than home count.
        """
        if include_home:
            limit_m = min(limit_m, distance_m(here_deg, home_deg))
        found = min(self.items, key=lambda item: _distance_to_m(here_deg, item), default=None)
        return found if found is not None and _distance_to_m(here_deg, found) < limit_m else None


def _distance_to_m(here_deg: tuple[float, float], item: Item) -> float:
    return distance_m(here_deg, (item.x * 1e-7, item.y * 1e-7))


def distance_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    """Return the distance [m] between two positions near each other (latitude, longitude [deg])."""
    north_m, east_m = metres_per_degree(a_deg[0])
    longitude_deg = (b_deg[1] - a_deg[1] + 180.0) % 360.0 - 180.0
    return math.hypot((b_deg[0] - a_deg[0]) * north_m, longitude_deg * east_m)
