"""Preflight checks of whole swarms, and their waivers."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from flights import Ui, fly, small, virtual_flight
from trouble import Trouble

from sim_vehicle.fleet import Fleet
from swarmctl.config.scenario import Scenario
from swarmctl.flight import run
from swarmctl.flight.run import FlightOptions
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.preflight.checks import CHECKS
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual


def afflicted(*faults: str, params: dict[int, dict[str, float]] | None = None) -> Trouble:
    """Return a simulator with faults, and with parameters by system id."""
    return Trouble(faults=[*faults], params_of=params or {})


def checked(
    scenario: Scenario,
    folder: Path,
    *waivers: Waiver,
    trouble: Trouble | None = None,
    ui: Ui | None = None,
) -> FlightReport:
    """Run the checks without a launch."""
    trouble = trouble or Trouble()
    options = FlightOptions(launch="never", waivers=waivers, simulate=trouble.simulate)
    folder.mkdir(exist_ok=True)
    report = run_virtual(virtual_flight(scenario, folder, ui, options=options))
    if report.bug is not None:
        raise report.bug
    return report


def failing(report: FlightReport) -> list[tuple[str, str]]:
    return [
        (found.vehicle, found.check)
        for findings in report.checked.values()
        for found in findings
        if not found.finding.ok
    ]


AUTOPILOTS = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


@AUTOPILOTS
def test_fit_vehicles_pass_every_check_and_none_is_armed(autopilot: str, tmp_path: Path) -> None:
    report = checked(small(simulate={"count": 2, "ready_s": 1.0, "autopilot": autopilot}), tmp_path)
    assert (report.ended, report.trouble) == ("ended", ())
    assert failing(report) == []
    assert {name: len(findings) for name, findings in report.checked.items()} == dict.fromkeys(
        ("uav1", "uav2"), len(CHECKS)
    )
    assert not any(state.launch.armed_seen or state.vehicle.armed for state in report.states.values())


WRONG = {
    "ardupilot": ({"FENCE_ENABLE": 0, "BATT_FS_LOW_ACT": 0}, "FENCE_ENABLE 0", "BATT_FS_LOW_ACT 0"),
    "px4": ({"GF_ACTION": 4, "COM_LOW_BAT_ACT": 0}, "GF_ACTION 4", "COM_LOW_BAT_ACT 0"),
}


@AUTOPILOTS
def test_parameters_against_the_policy_are_found_by_their_names(autopilot: str, tmp_path: Path) -> None:
    params, *parts = WRONG[autopilot]
    trouble = afflicted(params={2: params})
    report = checked(
        small(simulate={"count": 2, "ready_s": 1.0, "autopilot": autopilot}), tmp_path, trouble=trouble
    )
    assert failing(report) == [("uav2", "parameters")]
    (text,) = report.trouble
    assert text.startswith("uav2: parameters: ")
    assert all(part in text for part in parts)


def test_parameters_are_compared_with_the_declared_policy(tmp_path: Path) -> None:
    policy = {"lost_link": "land", "lost_link_after_s": 20, "low_battery": "land", "fence_breach": "hold"}
    report = checked(small(preflight={"policy": policy}), tmp_path)
    assert failing(report) == [], "simulated vehicles come set up as declared"


@pytest.mark.full
def test_parameters_are_set_only_if_configured(tmp_path: Path) -> None:
    trouble = afflicted(params={1: {"FENCE_ENABLE": 0, "FENCE_ACTION": 0}, 2: {"FENCE_TYPE": 7}})
    ui = Ui()
    report = fly(small(preflight={"set_parameters": True}), tmp_path, ui=ui, trouble=trouble)
    assert report.all_arrived
    (line,) = [text for text in ui.said if "FENCE_ENABLE 0 → 1" in text]
    assert line.startswith("uav1: ")
    assert line.endswith("FENCE_ENABLE 0 → 1, FENCE_ACTION 0 → 1")


@pytest.mark.parametrize("enabled", [0, 1])
def test_ardupilots_fence_is_enabled_after_its_limits_are_set(enabled: int, tmp_path: Path) -> None:
    # ArduPilot reads fence limits when FENCE_ENABLE changes, or by command (`AC_Fence::update`, `enable`).
    trouble = afflicted(params={1: {"FENCE_TYPE": 4, "FENCE_ENABLE": enabled}})
    simulate = {"count": 1, "ready_s": 1.0}
    scenario = small(preflight={"set_parameters": True}, simulate=simulate)
    assert fly(scenario, tmp_path, trouble=trouble).all_arrived
    lines = [json.loads(line) for line in (tmp_path / "evidence.jsonl").read_text().splitlines()]
    sent = [line["what"] for line in lines if line["kind"] == "command"]
    values = [(what["param_id"], what["param_value"]) for what in sent if what["message"] == "PARAM_SET"]
    switched_on = [] if enabled else [("FENCE_ENABLE", 1.0)]
    assert sorted(values) == [*switched_on, ("FENCE_TYPE", 5.0)]
    names = [what.get("command", what.get("param_id")) for what in sent]
    assert names.index("DO_FENCE_ENABLE") > names.index("FENCE_TYPE")


def test_preflight_without_launch_sets_no_parameter(tmp_path: Path) -> None:
    trouble = afflicted(params={1: {"FENCE_ENABLE": 0}})
    report = checked(small(preflight={"set_parameters": True}), tmp_path, trouble=trouble)
    assert failing(report) == [("uav1", "parameters")]


def test_failures_of_two_vehicles_are_one_report_and_no_vehicle_is_armed(tmp_path: Path) -> None:
    trouble = afflicted("battery_sag:sag_v=0,at_most=0.2,sysid=1", params={3: {"FENCE_ENABLE": 0}})
    report = fly(small(), tmp_path, trouble=trouble)
    assert report.ended == "failed"
    assert [text.split(": ")[:2] for text in report.trouble] == [["uav1", "battery"], ["uav3", "parameters"]]
    assert "--waive battery:uav1" in report.trouble[0]
    assert not any(state.launch.armed_seen for state in report.states.values())
    written = json.loads((tmp_path / "summary.json").read_text())
    assert [(c["vehicle"], c["check"]) for c in written["preflight"] if not c["ok"]] == [
        ("uav1", "battery"),
        ("uav3", "parameters"),
    ]


def test_a_waived_check_is_reported_recorded_and_does_not_stop_the_flight(tmp_path: Path) -> None:
    trouble = afflicted("battery_sag:sag_v=0,at_most=0.5,sysid=1")
    scenario, ui = small(preflight={"reserve_percent": 60}), Ui()
    refused = checked(scenario, tmp_path / "checks", trouble=trouble)
    assert failing(refused) == [("uav1", "battery")]
    options = FlightOptions(waivers=(Waiver("battery", "uav1"),), simulate=trouble.simulate)
    (tmp_path / "flight").mkdir()
    report = run_virtual(virtual_flight(scenario, tmp_path / "flight", ui, options=options))
    assert report.all_arrived
    (line,) = [text for text in ui.said if text.endswith("[waived]")]
    assert line.startswith("uav1: battery: ")
    assert re.findall(r"\d+ %", line)[:2] == ["50 %", "70 %"]
    waived = [c for c in report.summary["preflight"] if c["waived"]]
    assert [(c["vehicle"], c["check"], c["found"]) for c in waived] == [("uav1", "battery", "50 %")]


def test_a_waiver_for_one_vehicle_does_not_apply_to_another(tmp_path: Path) -> None:
    trouble = afflicted("battery_sag:sag_v=0,at_most=0.2")
    report = checked(small(), tmp_path, Waiver("battery", "uav2"), trouble=trouble)
    assert [text.split(":")[0] for text in report.trouble] == ["uav1", "uav3"]


def test_a_clock_out_of_step_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(run, "VIRTUAL_EPOCH_NS", run.VIRTUAL_EPOCH_NS + 5 * 10**9)
    report = checked(small(), tmp_path)
    assert failing(report) == [(f"uav{n}", "clock") for n in (1, 2, 3)]
    assert report.trouble[0].startswith("uav1: clock: ")
    assert " -5.0 s; " in report.trouble[0]
    assert " 2 s" in report.trouble[0]


def test_a_vehicle_without_satellites_is_found(tmp_path: Path) -> None:
    trouble = afflicted("gps_loss:sysid=1")
    report = checked(small(), tmp_path, trouble=trouble)
    assert ("uav1", "gps") in failing(report)
    assert {name for name, _ in failing(report)} == {"uav1"}


def test_a_vehicle_that_does_not_become_ready_is_reported_with_failures_of_others(tmp_path: Path) -> None:
    trouble = afflicted("sensor_unhealthy:sensor=mag,sysid=1", params={3: {"FENCE_ENABLE": 0}})
    ui = Ui()
    report = checked(
        small(flight={"ready_timeout_s": 20.0, "altitude_m": 15.0}), tmp_path, ui=ui, trouble=trouble
    )
    assert any(text.startswith("uav3: parameters: ") and "FENCE_ENABLE 0" in text for text in ui.said)
    uav1 = {("uav1", "position"), ("uav1", "battery"), ("uav1", "route")}
    assert set(failing(report)) == {*uav1, ("uav3", "parameters")}
    assert report.trouble[0].startswith("uav1 (system 1 at memory:fleet): ")
    assert " 20 s" in report.trouble[0]
    assert "[pre-arm]" in report.trouble[0]


def test_a_vehicle_that_refuses_the_fence_is_not_armed(tmp_path: Path) -> None:
    trouble = afflicted("mission_refused:result=no_space,for=6,sysid=3")
    ui = Ui()
    report = checked(small(simulate={"count": 3, "ready_s": 10.0}), tmp_path, ui=ui, trouble=trouble)
    assert failing(report) == [("uav3", "fence")]
    assert any("uav3" in text and "upload rejected: NO_SPACE" in text for text in ui.said)


@pytest.mark.autopilots("2 fence use")
def test_a_route_that_leaves_a_configured_fence_is_found(tmp_path: Path) -> None:
    scenario = small()
    to_geodetic = scenario.grid.frame.to_geodetic
    corners = [to_geodetic(*c) for c in ((-100, -100), (300, -100), (300, 500), (-100, 500))]
    polygon = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in corners]
    report = checked(small(preflight={"fence": {"polygon": polygon}}), tmp_path)
    assert failing(report) == [(f"uav{n}", "route") for n in (1, 2, 3)]
    assert report.trouble[0].startswith("uav1: route: ")


def test_an_old_battery_message_does_not_count(tmp_path: Path) -> None:
    """The vehicle sends SYS_STATUS until it holds its mission, and then no more, requested or not."""

    holds: list[bool] = []

    def loses(fleet: Fleet, frame: bytes) -> bool:
        if fleet.vehicles[1].mission.count and not holds:
            holds.append(True)
        return bool(holds) and frame[5:6] == b"\x02" and frame[7:10] == b"\x01\0\0"

    report = checked(small(simulate={"count": 2, "ready_s": 1.0}), tmp_path, trouble=Trouble(loses=loses))
    assert holds
    assert failing(report) == [("uav2", "position"), ("uav2", "battery")]
    (finding,) = (c.finding for c in report.checked["uav2"] if c.check == "battery")
    assert "SYS_STATUS" in finding.remedy
