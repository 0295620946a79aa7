"""The content of a map, and its positions in metres."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.belief import OCCUPIED
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid

Points = NDArray[np.float64]
"""(n, 2) metres east and north of the area's south-west corner"""


GROUP_EVERY_S = 20.0
"""Time between two positions of a group on a map [s]."""


class PlannedTrack(msgspec.Struct, frozen=True):
    """One planned line of a vehicle; lines with equal labels, e.g. "w = 0.5", share a style."""

    label: str
    points: Sequence[LatLon]


class VehicleTrack(msgspec.Struct, frozen=True):
    """Planned and flown lines and the outcome of one vehicle; positions are (latitude, longitude)."""

    name: str
    start: LatLon
    goal_cells: Sequence[Cell]
    planned: Sequence[PlannedTrack] = ()
    flown: Sequence[LatLon] = ()
    strikes: Sequence[LatLon] = ()
    """positions of the vehicle at its strikes"""
    is_lost: bool = False
    """True if the vehicle was lost in flight, so `flown` ends at the last known position"""
    outcome: str = ""
    """outcome of the vehicle for the legend, such as "arrived" """


class MapPicture(msgspec.Struct, frozen=True, eq=False):
    """The content of a map."""

    grid: Grid
    hostiles: frozenset[Cell] | None
    """true hostiles; None: unknown, so the map shades the hostiles found"""
    known: NDArray[np.int8]
    """(rows, cols) as `Belief.known`"""
    tracks: Sequence[VehicleTrack]
    title: str
    subtitle: str = ""
    no_fly: frozenset[Cell] = frozenset()
    """cells that no route may enter"""
    groups: Sequence[Sequence[LatLon]] = ()
    """positions of the members of a group at one time, every GROUP_EVERY_S"""


def local_m(grid: Grid, points: Sequence[LatLon]) -> Points:
    lat_lon = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    return np.stack(grid.frame.to_local(lat_lon[:, 0], lat_lon[:, 1]), axis=1)


def view_of(picture: MapPicture) -> tuple[float, float, float, float]:
    """Return west, south, east, north of the view [m]: the area and, within limits, the tracks."""
    grid = picture.grid
    planned = [p for t in picture.tracks for line in t.planned for p in line.points]
    around = [*planned, *(p for t in picture.tracks for p in (t.start, *t.flown))]
    points = np.vstack([local_m(grid, around), [[0.0, 0.0], [grid.size_east_m, grid.size_north_m]]])
    side = max(grid.size_east_m, grid.size_north_m)
    reach, pad = 0.3 * side, 0.035 * side
    low = np.maximum(points.min(axis=0), -reach) - pad
    high = np.minimum(points.max(axis=0), [grid.size_east_m + reach, grid.size_north_m + reach]) + pad
    # A long narrow area gets more space, for the labels.
    spare = np.maximum((high - low).max() * 0.25 - (high - low), 0.0) / 2
    (west, south), (east, north) = low - spare, high + spare
    return west, south, east, north


def shading(picture: MapPicture) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks of hostile cells, their N1 and their N2 cells; no cell is in two masks."""
    hostile = np.zeros(picture.known.shape, dtype=bool)
    if picture.hostiles is None:
        hostile = picture.known == OCCUPIED
    else:
        for cell in picture.hostiles:
            hostile[cell] = True
    up_to_n1 = ndimage.binary_dilation(hostile, ndimage.generate_binary_structure(2, 1))
    up_to_n2 = ndimage.binary_dilation(hostile, ndimage.generate_binary_structure(2, 2))
    return hostile, up_to_n1 & ~hostile, up_to_n2 & ~up_to_n1
