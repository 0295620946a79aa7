"""Conflicts of planned flights: hand-computed values, samples and the rule of priority."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from random_trajectories import flights

from swarmctl.agent.traffic.separation.approach import Limits, intervals
from swarmctl.agent.traffic.separation.clash import HEIGHT_TOLERANCE_M, TIME_TOLERANCE_S, find_clashes
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory, extrapolate
from swarmctl.core.records import replace

LIMITS = Limits(20.0, 5.0)


def met(own: Trajectory, *others: Trajectory) -> list[int]:
    known = {uav: KnownFlight.predicted(flight) for uav, flight in enumerate(others, start=1)}
    return [clash.other for clash in find_clashes(own, known, LIMITS)]


EAST = extrapolate((-100.0, 0.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
NORTH = extrapolate((0.0, -100.0, 40.0), (0.0, 10.0, 0.0), 0.0, 20.0)


@pytest.mark.parametrize(("later_s", "is_met"), [(0.0, True), (4.7, True), (4.9, False), (-4.9, False)])
def test_a_later_crossing_clashes_within_the_time_tolerance(later_s: float, is_met: bool) -> None:
    """At 10 m/s and right angles each second of delay adds √2·10/2 m, so 2.83 s keep 20 m.

    With a tolerance of 2 s the vehicles need a delay of 4.83 s.
    """
    assert bool(met(EAST, NORTH.later(later_s))) is is_met


def test_parallel_flights_do_not_clash_at_any_time_shift() -> None:
    beside = extrapolate((-100.0, 21.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
    assert met(EAST, beside) == []
    assert met(EAST, extrapolate((-100.0, 19.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)) == [1]


def test_a_height_difference_of_the_limit_is_no_clash() -> None:
    assert met(EAST, extrapolate((0.0, -100.0, 45.0), (0.0, 10.0, 0.0), 0.0, 20.0)) == []
    assert (
        met(EAST, extrapolate((0.0, -100.0, 45.0 - HEIGHT_TOLERANCE_M / 2), (0.0, 10.0, 0.0), 0.0, 20.0))
        == []
    )
    assert met(EAST, extrapolate((0.0, -100.0, 44.0), (0.0, 10.0, 0.0), 0.0, 20.0)) == [1]


def test_the_soonest_clash_comes_first_with_its_time() -> None:
    late = extrapolate((80.0, -180.0, 40.0), (0.0, 10.0, 0.0), 0.0, 20.0)
    known = {1: KnownFlight.predicted(late), 2: KnownFlight.predicted(NORTH)}
    first, second = find_clashes(EAST, known, LIMITS)
    assert (first.other, second.other) == (2, 1)
    assert 5.0 < first.at_s < 10.0 < second.at_s < 18.0


def sampled(a: Trajectory, b: Trajectory, tolerance_s: float = TIME_TOLERANCE_S) -> float:
    """Return the least share of the limits over pairs of samples within the tolerance in time."""
    t, u = (np.linspace(f.times_s[0], f.times_s[-1], 60) for f in (a, b))
    p, q = np.array([a.at(x) for x in t])[:, None], np.array([b.at(x) for x in u])[None]
    over_m, high_m = np.hypot(*np.moveaxis(p[..., :2] - q[..., :2], 2, 0)), np.abs(p[..., 2] - q[..., 2])
    share = np.maximum(over_m / LIMITS.horizontal_m, high_m / (LIMITS.vertical_m - HEIGHT_TOLERANCE_M))
    return float(share[np.abs(t[:, None] - u[None]) <= tolerance_s].min(initial=np.inf))


@given(flights(), flights())
def test_a_clash_is_found_where_samples_within_the_tolerance_are_too_close(
    a: Trajectory, b: Trajectory
) -> None:
    if sampled(a, b) < 1.0 - 1e-9:
        assert met(a, b) == met(b, a) == [1]


@given(flights(), flights())
def test_no_clash_is_found_where_samples_stay_far_apart(a: Trajectory, b: Trajectory) -> None:
    # The margin covers the time between samples at up to 170 m/s.
    if sampled(a, b, TIME_TOLERANCE_S + 1.5) > 8.0:
        assert met(a, b) == []


@given(flights(), flights())
def test_flights_with_distant_bounds_do_not_clash(a: Trajectory, b: Trajectory) -> None:
    reach = (TIME_TOLERANCE_S, LIMITS.horizontal_m, LIMITS.horizontal_m, LIMITS.vertical_m)
    is_within = Bounds.of(a).wider(reach).meets(Bounds.of(b))
    assert is_within is Bounds.of(b).wider(reach).meets(Bounds.of(a))
    if not is_within:
        assert met(a, b) == []
        assert intervals(a, b, LIMITS) == ()


def test_an_uncertain_flight_has_wider_limits() -> None:
    beside = KnownFlight.predicted(extrapolate((-100.0, 25.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0))
    assert find_clashes(EAST, {1: beside}, LIMITS) == ()
    (found,) = find_clashes(EAST, {1: replace(beside, uncertainty_m=(10.0, 0.0))}, LIMITS)
    assert found.other == 1


@pytest.mark.parametrize(("later_s", "is_met"), [(40.0, True), (4.7, True), (-4.9, False)])
def test_a_vehicle_that_may_be_late_clashes_with_all_later_flights(later_s: float, is_met: bool) -> None:
    """A vehicle that may have stopped on its flight may also go on later, but it is no earlier than 2 s."""
    north = replace(KnownFlight.predicted(NORTH), may_be_late=True)
    found = find_clashes(EAST.later(later_s), {1: north}, LIMITS)
    assert bool(found) is is_met
