"""Geodesy: conversion between degrees on WGS-84 and metres on a local plane; distances on the ellipsoid."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import overload

import msgspec
import numpy as np
from numpy.typing import NDArray
from pyproj import Geod, Transformer

Floats = NDArray[np.float64]
LatLon = tuple[float, float]
"""latitude, longitude [deg], WGS-84"""

POINTS_KEPT = 4096
"""number of single points that a frame remembers"""
_ELLIPSOID = Geod(ellps="WGS84")


@lru_cache(maxsize=64)
def _projection(lat_deg: float, lon_deg: float) -> Transformer:
    # pyproj documents a Transformer as safe in several threads, but not a bare Proj.
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +proj=aeqd +lat_0={lat_deg!r} +lon_0={lon_deg!r} +ellps=WGS84 +units=m"
    )


class LocalFrame(msgspec.Struct, frozen=True, dict=True):
    """A plane that touches the ellipsoid at (lat_deg, lon_deg), with axes east and north.

    The projection is azimuthal equidistant: distance and direction from the origin are exact. At 50 km from
    the origin the scale is wrong by about 10 parts in a million.
    """

    lat_deg: float
    lon_deg: float

    def __post_init__(self) -> None:
        if not (-90.0 <= self.lat_deg <= 90.0 and -180.0 <= self.lon_deg <= 180.0):
            raise ValueError(
                f"origin ({self.lat_deg}, {self.lon_deg}): expected a latitude in [-90, 90] and a longitude "
                "in [-180, 180], in degrees and in this order"
            )

    @cached_property
    def _local(self) -> Callable[[float, float], tuple[float, float]]:
        """`to_local` of single points; it remembers the last points, because many vehicles ask for each."""
        return lru_cache(maxsize=POINTS_KEPT)(_projection(self.lat_deg, self.lon_deg).transform)

    @overload
    def to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]: ...
    @overload
    def to_local(self, lat_deg: Floats, lon_deg: Floats) -> tuple[Floats, Floats]: ...
    def to_local(
        self, lat_deg: float | Floats, lon_deg: float | Floats
    ) -> tuple[float | Floats, float | Floats]:
        """Return (east, north) [m] of points in degrees; inf or nan for points that cannot be projected."""
        if isinstance(lat_deg, float) and isinstance(lon_deg, float):
            return self._local(lon_deg, lat_deg)
        east_m, north_m = _projection(self.lat_deg, self.lon_deg).transform(lon_deg, lat_deg)
        return east_m, north_m

    @overload
    def to_geodetic(self, east_m: float, north_m: float) -> tuple[float, float]: ...
    @overload
    def to_geodetic(self, east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]: ...
    def to_geodetic(
        self, east_m: float | Floats, north_m: float | Floats
    ) -> tuple[float | Floats, float | Floats]:
        """Return (latitude, longitude) [deg] of points in metres east and north of the origin."""
        lon_deg, lat_deg = _projection(self.lat_deg, self.lon_deg).transform(
            east_m, north_m, direction="INVERSE"
        )
        return lat_deg, lon_deg


def check_position(lat_deg: float, lon_deg: float) -> None:
    """Raise ValueError unless both are degrees of a latitude and a longitude."""
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise ValueError(f"position ({lat_deg}, {lon_deg}): expected degrees")


def distance_m(a: LatLon, b: LatLon) -> float:
    """Return the length of the geodesic from `a` to `b` [m]."""
    _, _, metres = _ELLIPSOID.inv(a[1], a[0], b[1], b[0])
    return float(metres)


def distances_m(a: LatLon, lat_deg: Floats, lon_deg: Floats) -> Floats:
    """Return the lengths of the geodesics from `a` to many points [m], in the shape of `lat_deg`."""
    lat, lon = np.full_like(lat_deg, a[0]), np.full_like(lon_deg, a[1])
    _, _, metres = _ELLIPSOID.inv(lon, lat, lon_deg, lat_deg)
    return np.asarray(metres, dtype=np.float64)
