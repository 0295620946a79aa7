"""Nothing is heard of a vehicle."""

from __future__ import annotations

from typing import Any

import pytest
from facts import Judged, at, facts

from swarmctl.agent.failsafes import lost_link, taken_over
from swarmctl.agent.failsafes.base import DemandKind


@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("continue", "it flies its mission to the end"),
        ("hold", "after 10 s it holds"),
        ("return", "after 10 s it returns"),
        ("land", "after 10 s it lands where it is"),
    ],
)
def test_it_is_said_what_was_agreed_before_the_take_off(does: Any, said: str) -> None:
    demand = Judged(lost_link, does=does, after_s=10.0)(0.0, facts(lost=True))
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    assert demand.why.endswith(f"by preflight.policy.lost_link {said}")


@pytest.mark.parametrize(
    ("mode", "role", "does", "said"),
    [
        ("GUIDED", "hold", "continue", "it holds on in mode GUIDED"),
        ("RTL", "return", "continue", "it goes on home in mode RTL"),
        ("LAND", "land", "continue", "it goes on down in mode LAND"),
        ("LOITER", "other", "continue", "it stays in mode LOITER"),
        ("", "", "continue", "it goes on with what it does"),
        ("RTL", "return", "return", "it goes on home in mode RTL"),
        ("GUIDED", "hold", "return", "after 10 s it returns"),
    ],
)
def test_it_is_said_of_what_it_was_doing(mode: str, role: Any, does: Any, said: str) -> None:
    vehicle = at(0.0, 0.0, mode=mode, mode_role=role)
    demand = Judged(lost_link, does=does, after_s=10.0)(0.0, facts(vehicle, doing="hold", lost=True))
    assert demand is not None
    assert demand.why.endswith(f"no order reaches it; by preflight.policy.lost_link {said}")


def test_heard_or_on_the_ground_there_is_nothing_to_say() -> None:
    rule = Judged(lost_link)
    assert rule(0.0, facts()) is None
    assert rule(0.0, facts(lost=True, doing="ground")) is None


def test_a_mode_that_was_heard_before_the_silence_is_nobodys_take_over() -> None:
    rule = Judged(taken_over)
    held = at(0.0, 0.0, mode="GUIDED", mode_role="hold")
    rule(0.0, facts(held))
    assert rule(60.0, facts(held, lost=True)) is None
