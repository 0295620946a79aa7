"""Failsafe: not following the route."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import pytest
from failsafe_facts import RuleRunner, at, facts, route_over
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.failsafes import not_following
from swarmctl.agent.failsafes.base import DemandKind
from swarmctl.core.planar import distance_to_track

LIMITS = {"metres": 50.0, "seconds": 10.0}


def test_a_vehicle_off_its_route_returns() -> None:
    rule = RuleRunner(not_following, **LIMITS)
    assert rule(0.0, facts()) is None
    for second in range(1, 11):
        assert rule(float(second), facts(at(200.0, 51.0))) is None
    demand = rule(11.0, facts(at(200.0, 51.0)))
    assert demand is not None
    assert demand.kind is DemandKind.RETURN
    assert all(value in demand.reason for value in ("51 m", "50 m", "10 s"))


def test_a_gust_raises_no_demand() -> None:
    rule = RuleRunner(not_following, **LIMITS)
    for second in range(60):
        north_m = 80.0 if second % 8 else 0.0
        assert rule(float(second), facts(at(200.0, north_m))) is None


def test_a_standstill_during_the_mission_is_reported() -> None:
    rule = RuleRunner(not_following, **LIMITS, action="warn")
    stands = at(200.0, 0.0, ground_speed_m_s=0.1)
    assert rule(0.0, facts(stands)) is None
    demand = rule(10.0, facts(stands))
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    assert "AUTO" in demand.reason
    assert "10 s" in demand.reason
    assert rule(11.0, facts(at(200.0, 0.0))) is None


@pytest.mark.parametrize("changes", [{"activity": "hold"}, {"mission": None}, {"lost": True}])
def test_the_rule_is_silent_without_a_mission_or_link(changes: dict[str, object]) -> None:
    rule = RuleRunner(not_following, **LIMITS)
    for second in range(60):
        assert rule(float(second), facts(at(0.0, 900.0, ground_speed_m_s=0.0), **changes)) is None


def test_a_new_plan_begins_where_the_vehicle_is() -> None:
    rule = RuleRunner(not_following, **LIMITS)
    for second in range(10):
        rule(float(second), facts(at(200.0, 200.0)))
    for second in range(10, 60):
        there = facts(
            at(200.0 - 2.0 * (second - 10), 200.0 - 4.0 * (second - 10)),
            mission=route_over(2, (100.0, 0.0)),
        )
        assert rule(float(second), there) is None


COORDINATES = st.floats(-1000.0, 1000.0)
POINTS = st.tuples(COORDINATES, COORDINATES)


@given(st.lists(POINTS, min_size=1, max_size=6), POINTS)
def test_the_distance_to_a_track_is_the_least_to_any_of_its_points(
    track: list[tuple[float, float]], here: tuple[float, float]
) -> None:
    found = distance_to_track(here, track)
    legs = list(pairwise(track)) or [(track[0], track[0])]
    sampled = min(
        hypot(a[0] + k * (b[0] - a[0]) - here[0], a[1] + k * (b[1] - a[1]) - here[1])
        for a, b in legs
        for k in (i / 200 for i in range(201))
    )
    longest = max(hypot(b[0] - a[0], b[1] - a[1]) for a, b in legs)
    assert sampled - longest / 200 - 1e-6 <= found <= sampled + 1e-6
