"""An order to hold and an order to resume, in whole flights."""

from __future__ import annotations

from pathlib import Path

import pytest
from flights import fly_with_commands, small, winged

from swarmctl.agent.state import ARRIVED
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder

pytestmark = pytest.mark.virtual


def winged_by(*autopilots: str) -> Scenario:
    return winged(simulate={"autopilot": list(autopilots)})


@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(small(simulate={"count": 2, "ready_s": 3.0}), id="ardupilot"),
        pytest.param(winged_by("arduplane", "px4"), id="arduplane-px4", marks=pytest.mark.full),
        pytest.param(winged_by("px4plane", "ardupilot"), id="px4plane-ardupilot", marks=pytest.mark.full),
    ],
)
def test_a_vehicle_arrives_after_a_hold_and_an_order_to_resume(scenario: Scenario, tmp_path: Path) -> None:
    hold, resume = GiveOrder(None, "hold"), GiveOrder(None, "resume")
    report, answers = fly_with_commands(scenario, tmp_path, (45.0, hold), (65.0, resume))
    assert [vehicle.outcome for answer in answers for vehicle in answer] == ["taken"] * 4
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 2
    assert all(state.plans.swaps.n_failed == 0 for state in report.states.values())
