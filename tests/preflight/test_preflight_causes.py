"""Findings of preflight on whole vehicles, with their causes and remedies."""

from __future__ import annotations

from pathlib import Path

import pytest
from flights import Ui, fly, small
from preflight_facts import FIT
from rich.console import Console
from trouble import Trouble, interrupting

from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace
from swarmctl.flight.run import DEFAULT_OPTIONS
from swarmctl.preflight import report as tables
from swarmctl.preflight.checks import battery, route
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual

NEVER = replace(DEFAULT_OPTIONS, launch="never")


def one(**sections: object) -> Scenario:
    return small(simulate={"count": 1, "ready_s": 3.0}, **sections)


def shown(report: FlightReport) -> str:
    console = Console(width=400, record=True, file=None, quiet=True)
    with console.capture() as captured:
        console.quiet = False
        console.print(tables.overview(report.checked))
        console.print(tables.failures(report.checked))
    return captured.get()


def test_parameters_that_fly_sets_are_no_failure_and_are_set_before_arming(tmp_path: Path) -> None:
    trouble = Trouble(params={"FENCE_ENABLE": 0.0})
    scenario = one(preflight={"set_parameters": True})
    report = fly(scenario, tmp_path / "preflight", trouble=trouble, options=NEVER)
    assert report.trouble == ()
    text = shown(report)
    assert "`fly` sets: FENCE_ENABLE 0 → 1" in text
    assert "FAILS" not in text
    ui = Ui()
    assert fly(scenario, tmp_path / "fly", trouble=trouble, ui=ui).all_arrived
    assert any("FENCE_ENABLE 0 → 1" in line for line in ui.said)


@pytest.mark.parametrize(
    ("params", "found"),
    [
        ({"FENCE_ENABLE": 0.0}, "parameters: found FENCE_ENABLE 0, wanted 1 "),
        ({"WPNAV_SPEED": 200.0}, "WPNAV_SPEED 200, wanted 950 to 1050 "),
        ({"BATT_LOW_VOLT": 0.1}, "battery: found BATT_LOW_VOLT 0.1 V"),
    ],
)
def test_a_behaviour_that_plans_do_not_assume_keeps_the_vehicle_on_the_ground(
    params: dict[str, float], found: str, tmp_path: Path
) -> None:
    scenario = one(flight={"altitude_m": 15.0})
    report = fly(scenario, tmp_path, trouble=Trouble(params=params))
    assert any(found in text for text in report.trouble), report.trouble
    assert not report.all_arrived


@pytest.mark.parametrize("check", [battery, route])
def test_a_missing_route_is_reported_with_its_cause(check: object) -> None:
    far = "812 m from its configured start"
    facts = replace(FIT, plan=None, trajectory=None, no_route_because=far)
    finding = check.check(facts)  # type: ignore[attr-defined]
    assert far in finding.found


def test_a_route_beyond_a_full_battery_is_not_cured_by_charging() -> None:
    finding = battery.check(replace(FIT, endurance_s=60.0))
    assert "preflight.endurance_s" in finding.remedy
    assert "preflight.endurance_s" not in battery.check(replace(FIT, reserve_percent=70.0)).remedy


def test_ctrl_c_reports_the_results_so_far(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 1, "ready_s": 60.0})
    report = fly(scenario, tmp_path, trouble=interrupting(12.0), options=NEVER)
    assert report.ended == "stopped"
    found = {c.check: c.finding for c in report.checked["uav1"]}
    assert found["identity"].ok
    assert "[no-position]" in found["route"].found
