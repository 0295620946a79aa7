"""Proximity alarms: raised at once, ended with hysteresis."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.trajectory import extrapolate
from swarmctl.agent.traffic.separation.watch import (
    ProximityAlarm,
    SeparationRules,
    clear_height_m,
    update_alarms,
)

RULES = SeparationRules(Limits(10.0, 3.0), look_ahead_s=10.0)


def head_on(apart_m: float, aside_m: float = 0.0) -> tuple[ProximityAlarm, ...]:
    return step((), apart_m, aside_m, 0.0)


def step(
    alarms: tuple[ProximityAlarm, ...], apart_m: float, aside_m: float, now_s: float
) -> tuple[ProximityAlarm, ...]:
    own = extrapolate((0.0, 0.0, 40.0), (5.0, 0.0, 0.0), now_s, RULES.look_ahead_s)
    other = extrapolate((apart_m, aside_m, 40.0), (-5.0, 0.0, 0.0), now_s, RULES.look_ahead_s)
    return update_alarms(alarms, own, {7: other}, RULES, now_s)


def test_an_alarm_is_raised_for_a_violation_within_the_look_ahead_time() -> None:
    assert head_on(115.0) == ()
    (alarm,) = head_on(105.0)
    assert (alarm.other, alarm.clear_since_s) == (7, None)
    assert alarm.approach.t_s == pytest.approx(10.0)
    assert alarm.approach.distance_m == pytest.approx(5.0)
    assert head_on(50.0, aside_m=10.5) == ()


def test_an_alarm_ends_with_hysteresis() -> None:
    alarms = head_on(50.0, aside_m=9.0)
    alarms = step(alarms, 45.0, 12.0, 1.0)
    assert alarms[0].clear_since_s is None  # outside the limits by too little
    alarms = step(alarms, 40.0, 16.0, 2.0)
    assert alarms[0].clear_since_s == 2.0
    alarms = step(alarms, 35.0, 14.0, 3.0)
    assert alarms[0].clear_since_s is None  # the time begins again
    for now_s in (4.0, 5.0):
        alarms = step(alarms, 30.0, 16.0, now_s)
        assert len(alarms) == 1
    assert step(alarms, 30.0, 16.0, 6.0) == ()


@pytest.mark.parametrize(("up_m", "raises", "stays_close"), [(2.6, True, True), (2.8, False, False)])
def test_heights_are_compared_with_the_accuracy_of_held_heights(
    up_m: float, raises: bool, stays_close: bool
) -> None:
    """A flight that the trajectory check takes as clear raises no alarm, and causes no hold by an old one."""
    own = extrapolate((0.0, 0.0, 40.0), (5.0, 0.0, 0.0), 0.0, 10.0)
    above = extrapolate((40.0, 0.0, 40.0 + up_m), (-5.0, 0.0, 0.0), 0.0, 10.0)
    assert bool(update_alarms((), own, {7: above}, RULES, 0.0)) is raises
    (alarm,) = update_alarms(head_on(50.0), own, {7: above}, RULES, 0.0)
    assert alarm.is_close is stays_close


def test_an_alarm_for_a_vehicle_without_telemetry_ends() -> None:
    alarms = head_on(50.0)
    own = extrapolate((0.0, 0.0, 40.0), (5.0, 0.0, 0.0), 1.0, 10.0)
    alarms = update_alarms(alarms, own, {}, RULES, 1.0)
    assert len(alarms) == 1
    assert update_alarms(alarms, own, {}, RULES, 3.0) == ()


@given(st.floats(10.0, 100.0), st.lists(st.floats(0.0, 120.0), max_size=8))
def test_the_evasive_height_is_clear_of_all(height_m: float, others_m: list[float]) -> None:
    found_m = clear_height_m(height_m, others_m, RULES.limits)
    assert found_m >= height_m
    assert all(abs(found_m - other_m) >= RULES.limits.vertical_m for other_m in others_m)
