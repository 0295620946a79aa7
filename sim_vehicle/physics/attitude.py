"""Conversion between attitudes as angles and as quaternions: rotations from body to north-east-down."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_vehicle.physics.geodesy import Floats


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of one attitude."""
    half = roll_rad / 2, pitch_rad / 2, yaw_rad / 2
    return _product(tuple(map(math.cos, half)), tuple(map(math.sin, half)))


def quaternions(angles_rad: Floats) -> Floats:
    """Convert roll, pitch, yaw [rad] (n, 3) to w, x, y, z (n, 4)."""
    half = angles_rad / 2
    return np.column_stack(_product(np.cos(half).T, np.sin(half).T))


def _product(cosines: Any, sines: Any) -> tuple[Any, Any, Any, Any]:
    """Return w, x, y, z from the cosines and sines of half the roll, pitch and yaw."""
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def angles_rad(q: Sequence[float]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a quaternion w, x, y, z."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
