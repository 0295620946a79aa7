from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarmctl.agent.formation.reference import Reference, SpeedProfile, window_for

CORNER = ((0.0, 0.0), (0.0, 400.0), (400.0, 400.0))
U_TURN = ((0.0, 0.0), (0.0, 300.0), (0.0, 0.0))
STEPS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


@st.composite
def lattice_routes(draw: st.DrawFn) -> tuple[tuple[float, float], ...]:
    cell_m = draw(st.sampled_from((10.0, 20.0, 50.0, 100.0)))
    points = [(0.0, 0.0)]
    for direction in draw(st.lists(st.integers(0, 7), min_size=1, max_size=40)):
        (east, north), step = points[-1], STEPS[direction]
        points.append((east + cell_m * step[0], north + cell_m * step[1]))
    return tuple(points)


@given(lattice_routes(), st.floats(0.0, 150.0), st.floats(0.0, 2 * math.pi))
@example(U_TURN, 60.0, 1.5)
def test_a_place_moves_without_jumps_at_a_bounded_speed(
    points: tuple[tuple[float, float], ...], radius_m: float, bearing: float
) -> None:
    reference = Reference.over(points, window_for(radius_m))
    offset = radius_m * math.cos(bearing), radius_m * math.sin(bearing)
    n = 400
    step = reference.length_m / n
    at = [reference.at(k * step) for k in range(n + 1)]
    turn = max(abs(pose.turn_rad_m) for pose in at)
    places = [pose.at(*offset) for pose in at]
    for a, b in pairwise(places):
        assert math.dist(a, b) <= step * (1.0 + 1.05 * radius_m * (turn + 0.01)) + 1e-9


@given(lattice_routes(), st.floats(0.0, 1.0), st.floats(0.0, 150.0))
def test_slope_and_turn_are_the_derivatives(
    points: tuple[tuple[float, float], ...], share: float, radius_m: float
) -> None:
    reference = Reference.over(points, window_for(radius_m))
    s_m, d = share * reference.length_m, 1e-4
    a, pose, b = reference.at(s_m - d), reference.at(s_m), reference.at(s_m + d)
    if not d < s_m < reference.length_m - d:
        return
    assert (b.east_m - a.east_m) / (2 * d) == pytest.approx(pose.slope_east, abs=1e-3)
    assert (b.north_m - a.north_m) / (2 * d) == pytest.approx(pose.slope_north, abs=1e-3)
    assert (b.heading_rad - a.heading_rad) / (2 * d) == pytest.approx(pose.turn_rad_m, abs=1e-3)


@given(lattice_routes())
def test_the_curve_begins_and_ends_where_the_route_does(points: tuple[tuple[float, float], ...]) -> None:
    reference = Reference.over(points, window_for(30.0))
    first, last = reference.at(0.0), reference.at(reference.length_m)
    assert math.dist((first.east_m, first.north_m), points[0]) < 1e-6
    assert math.dist((last.east_m, last.north_m), points[-1]) < 1e-6


def test_a_corner_is_cut_by_a_quarter_of_its_window_and_the_heading_turns_over_its_own() -> None:
    reference = Reference.over(CORNER, 60.0)
    at_corner = reference.at(400.0)
    assert math.dist((at_corner.east_m, at_corner.north_m), CORNER[1]) == pytest.approx(
        15.0 * math.sqrt(2.0) / 6.0
    )
    assert at_corner.heading_rad == pytest.approx(math.pi / 4)
    assert reference.at(340.0).heading_rad == 0.0
    assert reference.at(460.0).heading_rad == pytest.approx(math.pi / 2)


def test_the_heading_of_a_zigzag_is_its_mean_direction() -> None:
    points = [(0.0, 0.0)]
    for k in range(40):
        points.append((points[-1][0] + 10.0 * (k % 2), points[-1][1] + 10.0))
    reference = Reference.over(tuple(points), window_for(60.0))
    headings = [reference.at(s).heading_rad for s in range(150, 330)]
    assert max(headings) - min(headings) < math.radians(2.0)


def test_a_full_circle_turns_the_heading_by_a_full_turn() -> None:
    square = ((0.0, 0.0), (0.0, 200.0), (200.0, 200.0), (200.0, 0.0), (0.0, 0.0), (0.0, 200.0))
    reference = Reference.over(square, 30.0)
    turned = reference.at(reference.length_m).heading_rad - reference.at(0.0).heading_rad
    assert turned == pytest.approx(2 * math.pi)


@given(lattice_routes(), st.floats(0.0, 1.0), st.floats(-3.0, 3.0))
def test_a_point_on_the_curve_is_projected_to_its_distance(
    points: tuple[tuple[float, float], ...], share: float, off_m: float
) -> None:
    reference = Reference.over(points, window_for(30.0))
    s_m = share * reference.length_m
    pose = reference.at(s_m)
    found = reference.project((pose.east_m, pose.north_m), s_m + off_m, 5.0)
    there = reference.at(found)
    assert math.dist((pose.east_m, pose.north_m), (there.east_m, there.north_m)) < 0.05


def test_repeated_points_and_a_single_point_are_routes_too() -> None:
    assert Reference.over(((1.0, 2.0), (1.0, 2.0), (1.0, 5.0)), 15.0).length_m == 3.0
    pose = Reference.over(((1.0, 2.0),), 15.0).at(3.0)
    assert (pose.east_m, pose.north_m, pose.turn_rad_m) == (1.0, 2.0, 0.0)
    with pytest.raises(ValueError, match="point"):
        Reference.over((), 15.0)


@given(lattice_routes(), st.floats(0.0, 120.0))
@example(U_TURN, 60.0)
def test_no_place_is_faster_than_the_profile_promises(
    points: tuple[tuple[float, float], ...], radius_m: float
) -> None:
    reference = Reference.over(points, window_for(radius_m))
    profile = SpeedProfile.of(reference, radius_m, 10.0, 12.0, 2.0)
    for k in range(200):
        s_m = k / 200 * reference.length_m
        speed = profile.at(s_m)
        assert 0.4 < speed < 10.001
        if speed > 0.6:
            assert speed * (1.0 + radius_m * abs(reference.at(s_m).turn_rad_m)) < 12.0 * 1.15
    assert profile.at(reference.length_m) == 0.0


def test_the_profile_brakes_before_a_turn_and_at_the_end() -> None:
    reference = Reference.over(CORNER, window_for(60.0))
    profile = SpeedProfile.of(reference, 60.0, 10.0, 12.0, 2.0)
    assert profile.at(150.0) == 10.0
    assert profile.at(400.0) < 7.0
    for s_m in range(0, 790):
        assert abs(profile.at(s_m + 1.0) ** 2 - profile.at(s_m) ** 2) <= 2 * 1.0 * 1.05
    assert profile.at(799.0) < 2.5


def test_a_group_told_late_is_expected_to_slow_down_before_its_turn() -> None:
    reference = Reference.over(CORNER, window_for(60.0))
    profile = SpeedProfile.of(reference, 60.0, 10.0, 12.0, 2.0)
    s_m, speed = profile.ahead(270.0, profile.at(270.0), 5.0)
    assert speed == pytest.approx(profile.at(s_m))
    assert 270.0 + 5.0 * speed < s_m < 270.0 + 4.99 * profile.at(270.0)
    assert profile.ahead(100.0, 5.0, 4.0) == pytest.approx((120.0, 5.0))
