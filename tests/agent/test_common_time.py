"""The common arrival time: the slowest vehicle sets the time, and each vehicle computes its speed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.arrival.common_time import (
    LEAST_SHARE,
    ArrivalGroup,
    agreed_arrival_s,
    due_s,
    least_m_s,
    speed_for,
)
from swarmctl.agent.failsafes.not_following import MAX_STILL_M_S

RANK = {1: 0, 4: 1, 9: 2}


def test_all_vehicles_are_due_at_the_earliest_arrival_of_the_slowest() -> None:
    group, earliest_s = ArrivalGroup(RANK), {1: 60.0, 4: 95.0, 9: 80.0}
    assert [due_s(group, uav, earliest_s) for uav in RANK] == [95.0, 95.0, 95.0]


def test_with_spacing_vehicles_are_due_one_after_the_other() -> None:
    group, earliest_s = ArrivalGroup(RANK, spacing_s=10.0), {1: 60.0, 4: 95.0, 9: 80.0}
    assert [due_s(group, uav, earliest_s) for uav in RANK] == [85.0, 95.0, 105.0]


times = st.floats(-50.0, 500.0)


@given(st.fixed_dictionaries(dict.fromkeys(RANK, times)), st.floats(0.0, 60.0))
def test_no_vehicle_is_due_before_its_earliest_arrival_and_the_slowest_exactly_then(
    earliest_s: dict[int, float], spacing_s: float
) -> None:
    group = ArrivalGroup(RANK, spacing_s)
    waits = [due_s(group, uav, earliest_s) - at_s for uav, at_s in earliest_s.items()]
    assert min(waits) == pytest.approx(0.0, abs=1e-9)


@given(times, times, times)
def test_a_vehicle_that_receives_more_vehicles_is_never_due_earlier(a: float, b: float, c: float) -> None:
    group = ArrivalGroup(RANK, 5.0)
    assert agreed_arrival_s(group, {1: a, 4: b}) <= agreed_arrival_s(group, {1: a, 4: b, 9: c})


@pytest.mark.parametrize(
    ("due", "speed"),
    [(100.0, 10.0), (200.0, 5.0), (50.0, 10.0), (1e6, LEAST_SHARE * 10.0)],
    ids=["just in time", "half as fast", "late at full speed", "below the least speed"],
)
def test_the_speed_meets_the_arrival_time(due: float, speed: float) -> None:
    assert speed_for(lambda m_s: 1000.0 / m_s, due, 10.0) == pytest.approx(speed, abs=1e-3)


@pytest.mark.parametrize("most_m_s", [0.9, 1.5, 2.5, 4.0])
def test_the_least_speed_is_well_above_a_standstill(most_m_s: float) -> None:
    assert most_m_s >= least_m_s(most_m_s) >= 1.8 * MAX_STILL_M_S
    assert speed_for(lambda m_s: 1000.0 / m_s, 1e6, most_m_s) == least_m_s(most_m_s)
