"""Bounds on length from a time bound: elapsed time, lead-in and margin."""

from __future__ import annotations

import math

import pytest
from flown_legs import START_LOSS_S
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.agent.replan.length_bounds import (
    HALF_DIAGONAL_CELLS,
    LeadIn,
    LengthBounds,
    TimeBound,
    before_takeoff,
    length_bounds,
)

CELL_M = 50.0
AT_10_M_S = TimeBound(speed_m_s=10.0, within_s=120.0, approach_m=85.0)


def test_every_length_is_allowed_without_a_time_bound() -> None:
    assert length_bounds(TimeBound(), CELL_M, before_takeoff(TimeBound(), 40.0, 1.9)) == LengthBounds(
        0.0, math.inf
    )


def test_the_climb_and_the_flight_to_the_entry_count_before_take_off() -> None:
    # 40 m at 2.5 m/s, 2.5 s to speed up and brake, and 4 s to lift off; 85 m at 10 m/s from rest to rest:
    # speeding up costs 3.9 s, braking by 1.75 m/s² 20/7 s. Of 120 s that leaves 93 s less 6.757 s.
    on_ground = before_takeoff(AT_10_M_S, altitude_m=40.0, start_delay_s=1.9)
    left_m = 930.0 - 40.0 - 10.0 * (START_LOSS_S + 20.0 / 7.0)
    assert length_bounds(AT_10_M_S, CELL_M, on_ground) == LengthBounds(0.0, pytest.approx(left_m / CELL_M))
    assert on_ground.arrives_s(AT_10_M_S, left_m) == pytest.approx(120.0)


def test_the_early_bound_counts_no_lost_time() -> None:
    between = TimeBound(10.0, 80.0, 120.0)
    plain, losing = LeadIn(60.0, 0.0, 0.0), LeadIn(60.0, 0.0, 0.0, lost_s=5.0)
    assert length_bounds(between, CELL_M, losing).min_cells == length_bounds(between, CELL_M, plain).min_cells
    assert length_bounds(between, CELL_M, losing).max_cells == pytest.approx(11.0)


LEAD_INS = [
    ("over the centre of its cell", LeadIn(60.0, 0.0, 0.0), 12.0),
    ("half a cell before the centre", LeadIn(60.0, 0.0, 25.0), 11.5),
    ("half a cell past the centre", LeadIn(60.0, 0.0, -25.0), 12.5),
    ("still climbing", LeadIn(5.0, 25.0, 85.0), 18.8),
    ("above its altitude", LeadIn(60.0, -3.0, 0.0), 12.0),
    ("late", LeadIn(130.0, 0.0, 0.0), 0.0),
]


@pytest.mark.parametrize(
    ("underway", "cells"), [way[1:] for way in LEAD_INS], ids=[way[0] for way in LEAD_INS]
)
def test_the_remaining_time_bounds_the_remaining_length_in_flight(underway: LeadIn, cells: float) -> None:
    assert length_bounds(AT_10_M_S, CELL_M, underway) == LengthBounds(0.0, pytest.approx(cells))


def test_the_early_bound_counts_from_the_edge_of_the_goal_cell() -> None:
    between = TimeBound(speed_m_s=10.0, after_s=80.0, within_s=120.0)
    found = length_bounds(between, CELL_M, LeadIn(60.0, 0.0, 0.0))
    assert found == LengthBounds(pytest.approx(4.0 + HALF_DIAGONAL_CELLS), pytest.approx(12.0))
    # After the early bound has passed, only the late bound is left.
    assert length_bounds(between, CELL_M, LeadIn(90.0, 0.0, 0.0)) == LengthBounds(0.0, pytest.approx(6.0))


def test_bounds_shorter_than_a_cell_close_but_never_cross() -> None:
    found = length_bounds(TimeBound(10.0, after_s=119.0, within_s=120.0), CELL_M, LeadIn(60.0, 0.0, 0.0))
    assert found.min_cells == found.max_cells == pytest.approx(12.0)


MISSES = [
    (3.0, 0.0, 1.0),
    (4.0, 0.0, 0.0),
    (7.0, 0.0, 0.0),
    (10.0, 0.0, 0.0),
    (12.5, 0.0, 2.5),
    (3.0, 5.0, 1.0),
    (9.0, 1.5, 0.5),
]


@pytest.mark.parametrize(("length", "lost", "missed"), MISSES)
def test_the_distance_of_a_length_from_its_bounds(length: float, lost: float, missed: float) -> None:
    assert LengthBounds(4.0, 10.0).misses_by(length, lost) == pytest.approx(missed)


ends = st.floats(0.0, 500.0)


@settings(derandomize=True, deadline=None, max_examples=examples(200))
@given(
    after_s=ends,
    lasts_s=st.one_of(ends, st.just(math.inf)),
    elapsed_s=ends,
    climb_m=st.floats(-5.0, 100.0),
    lead_m=st.floats(-40.0, 500.0),
    speed_m_s=st.floats(0.5, 35.0),
    spare=st.one_of(st.floats(0.0, 50.0), st.just(0.0)),
)
def test_bounds_are_ordered_and_a_margin_only_narrows_them(
    after_s: float,
    lasts_s: float,
    elapsed_s: float,
    climb_m: float,
    lead_m: float,
    speed_m_s: float,
    spare: float,
) -> None:
    arrival = TimeBound(speed_m_s, after_s, after_s + lasts_s)
    underway = LeadIn(elapsed_s, climb_m, lead_m)
    found = length_bounds(arrival, CELL_M, underway)
    assert 0.0 <= found.min_cells <= found.max_cells
    narrower = found.with_reserve(spare)
    assert found.min_cells == narrower.min_cells <= narrower.max_cells <= found.max_cells
    if not math.isinf(found.max_cells) and found.max_cells > 0.0:
        # If any length is left, the longest route arrives exactly at the late bound.
        assert underway.arrives_s(arrival, found.max_cells * CELL_M) == pytest.approx(arrival.within_s)
