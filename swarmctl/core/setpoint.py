"""A set-point: where a vehicle shall be now, and how fast it shall move."""

from __future__ import annotations

import msgspec

from swarmctl.core.geo import LatLon


class SetPoint(msgspec.Struct, frozen=True):
    """A velocity, and the position that moves at this velocity; the velocity alone without a position."""

    velocity_m_s: tuple[float, float, float]
    """east, north, up [m/s]"""
    at: LatLon | None = None
    """latitude and longitude [deg]"""
    alt_amsl_m: float | None = None
    """Height above the sea, by the vehicle's own estimate (`VehicleState.alt_amsl_m`) [m]; present together
    with `at`."""


STOP = SetPoint((0.0, 0.0, 0.0))
"""a set-point that stops the vehicle where it is"""
