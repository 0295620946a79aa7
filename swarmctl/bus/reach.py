"""To whom a UAV speaks: the communication range of the paper, a number of UAVs."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.core.geo import LatLon, distance_m


def recipients(
    at: LatLon | None,
    alive: Mapping[int, LatLon | None],
    silent: Mapping[int, LatLon | None],
    k: int | None,
) -> tuple[int, ...]:
    """The `k` nearest UAVs to `at` by last known position, nearest first; None means everybody.

    A UAV whose position is unknown comes after those whose is known, and after both who has not been heard
    for long.
    """
    if k is None or k >= len(alive) + len(silent):
        return tuple(sorted((*alive, *silent)))

    def far(uav: int) -> tuple[bool, float, int]:
        there = alive[uav] if uav in alive else silent[uav]
        metres = math.inf if at is None or there is None else distance_m(at, there)
        return (uav in silent, metres, uav)

    return tuple(sorted((*alive, *silent), key=far)[:k])
