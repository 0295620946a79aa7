from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmctl.agent.formation.shape import (
    Shape,
    assigned,
    least_spacing_between_m,
    least_spacing_m,
    radius_m,
    width_m,
)

KINDS = ("wedge", "line", "column", "circle")


@given(st.sampled_from(KINDS), st.integers(1, 20), st.floats(1.0, 200.0), st.floats(60.0, 180.0))
def test_the_leader_is_at_the_reference_and_no_neighbours_are_nearer_than_the_spacing(
    kind: str, n: int, spacing_m: float, opening_deg: float
) -> None:
    shape = Shape(kind=kind, spacing_m=spacing_m, opening_deg=opening_deg if kind == "wedge" else 90.0)
    of = shape.places(n)
    assert len(of) == n
    assert of[0] == (0.0, 0.0, 0.0)
    assert least_spacing_m(of) >= spacing_m * (1 - 1e-9) or n == 1
    assert least_spacing_m(of) <= spacing_m * (1 + 1e-9) or n == 1


def test_a_wedge_of_three_opens_behind_the_leader_by_its_angle() -> None:
    _, right, left = Shape(kind="wedge", spacing_m=10.0, height_step_m=2.0).places(3)
    half = 10.0 / math.sqrt(2.0)
    assert right == pytest.approx((-half, half, 2.0))
    assert left == pytest.approx((-half, -half, 4.0))


def test_a_narrow_wedge_brings_the_arms_nearer_than_the_spacing() -> None:
    assert least_spacing_m(Shape(kind="wedge", spacing_m=10.0, opening_deg=20.0).places(3)) == pytest.approx(
        20.0 * math.sin(math.radians(10.0))
    )


def test_a_circle_of_four_is_a_diamond_with_the_leader_in_front() -> None:
    side = 20.0 / math.sqrt(2.0)
    front, right, left, back = Shape(kind="circle", spacing_m=20.0).places(4)
    assert front == (0.0, 0.0, 0.0)
    assert right == pytest.approx((-side, side, 0.0))
    assert left == pytest.approx((-side, -side, 0.0))
    assert back == pytest.approx((-2 * side, 0.0, 0.0))


def test_width_and_radius_of_a_line_and_a_column() -> None:
    line, column = Shape(kind="line").places(5), Shape(kind="column").places(5)
    assert (width_m(line), radius_m(line)) == (120.0, 60.0)
    assert (width_m(column), radius_m(column)) == (0.0, 120.0)


def test_places_far_enough_apart_in_height_do_not_count_as_near() -> None:
    of = Shape(kind="offsets", offsets_m=((0.0, 2.0, 10.0),)).places(2)
    assert least_spacing_m(of) == 2.0
    assert math.isinf(least_spacing_m(of, apart_in_height_m=5.0))


def test_members_that_exchange_their_places_meet_halfway() -> None:
    before = ((0.0, -10.0, 0.0), (0.0, 10.0, 0.0))
    assert least_spacing_between_m(before, before[::-1]) == 0.0
    assert least_spacing_between_m(before, before) == 20.0


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "offsets"},
        {"kind": "wedge", "offsets_m": ((1.0, 2.0, 3.0),)},
        {"kind": "line", "opening_deg": 60.0},
        {"kind": "offsets", "offsets_m": ((1.0, 2.0, 3.0),), "spacing_m": 20.0},
        {"spacing_m": 0.0},
        {"opening_deg": 190.0},
        {"kind": "diamond"},
    ],
)
def test_a_shape_that_makes_no_sense_is_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Shape(**options)


def test_too_few_offsets_are_refused() -> None:
    with pytest.raises(ValueError, match="2"):
        Shape(kind="offsets", offsets_m=((1.0, 2.0, 3.0),)).places(3)


def test_a_lost_member_is_closed_up_or_left_open() -> None:
    present = (False, True, False, True)
    assert assigned(present, closes_up=True) == (None, 0, None, 1)
    assert assigned(present, closes_up=False) == (None, 1, None, 3)
