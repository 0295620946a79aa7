"""Numbers of commands and mission items, which arrive as floats whatever they mean, and may be no number."""

import math


def whole(value: float) -> int:
    """A parameter that is meant to be an integer; -1 where it is no number."""
    return int(value) if math.isfinite(value) else -1


def finite(value: float) -> float:
    """A duration, distance or count; 0 where it is no number."""
    return value if math.isfinite(value) else 0.0
