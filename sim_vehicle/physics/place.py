"""A point on or above the earth."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Place:
    """Latitude, longitude [deg], altitude above mean sea level [m]."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
