"""What a preflight table says to do is what helps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from flights import Ui, fly, small
from interruptions import interrupting
from preflight_facts import FIT
from rich.console import Console
from trouble import Trouble, play

from swarmctl.config.scenario import Scenario
from swarmctl.flight.app import DEFAULT_OPTIONS
from swarmctl.preflight import report as tables
from swarmctl.preflight.checks import battery, route
from swarmctl.report.outcome import Report

pytestmark = pytest.mark.virtual

NEVER = replace(DEFAULT_OPTIONS, launch="never")


def one(**sections: object) -> Scenario:
    return small(simulate={"count": 1, "ready_s": 3.0}, **sections)


def shown(report: Report) -> str:
    console = Console(width=400, record=True, file=None, quiet=True)
    with console.capture() as captured:
        console.quiet = False
        console.print(tables.overview(report.checked))
        console.print(tables.failures(report.checked))
    return captured.get()


def test_what_fly_sets_is_no_failure_of_preflight_and_is_set_before_it_arms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(Trouble(params={"FENCE_ENABLE": 0.0}), monkeypatch)
    scenario = one(preflight={"set_parameters": True})
    report = fly(scenario, tmp_path / "preflight", options=NEVER)
    assert report.trouble == ()
    text = shown(report)
    assert "`fly` sets: FENCE_ENABLE 0 → 1" in text
    assert "FAILS" not in text
    ui = Ui()
    assert fly(scenario, tmp_path / "fly", ui=ui).all_arrived
    assert any("FENCE_ENABLE 0 → 1 (they stay so afterwards)" in said for said in ui.said)


def test_where_nobody_sets_them_they_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    play(Trouble(params={"FENCE_ENABLE": 0.0}), monkeypatch)
    report = fly(one(), tmp_path, options=NEVER)
    assert any("parameters: found FENCE_ENABLE 0" in text for text in report.trouble)
    assert "`fly` sets" not in shown(report)


@pytest.mark.parametrize(
    ("params", "found"),
    [
        ({"WPNAV_SPEED": 200.0}, "WPNAV_SPEED 200; wanted WPNAV_SPEED 950 to 1050 (speed_m_s: 10)"),
        (
            {"RTL_ALT_FINAL": 500.0},
            "RTL_ALT_FINAL 500; wanted RTL_ALT_FINAL 0 (a return that ends in a landing)",
        ),
        ({"FS_EKF_ACTION": 2.0}, "FS_EKF_ACTION 2; wanted FS_EKF_ACTION 1 or 3"),
        ({"BATT_LOW_VOLT": 0.1}, "battery: found low at 0.1 V"),
    ],
)
def test_what_it_would_do_otherwise_than_is_reckoned_with_keeps_it_on_the_ground(
    params: dict[str, float], found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play(Trouble(params=params), monkeypatch)
    scenario = one(flight={"altitude_m": 15.0})
    report = fly(scenario, tmp_path)
    assert any(found in text for text in report.trouble), report.trouble
    assert not report.all_arrived


def test_why_it_has_no_route_is_in_the_table(tmp_path: Path) -> None:
    scenario = small(
        simulate={"count": 1, "ready_s": 60.0}, flight={"altitude_m": 15.0, "ready_timeout_s": 8.0}
    )
    ui = Ui()
    report = fly(scenario, tmp_path, ui=ui, options=NEVER)
    found = {c.check: c.finding.found for c in report.checked["uav1"] if not c.finding.ok}
    for check in ("battery", "route"):
        assert found[check].startswith("no verified route is on it: ")
        assert "no position estimate" in found[check]
    assert any("waited for 8 s at most" in said for said in ui.said)


@pytest.mark.parametrize("check", [battery, route])
def test_a_missing_route_has_its_cause(check: object) -> None:
    far = "it stands 812 m from its configured start"
    finding = check.check(replace(FIT, plan=None, flight=None, no_route=far))  # type: ignore[attr-defined]
    assert (finding.found, finding.cure) == (f"no verified route is on it: {far}", "mend that first")


def test_what_no_charge_can_mend_is_not_to_be_charged() -> None:
    finding = battery.check(replace(FIT, endurance_s=60.0))
    assert "preflight.endurance_s" in finding.cure
    assert "charge it" not in finding.cure


def test_ctrl_c_tells_what_is_known(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 1, "ready_s": 60.0})
    report = fly(scenario, tmp_path, address_of=interrupting(12.0), options=NEVER)
    assert report.ended == "stopped"
    found = {c.check: c.finding for c in report.checked["uav1"]}
    assert found["identity"].ok
    assert "no position estimate" in found["route"].found
