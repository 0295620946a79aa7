"""Conversion of numbers in commands and mission items: floats that can be NaN or infinite."""

import math


def whole(value: float) -> int:
    """Return an integer parameter; -1 for NaN and infinity."""
    return int(value) if math.isfinite(value) else -1


def finite(value: float) -> float:
    """Return a duration, distance or count; 0 for NaN and infinity."""
    return value if math.isfinite(value) else 0.0
