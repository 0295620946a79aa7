"""How far beyond its fence a vehicle is: the checks' own reckoning, apart from the vehicles'."""

import math
from collections.abc import Sequence

from sim_vehicle.scenarios.plan import FenceShape

Corner = tuple[float, float]


def outside_m(shapes: Sequence[FenceShape], east_m: float, north_m: float) -> float:
    """Metres beyond the shape that is crossed the furthest, 0 where every shape is kept."""
    return max((_beyond_m(shape, east_m, north_m) for shape in shapes), default=0.0)


def _beyond_m(shape: FenceShape, east_m: float, north_m: float) -> float:
    circle = shape.keep_in_circle or shape.keep_out_circle
    if circle is not None:
        inside_m = circle.radius_m - math.hypot(east_m - circle.east_m, north_m - circle.north_m)
    else:
        polygon = shape.keep_in or shape.keep_out or ()
        edge_m = min(_edge_m(a, b, east_m, north_m) for a, b in _edges(polygon))
        inside_m = edge_m if _inside(polygon, east_m, north_m) else -edge_m
    return max(0.0, -inside_m if shape.inclusion else inside_m)


def _edges(polygon: Sequence[Corner]) -> list[tuple[Corner, Corner]]:
    return list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))


def _inside(polygon: Sequence[Corner], east_m: float, north_m: float) -> bool:
    """By the number of edges that a ray to the east crosses."""
    crossed = False
    for (east_a, north_a), (east_b, north_b) in _edges(polygon):
        if (north_a > north_m) != (north_b > north_m):
            at_m = east_a + (north_m - north_a) / (north_b - north_a) * (east_b - east_a)
            crossed ^= east_m < at_m
    return crossed


def _edge_m(a: Corner, b: Corner, east_m: float, north_m: float) -> float:
    along = (b[0] - a[0], b[1] - a[1])
    squared = along[0] ** 2 + along[1] ** 2
    share = ((east_m - a[0]) * along[0] + (north_m - a[1]) * along[1]) / squared if squared else 0.0
    share = min(1.0, max(0.0, share))
    return math.hypot(east_m - a[0] - share * along[0], north_m - a[1] - share * along[1])
