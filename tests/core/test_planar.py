"""Fences on a plane, compared with samples of many points."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from swarmctl.core.planar import (
    bounding_box,
    contains,
    convex_hull,
    crossing_sides,
    padded_hull,
    stays_inside,
    turning_points,
)

COORDINATE = st.floats(-1000.0, 1000.0).map(lambda v: round(v, 2))
POINT = st.tuples(COORDINATE, COORDINATE)
SQUARE = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))
HORSESHOE = (
    *((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (70.0, 100.0)),
    *((70.0, 30.0), (30.0, 30.0), (30.0, 100.0), (0.0, 100.0)),
)


def between(a, b, share):
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


@settings(deadline=None, derandomize=True)
@given(st.lists(POINT, min_size=1, max_size=30), st.floats(1.0, 200.0), st.floats(0.0, 6.3))
def test_every_point_is_inside_by_the_margin(points, margin_m, angle):
    fence = padded_hull(points, margin_m)
    # Corners within a centimetre of an edge are left out.
    reach_m = 0.98 * margin_m - 0.1
    for e, n in points:
        assert contains(fence, (e, n))
        assert contains(fence, (e + reach_m * math.cos(angle), n + reach_m * math.sin(angle)))


def test_a_far_corner_almost_in_line_with_an_edge_stays_in_the_hull():
    fence = padded_hull([(0.0, 0.0), (0.5, -102.0)], 1.0)
    assert (-0.5, -103.0) in fence
    assert contains(fence, (0.0, 0.0))


def test_a_row_of_points_has_a_fence_of_few_corners():
    row = [(0.0, 10.0 * i + 1e-6 * (i % 3)) for i in range(250)]
    assert len(padded_hull(row, 50.0)) == 4
    assert convex_hull([*SQUARE, (50.0, 50.0), (50.0, 0.0)]) == SQUARE
    assert bounding_box([(0.0, 5.0), (3.0, 1.0), (-1.0, 2.0)]) == (
        (-1.0, 1.0),
        (3.0, 1.0),
        (3.0, 5.0),
        (-1.0, 5.0),
    )


@pytest.mark.parametrize(
    ("a", "b", "stays"),
    [
        ((10.0, 10.0), (90.0, 10.0), True),
        ((10.0, 90.0), (90.0, 90.0), False),  # across the gap, both ends inside
        ((10.0, 10.0), (150.0, 10.0), False),
        ((150.0, 10.0), (10.0, 10.0), False),
        ((-10.0, 50.0), (110.0, 50.0), False),
        ((10.0, 10.0), (30.0, 30.0), False),  # ends on the edge
        ((10.0, 20.0), (90.0, 30.0), True),
    ],
)
def test_a_leg_of_a_concave_fence(a, b, stays):
    assert stays_inside(HORSESHOE, a, b) is stays


@settings(deadline=None, derandomize=True)
@given(POINT, POINT, st.lists(POINT, min_size=3, max_size=8), st.floats(0.0, 1.0))
def test_every_point_of_a_leg_that_stays_inside_is_inside(a, b, corners, share):
    hull = convex_hull(corners)
    assume(len(hull) >= 3)
    if stays_inside(hull, a, b):
        assert contains(hull, between(a, b, share))


def test_no_sides_of_a_simple_polygon_cross_in_either_orientation():
    for polygon in (SQUARE, HORSESHOE):
        assert crossing_sides(polygon) is None
        assert crossing_sides(polygon[::-1]) is None


@settings(deadline=None, derandomize=True)
@given(st.lists(POINT, min_size=4, max_size=12, unique=True), st.data())
def test_sides_of_a_convex_polygon_cross_after_two_corners_are_swapped(points, data):
    hull = list(convex_hull(points))
    assume(len(hull) >= 4)
    assert crossing_sides(hull) is None
    i = data.draw(st.integers(0, len(hull) - 2))
    hull[i], hull[i + 1] = hull[i + 1], hull[i]
    assert crossing_sides(hull) is not None


@pytest.mark.parametrize("shift_m", [(0.0, 0.0), (1000.0, -500.0), (-700.0, 300.0)])
@pytest.mark.parametrize(
    ("polygon", "sides"),
    [
        ([(0.0, 0.0), (100.0, 0.0), (50.0, 0.0), (50.0, 80.0)], (0, 1)),  # folds back at its second corner
        ([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0), (50.0, 80.0)], None),  # the same corners, straight on
    ],
)
def test_a_side_that_folds_back_crosses_the_side_before_it(polygon, sides, shift_m):
    moved = [(e + shift_m[0], n + shift_m[1]) for e, n in polygon]
    assert crossing_sides(moved) == sides


def test_the_turning_points_of_a_polyline_are_its_ends_and_corners() -> None:
    east = [(float(x), 0.0) for x in range(5)]
    assert turning_points([*east, (4.0, 1.0), (4.0, 2.0), (4.0, 0.5)]) == [
        (0.0, 0.0),
        (4.0, 0.0),
        (4.0, 2.0),
        (4.0, 0.5),
    ]
    assert turning_points(east[:1]) == east[:1]
    assert turning_points([]) == []
