"""Failsafe: low battery."""

from __future__ import annotations

import pytest
from failsafe_facts import RuleRunner, at, facts
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from swarmctl.agent.failsafes import low_battery
from swarmctl.agent.failsafes.base import STRENGTH, DemandKind


def test_a_low_battery_demands_a_return_and_then_a_landing() -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, land_percent=10.0, seconds=3.0)
    kinds = {}
    for second, percent in enumerate([30, 26, 25, 24, 24, 24, 24, 9, 9, 9, 9]):
        demand = rule(float(second), facts(at(0.0, 0.0, battery_percent=percent)))
        kinds[second] = None if demand is None else demand.kind
    assert [kinds[s] for s in (5, 6, 9, 10)] == [None, DemandKind.RETURN, DemandKind.RETURN, DemandKind.LAND]


def test_a_voltage_dip_under_full_thrust_is_not_a_low_battery() -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, seconds=3.0)
    for second in range(60):
        percent = 20 if second % 3 else 30
        assert rule(float(second), facts(at(0.0, 0.0, battery_percent=percent))) is None


def test_one_report_of_a_low_charge_counts_once() -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, seconds=3.0)
    low = facts(at(0.0, 0.0, battery_percent=5))
    for quarters in range(240):
        assert rule(quarters / 4, low, status_s=0.0) is None
    demand = rule(61.0, low)
    assert demand is not None


def test_a_demand_survives_a_recovering_charge() -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, seconds=0.0)
    demand = rule(0.0, facts(at(0.0, 0.0, battery_percent=20)))
    assert demand is not None
    assert {"20", "25", "rules.low_battery"} <= set(demand.reason.split())
    assert rule(1.0, facts(at(0.0, 0.0, battery_percent=60))) == demand


def test_the_rule_is_silent_on_the_ground() -> None:
    rule = RuleRunner(low_battery, seconds=0.0)
    assert rule(0.0, facts(at(0.0, 0.0, battery_percent=1), activity="ground")) is None


def test_a_limit_of_0_never_acts() -> None:
    rule = RuleRunner(low_battery, return_percent=0.0, land_percent=0.0, seconds=0.0)
    assert rule(0.0, facts(at(0.0, 0.0, battery_percent=0))) is None


def test_a_landing_charge_above_the_return_charge_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"land_percent 20 .* return_percent 10"):
        low_battery.Params(return_percent=10.0, land_percent=20.0)


@given(st.lists(st.one_of(st.none(), st.integers(0, 100)), max_size=40))
def test_the_demand_never_weakens(charges: list[int | None]) -> None:
    rule, rank = RuleRunner(low_battery, seconds=2.0), -1
    for second, percent in enumerate(charges):
        demand = rule(float(second), facts(at(0.0, 0.0, battery_percent=percent)))
        now = -1 if demand is None else STRENGTH[demand.kind]
        assert now >= rank
        rank = now


@pytest.mark.parametrize(
    ("params", "percent", "urgent"),
    [
        ({}, 20, False),
        ({}, 19, True),
        ({"wait_percent": 0.0}, 24, True),
        ({"wait_percent": 50.0}, 10, False),
        ({"wait_percent": 50.0, "land_percent": 0.0}, 1, False),
    ],
)
def test_a_return_may_wait_above_the_waiting_charge(
    params: dict[str, float], percent: int, *, urgent: bool
) -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, seconds=0.0, **params)
    demand = rule(0.0, facts(at(0.0, 0.0, battery_percent=percent)))
    assert demand is not None
    assert (demand.kind, demand.urgent) == (DemandKind.RETURN, urgent)


def test_an_urgent_demand_stays_urgent() -> None:
    rule = RuleRunner(low_battery, return_percent=25.0, seconds=0.0)
    for second, percent in enumerate((24, 19, 24)):
        demand = rule(float(second), facts(at(0.0, 0.0, battery_percent=percent)))
    assert demand is not None
    assert demand.urgent
