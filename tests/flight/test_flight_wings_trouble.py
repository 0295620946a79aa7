"""Whole flights with faults of a PX4 fixed wing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from flights import Ui, away_m, coded, fly, winged
from trouble import outage, sagging

from swarmctl.agent.replan.landing_pattern import ROLL_OUT_M
from swarmctl.config.scenario import Scenario
from swarmctl.report import record

pytestmark = [pytest.mark.virtual, pytest.mark.full]


def pair(**sections: Any) -> Scenario:
    """Return a copter and a fixed wing, in this order."""
    return winged(simulate={"autopilot": ["ardupilot", "px4plane"]}, **sections)


def test_a_fixed_wing_with_a_low_battery_lands_at_home(tmp_path: Path) -> None:
    trouble, scenario = sagging(0.2), pair()
    ui = Ui()
    report = fly(scenario, tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["Mission", "Return"]
    assert coded(ui.said, "uav2", "low-battery")
    assert report.states[2].outcome.startswith("battery at 20 %")
    assert report.states[2].outcome.endswith("; disarmed")
    assert away_m(report, 2, scenario.specs[1].start) < ROLL_OUT_M
    assert report.states[1].outcome == "arrived"
    assert record.replay(tmp_path / "run.mcap").difference == ""


def test_a_fixed_wing_with_a_critical_battery_lands_at_its_nearest_landing(tmp_path: Path) -> None:
    trouble, scenario = sagging(0.099), pair()
    report = fly(scenario, tmp_path, trouble=trouble)
    assert trouble.modes[2] == ["Mission", "Return", "Mission"]
    state = report.states[2]
    # The nearest landing is the one in its goal cell, so the vehicle has arrived.
    assert (state.outcome, state.given_up) == ("arrived", True)
    assert state.plans.mission is not None
    approach = state.plans.mission.plan.approach
    assert approach is not None
    places = [scenario.specs[1].start, approach.touchdown]
    assert min(away_m(report, 2, place) for place in places) < ROLL_OUT_M


def test_a_fixed_wing_without_link_lands_at_home_by_its_own_failsafe(tmp_path: Path) -> None:
    policy = {"lost_link": "return", "lost_link_after_s": 10}
    trouble, scenario = outage(25.0), pair(preflight={"policy": policy})
    report = fly(scenario, tmp_path, trouble=trouble)
    assert trouble.modes[2] == ["Mission", "Hold", "Return"]
    assert report.states[2].phase == "released"
    assert away_m(report, 2, scenario.specs[1].start) < ROLL_OUT_M
    assert report.states[1].outcome == "arrived"


def test_a_fixed_wing_at_the_emergency_battery_level_is_left_to_its_own_failsafe(tmp_path: Path) -> None:
    """PX4 then lands where it is; no order contradicts it."""
    trouble = sagging(0.04)
    report = fly(pair(rules={"low_battery": None}), tmp_path, trouble=trouble)
    assert trouble.modes[2][-1] == "Land"
    assert report.states[2].phase == "released"
    assert not report.states[2].vehicle.armed
