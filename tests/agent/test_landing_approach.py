"""Geometry of a fixed wing's landing: circle, final and heading."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.replan.landing_pattern import (
    FixedWing,
    LandingPattern,
    NoApproach,
    PlanarPoint,
    Pose,
    choose_pattern,
    landing_pattern,
    path_to_circle,
    pattern_from,
    planned_approach,
)
from swarmctl.core.geo import LocalFrame
from swarmctl.core.planar import contains
from swarmctl.core.records import replace

FRAME = LocalFrame(46.0, 14.4)
WINGS = FixedWing(
    loiter_radius_m=60.0,
    final_height_m=20.0,
    glide_deg=6.0,
    min_speed_m_s=11.0,
    takeoff_height_m=20.0,
    home=(46.0, 14.4),
)
NORTH, EAST, SOUTH = 0.0, math.pi / 2.0, math.pi
COMES_EAST = Pose((0.0, 0.0), EAST)


def chosen(
    fence: Sequence[PlanarPoint] = (),
    under: Callable[[Sequence[PlanarPoint]], float] = lambda way: 0.0,
    wings: FixedWing = WINGS,
    comes: Pose = COMES_EAST,
) -> LandingPattern:
    return choose_pattern(
        (0.0, 0.0),
        wings,
        from_pose=comes,
        with_path_to_circle=True,
        turn_radius_m=40.0,
        fence=fence,
        exposure_under=under,
    )


def box(west: float, south: float, east: float, north: float) -> list[PlanarPoint]:
    return [(west, south), (east, south), (east, north), (west, north)]


headings = st.floats(0.0, math.tau)


@given(headings, st.booleans(), st.floats(2.0, 12.0), st.floats(20.0, 200.0))
def test_the_final_has_the_configured_glide_angle_and_the_tangent_of_the_circle(
    heading_rad: float, clockwise: bool, glide_deg: float, radius_m: float
) -> None:
    wings = replace(WINGS, glide_deg=glide_deg, loiter_radius_m=radius_m)
    found = landing_pattern((10.0, -20.0), heading_rad, wings, clockwise=clockwise)
    final_m = math.dist(found.final, found.touchdown)
    assert math.degrees(math.atan2(20.0, final_m)) == pytest.approx(glide_deg)
    assert all(math.dist(point, found.centre) == pytest.approx(radius_m) for point in found.circle())
    # The circle exit has the landing heading: the last chord differs by half a step.
    (e0, n0), (e1, n1) = found.circle()[-2:]
    turned = math.remainder(heading_rad - math.atan2(e1 - e0, n1 - n0), math.tau)
    assert turned == pytest.approx(math.copysign(math.pi / 16, found.radius_m), abs=1e-6)
    east_m, north_m = radius_m * math.sin(heading_rad), radius_m * math.cos(heading_rad)
    ahead = found.circle_exit[0] + east_m, found.circle_exit[1] + north_m
    assert math.dist(found.final, ahead) == pytest.approx(0.0, abs=1e-6)


@given(headings, st.booleans())
def test_a_pattern_survives_conversion_to_a_plan_and_back(heading_rad: float, clockwise: bool) -> None:
    found = landing_pattern((300.0, 400.0), heading_rad, WINGS, clockwise=clockwise)
    again = pattern_from(planned_approach(found, FRAME, 20.0), FRAME)
    assert again.radius_m == found.radius_m
    for mine, its in zip(again.outline(), found.outline(), strict=True):
        assert math.dist(mine, its) < 0.05


def test_the_landing_heading_is_that_of_arrival_without_obstacles() -> None:
    assert chosen().heading_rad == pytest.approx(EAST)


def test_a_configured_landing_heading_is_used() -> None:
    into_the_wind = replace(WINGS, landing_heading_deg=250.0)
    assert math.degrees(chosen(wings=into_the_wind).heading_rad) == pytest.approx(250.0)


@given(st.floats(-math.pi, math.pi))
def test_no_leg_leaves_the_fence_for_any_direction_of_arrival(heading_rad: float) -> None:
    fence = box(-420.0, -330.0, 180.0, 150.0)
    comes = Pose((0.0, 0.0), heading_rad)
    found = chosen(fence, comes=comes)
    way = [*path_to_circle(comes, found, 40.0), *found.outline()]
    assert all(contains(fence, point) for point in way)


def test_the_least_exposed_pattern_inside_the_fence_is_chosen() -> None:
    def east_is_seen(way: Sequence[PlanarPoint]) -> float:
        return sum(1.0 for east_m, _ in way if east_m > 100.0)

    found = chosen(box(-600.0, -600.0, 600.0, 600.0), east_is_seen)
    assert max(east_m for east_m, _ in found.outline()) <= 100.0


def test_the_error_for_missing_room_names_the_needed_lengths() -> None:
    with pytest.raises(NoApproach, match=r"\b190 m\b.*\b60 m\b"):
        chosen(box(-100.0, -100.0, 100.0, 100.0))
    with pytest.raises(NoApproach):
        chosen(under=lambda way: math.inf)


@given(headings, st.floats(-400.0, 400.0), st.floats(-400.0, 400.0), st.floats(20.0, 60.0))
def test_the_path_to_the_circle_respects_the_turn_radius_and_ends_at_the_circle(
    heading_rad: float, east_m: float, north_m: float, turn_radius_m: float
) -> None:
    there = landing_pattern((0.0, 0.0), NORTH, WINGS, clockwise=True)
    way = path_to_circle(Pose((east_m, north_m), heading_rad), there, turn_radius_m)
    assert math.dist(way[-1], there.centre) <= 60.0
    courses = [math.atan2(e1 - e0, n1 - n0) for (e0, n0), (e1, n1) in pairwise(way)]
    turns = [abs(math.remainder(b - a, math.tau)) for a, b in pairwise([heading_rad, *courses])]
    assert max(turns, default=0.0) <= 10.0 / turn_radius_m + 1e-6
