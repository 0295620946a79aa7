"""Failsafe: GPS loss."""

from __future__ import annotations

import pytest
from failsafe_facts import RuleRunner, at, facts

from swarmctl.agent.failsafes import gps_loss
from swarmctl.agent.failsafes.base import DemandKind, FailsafeFacts
from swarmctl.core.records import replace

NO_FIX = at(0.0, 0.0, gps_ok=False)


def test_gps_loss_warns_and_then_lands() -> None:
    rule = RuleRunner(gps_loss, seconds=2.0, land_s=20.0)
    kinds = []
    for second in range(22):
        demand = rule(float(second), facts(NO_FIX))
        kinds.append(None if demand is None else demand.kind)
    assert kinds == [None] * 2 + [DemandKind.WARN] * 18 + [DemandKind.LAND] * 2


def test_a_recovered_fix_ends_the_warning_but_not_the_landing() -> None:
    rule = RuleRunner(gps_loss, seconds=2.0, land_s=20.0)
    for second in range(15):
        rule(float(second), facts(NO_FIX))
    assert rule(15.0, facts(at(0.0, 0.0, gps_ok=True))) is None
    for second in range(16, 37):
        rule(float(second), facts(NO_FIX))
    demand = rule(37.0, facts(at(0.0, 0.0, gps_ok=True)))
    assert demand is not None
    assert demand.kind is DemandKind.LAND


def test_the_rule_is_silent_without_a_receiver_on_the_ground_or_with_a_lost_link() -> None:
    rule = RuleRunner(gps_loss, seconds=0.0, land_s=1.0)
    for second in range(10):
        assert rule(float(second), facts(at(0.0, 0.0, gps_ok=None))) is None
        assert rule(float(second), facts(NO_FIX, lost=True)) is None
        assert rule(float(second), facts(NO_FIX, activity="ground")) is None


def kinds_of(
    rule: RuleRunner, known: FailsafeFacts, seconds: range, **stamps: float
) -> dict[int, DemandKind]:
    """Return the second at which each demand first appears."""
    found: dict[int, DemandKind] = {}
    for second in seconds:
        demand = rule(float(second), known, **stamps)
        if demand is not None and demand.kind not in found.values():
            found[second] = demand.kind
    return found


def test_one_report_without_a_fix_counts_once() -> None:
    assert kinds_of(RuleRunner(gps_loss), facts(NO_FIX), range(60), status_s=0.0) == {}


@pytest.mark.parametrize("gps_ok", [False, None])
def test_a_vehicle_without_a_position_lands(gps_ok: bool | None) -> None:
    blind = facts(at(0.0, 0.0, gps_ok=gps_ok, lat_deg=None, lon_deg=None))
    found = kinds_of(RuleRunner(gps_loss), blind, range(40), position_s=0.0, status_s=0.0)
    assert found == {2: DemandKind.WARN, 20: DemandKind.LAND}


def test_a_vehicle_with_a_fix_but_no_position_returns_or_else_lands() -> None:
    blind = facts(at(0.0, 0.0, gps_ok=True, lat_deg=None, lon_deg=None))
    found = kinds_of(RuleRunner(gps_loss), blind, range(60), position_s=0.0)
    assert found == {2: DemandKind.WARN, 20: DemandKind.RETURN, 40: DemandKind.LAND}
    comes = facts(replace(blind.vehicle, mode="RTL", mode_role="return"), activity="return")
    found = kinds_of(RuleRunner(gps_loss), comes, range(200), position_s=0.0)
    assert DemandKind.LAND not in found.values()


def test_a_recovered_position_ends_the_warning() -> None:
    rule, blind = RuleRunner(gps_loss), facts(at(0.0, 0.0, gps_ok=True, lat_deg=None, lon_deg=None))
    rule(0.0, blind)
    demand = rule(10.0, blind)
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    assert rule(11.0, facts(at(0.0, 0.0, gps_ok=True))) is None


def test_a_lost_link_does_not_count_as_a_missing_position() -> None:
    rule, blind = RuleRunner(gps_loss), facts(at(0.0, 0.0, gps_ok=True, lat_deg=None, lon_deg=None))
    rule(0.0, facts(at(0.0, 0.0)))
    assert rule(5.0, facts(at(0.0, 0.0), lost=True)) is None
    assert rule(60.0, blind, position_s=0.0) is None
    assert rule(61.0, facts(at(0.0, 0.0, gps_ok=True))) is None
