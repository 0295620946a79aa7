"""Closest approach of flights: hand-computed values and samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_trajectories import flights

from swarmctl.agent.traffic.separation.approach import Limits, closest, intervals, nearest
from swarmctl.agent.traffic.separation.conflicts import conflicts
from swarmctl.agent.traffic.separation.trajectory import Trajectory, extrapolate

LIMITS = Limits(20.0, 5.0)


def test_vehicles_that_cross_at_right_angles_at_one_height() -> None:
    east = extrapolate((-100.0, 0.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
    north = extrapolate((0.0, -100.0, 40.0), (0.0, 10.0, 0.0), 0.0, 20.0)
    at = closest(east, north, LIMITS)
    assert at is not None
    assert (at.t_s, at.distance_m) == pytest.approx((10.0, 0.0))
    # Both vehicles are at x from the middle, so their distance is √2·x: 20 m at x = 14.14 m.
    ((begin_s, end_s),) = intervals(east, north, LIMITS)
    assert (begin_s, end_s) == pytest.approx((10.0 - math.sqrt(2.0), 10.0 + math.sqrt(2.0)))


def test_a_climb_through_the_height_of_another() -> None:
    still = extrapolate((0.0, 0.0, 40.0), (0.0, 0.0, 0.0), 0.0, 100.0)
    climbs = extrapolate((10.0, 0.0, 0.0), (0.0, 0.0, 2.5), 0.0, 100.0)
    at = closest(still, climbs, LIMITS)
    assert at is not None
    # At equal shares of both limits a smaller height difference changes nothing: 10 of 20 m, 2.5 of 5.
    assert (at.horizontal_m, at.vertical_m, at.t_s) == pytest.approx((10.0, 2.5, 15.0))
    assert intervals(still, climbs, LIMITS) == (pytest.approx((14.0, 18.0)),)


def test_vehicles_at_the_limits_are_not_too_close() -> None:
    one = extrapolate((0.0, 0.0, 40.0), (5.0, 0.0, 0.0), 0.0, 10.0)
    assert intervals(one, extrapolate((0.0, 20.0, 40.0), (5.0, 0.0, 0.0), 0.0, 10.0), LIMITS) == ()
    assert intervals(one, extrapolate((0.0, 0.0, 45.0), (5.0, 0.0, 0.0), 0.0, 10.0), LIMITS) == ()
    assert intervals(one, extrapolate((0.0, 19.9, 44.9), (5.0, 0.0, 0.0), 0.0, 10.0), LIMITS) == (
        (0.0, 10.0),
    )


def test_time_alone_separates() -> None:
    one = extrapolate((0.0, 0.0, 40.0), (10.0, 0.0, 0.0), 0.0, 10.0)
    assert intervals(one, one.later(2.1), LIMITS) == ()
    assert closest(one, one.later(10.5), LIMITS) is None
    assert intervals(one, one.later(1.9), LIMITS) == (pytest.approx((1.9, 10.0)),)


@pytest.mark.parametrize("times_s", [(1.0, 1.0), (0.0, math.nan), (0.0, 1.0, 2.0)])
def test_an_invalid_trajectory_is_refused(times_s: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="expected"):
        Trajectory(times_s, ((0.0, 0.0, 0.0),) * 2).checked()


def sampled(a: Trajectory, b: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times when both are in the air, and their distances."""
    begin_s, end_s = max(a.times_s[0], b.times_s[0]), min(a.times_s[-1], b.times_s[-1])
    t = np.linspace(begin_s, end_s, 300) if begin_s <= end_s else np.empty(0)
    both = [(p, q) for x in t if (p := a.at(x)) is not None and (q := b.at(x)) is not None]
    h = np.array([math.dist(p[:2], q[:2]) for p, q in both])
    v = np.array([abs(p[2] - q[2]) for p, q in both])
    return t, h, v


@given(flights(), flights())
def test_no_sample_is_closer_than_the_closest(a: Trajectory, b: Trajectory) -> None:
    t, h, v = sampled(a, b)
    at = closest(a, b, LIMITS)
    if at is None:
        assert t.size == 0
        return
    least = LIMITS.share(at.horizontal_m, at.vertical_m)
    assert np.maximum(h / LIMITS.horizontal_m, v / LIMITS.vertical_m).min() >= least - 1e-9


@given(flights(), flights())
def test_samples_are_too_close_within_the_intervals_and_not_outside(a: Trajectory, b: Trajectory) -> None:
    t, h, v = sampled(a, b)
    times = intervals(a, b, LIMITS)
    share = np.maximum(h / LIMITS.horizontal_m, v / LIMITS.vertical_m)
    for x, kept in zip(t, share, strict=True):
        inside = any(begin < x < end for begin, end in times)
        if abs(kept - 1.0) > 1e-6 and x not in (t[0], t[-1]):
            assert inside == (kept < 1.0)


@given(flights(), st.tuples(st.integers(-60, 60), st.integers(-60, 60)))
def test_the_nearest_place_of_a_flight_is_on_it_and_no_sample_is_nearer(
    flight: Trajectory, point: tuple[int, int]
) -> None:
    place = flight.nearest(point)
    on = [leg.at(t) for leg in flight.segments() for t in np.linspace(leg.begin_s, leg.end_s, 200)]
    longest_m = max(math.dist(leg.a, leg.b) for leg in flight.segments())
    assert min(math.dist(place, at) for at in on) <= longest_m / 199
    assert min(math.dist(point, at[:2]) for at in on) >= math.dist(point, place[:2]) - 1e-9


@given(st.lists(flights(), min_size=2, max_size=6))
def test_the_conflicts_of_many_flights_are_those_of_all_pairs(swarm: list[Trajectory]) -> None:
    numbered = dict(enumerate(swarm, start=1))
    found = conflicts(numbered, LIMITS)
    every = {
        (i, j) for i in numbered for j in numbered if i < j and intervals(numbered[i], numbered[j], LIMITS)
    }
    assert {(c.uav, c.other) for c in found} == every
    assert list(found) == sorted(found, key=lambda c: c.begin_s)
    for c in found:
        assert LIMITS.share(c.closest.horizontal_m, c.closest.vertical_m) < 1.0
        assert c.begin_s <= c.closest.t_s <= c.end_s


@given(flights(), flights())
def test_the_nearest_of_two_segments_is_the_least_distance(a: Trajectory, b: Trajectory) -> None:
    one, other = next(a.segments()), next(b.segments())
    at = nearest(one, other)
    begin_s, end_s = max(one.begin_s, other.begin_s), min(one.end_s, other.end_s)
    if at is None:
        assert end_s < begin_s
        return
    for t in np.linspace(begin_s, end_s, 100):
        assert math.dist(one.at(t), other.at(t)) >= at.distance_m - 1e-9
