"""Conversion between geodetic coordinates and local metres, for whole arrays at once."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pyproj import Proj

Floats = npt.NDArray[np.float64]
_RADIUS_M, _ECCENTRICITY_SQUARED = 6_378_137.0, 6.694379990141e-3  # WGS84


class GeodeticPosition(NamedTuple):
    """A position: latitude, longitude [deg], altitude above mean sea level [m]."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    @property
    def lat_lon_deg(self) -> tuple[float, float]:
        return self.lat_deg, self.lon_deg


def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """Return the length of a degree of latitude and longitude [m] at a latitude [deg] (WGS84)."""
    squared = 1.0 - _ECCENTRICITY_SQUARED * math.sin(math.radians(lat_deg)) ** 2
    meridional_m = _RADIUS_M * (1.0 - _ECCENTRICITY_SQUARED) / squared**1.5
    normal_m = _RADIUS_M / math.sqrt(squared)
    return math.radians(meridional_m), math.radians(normal_m * math.cos(math.radians(lat_deg)))


def distance_m(a_deg: tuple[float, float], b_deg: tuple[float, float]) -> float:
    """Return the distance [m] between two positions near each other (latitude, longitude [deg])."""
    north_m, east_m = metres_per_degree(a_deg[0])
    longitude_deg = (b_deg[1] - a_deg[1] + 180.0) % 360.0 - 180.0
    return math.hypot((b_deg[0] - a_deg[0]) * north_m, longitude_deg * east_m)


class LocalFrame:
    """Azimuthal equidistant plane centred on one point of the WGS84 ellipsoid: east and north in metres."""

    def __init__(self, origin_lat_deg: float, origin_lon_deg: float) -> None:
        self._projection = Proj(proj="aeqd", lat_0=origin_lat_deg, lon_0=origin_lon_deg, datum="WGS84")

    def to_local(self, lat_deg: Floats, lon_deg: Floats) -> tuple[Floats, Floats]:
        """Convert latitude, longitude (n,), (n,) [deg] to east, north (n,), (n,) [m]."""
        east_m, north_m = self._projection(lon_deg, lat_deg)
        return np.asarray(east_m), np.asarray(north_m)

    def to_geodetic(self, east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]:
        """Convert east, north (n,), (n,) [m] to latitude, longitude (n,), (n,) [deg]."""
        lon_deg, lat_deg = self._projection(east_m, north_m, inverse=True)
        return np.asarray(lat_deg), np.asarray(lon_deg)

    def point_to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Convert one point [deg] to east, north [m]."""
        east_m, north_m = self._projection(lon_deg, lat_deg)
        return float(east_m), float(north_m)

    def point_to_geodetic(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Convert one point [m] to latitude, longitude [deg]."""
        lon_deg, lat_deg = self._projection(east_m, north_m, inverse=True)
        return float(lat_deg), float(lon_deg)
