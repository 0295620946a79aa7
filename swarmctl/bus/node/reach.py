"""To whom a UAV speaks: the communication range of the paper, a number of UAVs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.geo import LatLon, distances_m


def recipients(
    at: LatLon | None,
    uavs: NDArray[np.int64],
    places: tuple[NDArray[np.float64], NDArray[np.float64]],
    silent: NDArray[np.bool_],
    k: int | None,
) -> tuple[int, ...]:
    """The `k` nearest of `uavs` to `at` by last known position, nearest first; None means everybody.

    `uavs` ascend; `places` are their latitudes and longitudes [deg], NaN where unknown. Who is where nobody
    knows comes after those whose place is known, and after both who has not been heard for long.
    """
    if k is None or k >= uavs.size:
        return tuple(uavs.tolist())
    metres = np.full(uavs.size, np.inf)
    if at is not None:
        known = np.flatnonzero(~np.isnan(places[0]))
        metres[known] = distances_m(at, places[0][known], places[1][known])
    order = np.lexsort((uavs, metres, silent))
    return tuple(uavs[order[:k]].tolist())
