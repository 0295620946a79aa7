"""Arcs at the corners of a track."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.any_angle.track import GridPoint
from swarmctl.core.any_angle.turns import ARC_ERROR, arc, rounded, tangent_length

QUICK = settings(max_examples=examples(150), deadline=None, derandomize=True)
POINT = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))


@pytest.mark.parametrize(
    ("after", "away"),
    [
        ((2.0, 0.0), 0.0),  # straight on
        ((1.0, 1.0), 3.0),  # 90°: r · tan 45°
        ((2.0, 1.0), 3.0 * math.tan(math.pi / 8)),  # 45°
        ((0.0, 1.0), 3.0 * math.tan(3 * math.pi / 8)),  # 135°
        ((0.5, 0.0), math.inf),  # back
    ],
)
def test_an_arc_begins_at_the_computed_distance_from_the_corner(after: GridPoint, away: float) -> None:
    assert tangent_length((0.0, 0.0), (1.0, 0.0), after, 3.0) == pytest.approx(away)


@QUICK
@given(POINT, POINT, POINT, st.floats(0.1, 5.0))
def test_an_arc_has_the_radius_and_touches_both_legs(
    before: GridPoint, corner: GridPoint, after: GridPoint, radius: float
) -> None:
    assume(math.dist(before, corner) > 0.5 and math.dist(corner, after) > 0.5)
    away = tangent_length(before, corner, after, radius)
    assume(1e-3 < away < 40.0)
    points = arc(before, corner, after, radius)
    for end, towards in ((points[0], before), (points[-1], after)):
        share = away / math.dist(corner, towards)
        on_leg = tuple(c + share * (t - c) for c, t in zip(corner, towards, strict=True))
        assert math.dist(end, on_leg) < 1e-6
    # The centre lies perpendicular to the leg at the arc's start, at the same distance from every point.
    (bx, by), (cx, cy) = points[0], corner
    length = math.dist(points[0], corner)
    normal = ((by - cy) / length, (cx - bx) / length)
    centres = [(bx + side * radius * normal[0], by + side * radius * normal[1]) for side in (1.0, -1.0)]
    apart = [max(abs(math.dist(centre, point) - radius) for point in points) for centre in centres]
    assert min(apart) < 1e-6
    for a, b in itertools.pairwise(points):
        half = math.dist(a, b) / 2.0
        assert radius - math.sqrt(max(radius**2 - half**2, 0.0)) <= ARC_ERROR + 1e-9


def test_a_rounded_track_keeps_its_ends_and_names_the_leg_of_each_piece() -> None:
    corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (20.0, 10.0)]
    points, legs = rounded(corners, 2.0)
    assert (points[0], points[-1]) == (corners[0], corners[-1])
    assert len(legs) == len(points) - 1
    assert legs == sorted(legs)
    assert set(legs) == {0, 1, 2}
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    assert length == pytest.approx(30.0 - 2 * (4.0 - math.pi), abs=0.02)


def test_a_track_with_radius_0_is_its_corners() -> None:
    corners = [(0.5, 0.5), (3.5, 0.5), (0.5, 0.5)]
    assert rounded(corners, 0.0) == (corners, [0, 1])
    assert rounded(corners[:1], 4.0) == (corners[:1], [])


def test_arcs_without_a_straight_piece_between_them_share_a_point() -> None:
    corners = [(0.1, 0.1), (4.1, 0.1), (4.1, 8.1), (8.1, 8.1)]
    points, legs = rounded(corners, 4.0)
    assert points[0] == corners[0]
    assert points[-1] == corners[-1]
    assert min(math.dist(a, b) for a, b in itertools.pairwise(points)) > 0.01
    assert len(legs) == len(points) - 1
    assert set(legs) == {0, 1, 2}
