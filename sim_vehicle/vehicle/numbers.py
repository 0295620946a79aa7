"""Conversion of the numbers in commands and mission items, which can be NaN or infinite."""

import math


def to_int(value: float) -> int:
    """Return the number truncated to an integer; -1 for NaN and infinity."""
    return int(value) if math.isfinite(value) else -1


def finite(value: float) -> float:
    """Return the number itself; 0 for NaN and infinity."""
    return value if math.isfinite(value) else 0.0
