"""Least distance of a flight, from samples in any order of vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.report.flown_separation import FlownSeparation

LIMITS = Limits(10.0, 3.0)


def test_the_least_distance_lies_between_two_samples() -> None:
    flown = FlownSeparation(LIMITS)
    for t in range(11):
        flown.add_position(1, float(t), (-52.0 + 10.0 * t, 0.0, 40.0))
        flown.add_position(2, t + 0.5, (0.0, 4.0, 46.0))
    assert flown.nearest is not None
    assert flown.between == (1, 2)
    assert flown.nearest.t_s == pytest.approx(5.2)
    assert (flown.nearest.horizontal_m, flown.nearest.vertical_m) == pytest.approx((4.0, 6.0))
    assert flown.too_close_s == {}


def test_time_below_the_limits_is_counted_once() -> None:
    flown = FlownSeparation(LIMITS)
    for t in range(21):
        flown.add_position(1, 0.5 * t, (-50.0 + 5.0 * t, 0.0, 40.0))
        flown.add_position(2, 0.5 * t + 0.2, (0.0, 0.0, 41.0))
    assert flown.too_close_s == {(1, 2): pytest.approx(2.0)}  # 20 m at 10 m/s


def test_gaps_in_the_samples_are_not_interpolated() -> None:
    flown = FlownSeparation(LIMITS)
    for t in range(8):
        if t in (0, 1, 6, 7):
            flown.add_position(1, float(t), (-30.0 + 10.0 * t, 0.0, 40.0))
        flown.add_position(2, float(t), (0.0, 0.0, 40.0))
    assert flown.nearest is not None
    assert flown.nearest.distance_m == pytest.approx(20.0)


@given(st.integers(0, 2**32 - 1))
def test_no_pair_of_samples_was_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flown, t = FlownSeparation(LIMITS), np.sort(rng.uniform(0.0, 20.0, 120))
    paths = rng.uniform(-60.0, 60.0, (4, 3)), rng.uniform(-6.0, 6.0, (4, 3))
    least_m = math.inf
    uavs = rng.integers(0, 4, t.size)
    for when, uav in zip(t, uavs, strict=True):
        flown.add_position(int(uav) + 1, float(when), tuple(paths[0][uav] + paths[1][uav] * when))
    spans = {u: (t[uavs == u].min(), t[uavs == u].max()) for u in set(uavs.tolist())}
    gaps = {u: np.diff(t[uavs == u]).max(initial=0.0) for u in spans}
    if max(gaps.values()) > 3.0:
        return
    for a in spans:
        for b in spans:
            begin, end = max(spans[a][0], spans[b][0]), min(spans[a][1], spans[b][1])
            if a < b and begin < end:
                when = np.linspace(begin, end, 400)[:, None]
                apart = (paths[0][a] - paths[0][b]) + (paths[1][a] - paths[1][b]) * when
                least_m = min(least_m, float(np.linalg.norm(apart, axis=1).min()))
    if not math.isinf(least_m):
        assert flown.nearest is not None
        assert flown.nearest.distance_m == pytest.approx(least_m, abs=0.4)
        assert flown.nearest.distance_m <= least_m + 1e-9
