"""Whether planned flights may meet: numbers by hand, against sampling, and who of two gives way."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from drawn_trajectories import flights
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.traffic.separation.approach import Limits, intervals
from swarmctl.agent.traffic.separation.clash import LEVEL_M, find_clashes
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory, extrapolate
from swarmctl.agent.traffic.separation.watch import gives_way_to

LIMITS = Limits(20.0, 5.0)


def met(own: Trajectory, *others: Trajectory, slack_s: float = 2.0) -> list[int]:
    known = dict(enumerate(others, start=1))
    return [clash.other for clash in find_clashes(own, known, LIMITS, slack_s)]


EAST = extrapolate((-100.0, 0.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
NORTH = extrapolate((0.0, -100.0, 40.0), (0.0, 10.0, 0.0), 0.0, 20.0)


@pytest.mark.parametrize(("later_s", "is_met"), [(0.0, True), (4.7, True), (4.9, False), (-4.9, False)])
def test_who_crosses_behind_may_be_met_if_times_shift(later_s: float, is_met: bool) -> None:
    """10 m/s at right angles: √2·10 m nearer than it was for each second less between them, so 20 m are kept
    from 2.83 s on, and with 2 s of slack from 4.83 s on."""
    assert bool(met(EAST, NORTH.later(later_s))) is is_met


def test_side_by_side_they_do_not_meet_however_times_shift() -> None:
    beside = extrapolate((-100.0, 21.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
    assert met(EAST, beside) == []
    assert met(EAST, extrapolate((-100.0, 19.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)) == [1]


def test_who_stands_is_where_it_is_at_any_time() -> None:
    assert met(EAST, extrapolate((0.0, 21.0, 40.0), (0.0, 0.0, 0.0), 0.0, 20.0)) == []
    assert met(EAST, extrapolate((0.0, 21.0, 40.0), (0.0, 0.0, 0.0), 30.0, 20.0)) == []


def test_heights_kept_to_the_limit_are_kept() -> None:
    assert met(EAST, extrapolate((0.0, -100.0, 45.0), (0.0, 10.0, 0.0), 0.0, 20.0)) == []
    assert met(EAST, extrapolate((0.0, -100.0, 45.0 - LEVEL_M / 2), (0.0, 10.0, 0.0), 0.0, 20.0)) == []
    assert met(EAST, extrapolate((0.0, -100.0, 44.0), (0.0, 10.0, 0.0), 0.0, 20.0)) == [1]


def test_the_soonest_comes_first_and_says_when() -> None:
    late = extrapolate((80.0, -180.0, 40.0), (0.0, 10.0, 0.0), 0.0, 20.0)
    known = {1: late, 2: NORTH}
    first, second = find_clashes(EAST, known, LIMITS)
    assert (first.other, second.other) == (2, 1)
    assert 5.0 < first.at_s < 10.0 < second.at_s < 18.0


def sampled(a: Trajectory, b: Trajectory, slack_s: float) -> float:
    """The least share of the limits kept by samples of the two that are no farther apart in time."""
    t, u = (np.linspace(f.times_s[0], f.times_s[-1], 60) for f in (a, b))
    p, q = np.array([a.at(x) for x in t])[:, None], np.array([b.at(x) for x in u])[None]
    over_m, high_m = np.hypot(*np.moveaxis(p[..., :2] - q[..., :2], 2, 0)), np.abs(p[..., 2] - q[..., 2])
    share = np.maximum(over_m / LIMITS.horizontal_m, high_m / (LIMITS.vertical_m - LEVEL_M))
    return float(share[np.abs(t[:, None] - u[None]) <= slack_s].min(initial=np.inf))


@given(flights(), flights(), st.floats(0.0, 4.0))
def test_they_meet_where_samples_that_are_off_by_no_more_do(
    a: Trajectory, b: Trajectory, slack_s: float
) -> None:
    if sampled(a, b, slack_s) < 1.0 - 1e-9:
        assert met(a, b, slack_s=slack_s) == met(b, a, slack_s=slack_s) == [1]


@given(flights(), flights(), st.floats(0.0, 4.0))
def test_they_meet_nowhere_where_samples_keep_far_apart(a: Trajectory, b: Trajectory, slack_s: float) -> None:
    # A second and a half is more than lies between samples of both; they fly up to 170 m/s.
    if sampled(a, b, slack_s + 1.5) > 8.0:
        assert met(a, b, slack_s=slack_s) == []


@given(flights(), flights(), st.floats(0.0, 4.0))
def test_who_is_out_of_the_others_bounds_needs_no_closer_look(
    a: Trajectory, b: Trajectory, slack_s: float
) -> None:
    reach = (slack_s, LIMITS.horizontal_m, LIMITS.horizontal_m, LIMITS.vertical_m)
    is_within = Bounds.of(a).is_within(Bounds.of(b), reach)
    assert is_within is Bounds.of(b).is_within(Bounds.of(a), reach)
    if not is_within:
        assert met(a, b, slack_s=slack_s) == []
        assert intervals(a, b, LIMITS) == ()


def test_of_some_more_is_kept() -> None:
    beside = extrapolate((-100.0, 25.0, 40.0), (10.0, 0.0, 0.0), 0.0, 20.0)
    assert find_clashes(EAST, {1: beside}, LIMITS, 2.0) == ()
    (found,) = find_clashes(EAST, {1: beside}, LIMITS, 2.0, {1: Limits(30.0, 5.0)})
    assert found.other == 1


standings = st.tuples(st.booleans(), st.integers(1, 254))


@given(st.lists(standings, min_size=2, max_size=3, unique_by=lambda s: s[1]))
def test_of_two_that_meet_exactly_one_gives_way_and_of_three_one_has_the_way(
    swarm: list[tuple[bool, int]],
) -> None:
    for one, other in permutations(swarm, 2):
        both_fixed = not one[0] and not other[0]
        assert (gives_way_to(one, other) != gives_way_to(other, one)) is not both_fixed
    if any(may for may, _ in swarm):
        ranks = sorted(sum(gives_way_to(one, other) for other in swarm if other != one) for one in swarm)
        n_fixed = sum(not may for may, _ in swarm)
        assert ranks == sorted([0] * n_fixed + list(range(n_fixed, len(swarm))))
