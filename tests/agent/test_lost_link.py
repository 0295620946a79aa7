"""Failsafe: lost link."""

from __future__ import annotations

from typing import Any

import pytest
from failsafe_facts import RuleRunner, at, facts

from swarmctl.agent.failsafes import lost_link, taken_over
from swarmctl.agent.failsafes.base import DemandKind


@pytest.mark.parametrize(
    ("does", "part"),
    [
        ("continue", "mission"),
        ("hold", "holds after 10 s"),
        ("return", "returns after 10 s"),
        ("land", "after 10 s"),
    ],
)
def test_the_warning_announces_the_configured_reaction(does: Any, part: str) -> None:
    demand = RuleRunner(lost_link, does=does, after_s=10.0)(0.0, facts(lost=True))
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    assert "preflight.policy.lost_link" in demand.reason
    assert part in demand.reason


@pytest.mark.parametrize(
    ("mode", "role", "does", "part"),
    [
        ("GUIDED", "hold", "continue", "GUIDED"),
        ("RTL", "return", "continue", "RTL"),
        ("LAND", "land", "continue", "LAND"),
        ("LOITER", "other", "continue", "LOITER"),
        ("", "", "continue", ""),
        ("RTL", "return", "return", "RTL"),
        ("GUIDED", "hold", "return", "10 s"),
        ("OFFBOARD", "setpoints", "return", "OFFBOARD"),
    ],
)
def test_the_warning_names_the_last_mode_or_the_reaction(mode: str, role: Any, does: Any, part: str) -> None:
    vehicle = at(0.0, 0.0, mode=mode, mode_role=role)
    demand = RuleRunner(lost_link, does=does, after_s=10.0)(0.0, facts(vehicle, activity="hold", lost=True))
    assert demand is not None
    assert part in demand.reason
    assert ("10 s" in demand.reason) is (part == "10 s")


def test_the_rule_is_silent_with_a_link_or_on_the_ground() -> None:
    rule = RuleRunner(lost_link)
    assert rule(0.0, facts()) is None
    assert rule(0.0, facts(lost=True, activity="ground")) is None


def test_an_old_mode_during_a_lost_link_is_not_a_takeover() -> None:
    rule = RuleRunner(taken_over)
    held = at(0.0, 0.0, mode="GUIDED", mode_role="hold")
    rule(0.0, facts(held))
    assert rule(60.0, facts(held, lost=True)) is None
