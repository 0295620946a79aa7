"""Output and exit codes of `swarmctl preflight` and `--waive`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from swarmctl_process import swarmctl

pytestmark = pytest.mark.virtual

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 6, cols: 6, cell_size_m: 50}
threats: {count: 3}
communication: {bus: memory}
flight: {altitude_m: 15}
simulate: {count: 2, ready_s: 1}
"""
DEMANDING = SMALL + "preflight: {reserve_percent: 95}\n"


def config(folder: Path, text: str) -> Path:
    file = folder / "swarm.yaml"
    file.write_text(text)
    return file


def test_fit_vehicles_pass_and_no_run_folder_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = swarmctl("preflight", "--config", config(tmp_path, SMALL), "--clock", "virtual")
    assert result.exit_code == 0, result.output
    assert [line.split()[0] for line in result.output.splitlines() if line.count(" ok ") > 3] == [
        "uav1",
        "uav2",
    ]
    assert result.exit_code == 0
    assert [file.name for file in tmp_path.iterdir()] == ["swarm.yaml"]


@pytest.mark.parametrize("command", ["fly", "preflight"])
def test_mavsdk_does_not_fly_on_the_virtual_clock(command: str, tmp_path: Path) -> None:
    file = config(tmp_path, SMALL.replace("ready_s: 1", "ready_s: 1, link: mavsdk"))
    assert swarmctl(command, "--config", file, "--clock", "virtual").exit_code == 2


def test_failed_checks_are_in_the_table_with_advice(tmp_path: Path) -> None:
    result = swarmctl("preflight", "--config", config(tmp_path, DEMANDING), "--clock", "virtual")
    assert result.exit_code == 1
    assert result.output.count("FAILS") == 2
    assert "100 %" in result.output
    assert "95 %" in result.output
    assert "endurance_s" in result.output


def test_waived_checks_are_in_the_table(tmp_path: Path) -> None:
    file = config(tmp_path, DEMANDING)
    result = swarmctl("preflight", "--config", file, "--clock", "virtual", "--waive", "battery:uav1")
    assert result.exit_code == 1
    assert result.output.count("FAILS") == 1
    assert "waived" in result.output
    result = swarmctl("preflight", "--config", file, "--clock", "virtual", "--waive", "battery")
    assert result.exit_code == 0, result.output


def test_a_flight_is_refused_with_every_failure_and_flies_when_they_are_waived(tmp_path: Path) -> None:
    file = config(tmp_path, DEMANDING)
    fly = ("fly", "--config", file, "--clock", "virtual", "--out", tmp_path / "runs")
    refused = swarmctl(*fly)
    assert refused.exit_code == 1
    assert [line.split(": ")[:2] for line in refused.stderr.splitlines()] == [
        ["uav1", "battery"],
        ["uav2", "battery"],
    ]
    flown = swarmctl(*fly, "--waive", "battery:uav1,battery:2")
    assert flown.exit_code == 0, flown.output
    waived = [line for line in flown.output.splitlines() if line.endswith("[waived]")]
    assert [line.split(": ")[:2] for line in waived] == [["uav1", "battery"], ["uav2", "battery"]]
    assert all("100 %" in line for line in waived)
    (*_, folder) = sorted((tmp_path / "runs").iterdir())
    checks = json.loads((folder / "summary.json").read_text())["preflight"]
    assert [c["vehicle"] for c in checks if c["waived"]] == ["uav1", "uav2"]
    entries = [json.loads(line) for line in (folder / "evidence.jsonl").read_text().splitlines()]
    waivers = [entry for entry in entries if entry["kind"] == "waiver"]
    assert [(entry["vehicle"], entry["what"]["check"]) for entry in waivers] == [
        ("uav1", "battery"),
        ("uav2", "battery"),
    ]


@pytest.mark.parametrize("command", ["fly", "preflight"])
@pytest.mark.parametrize(
    ("waiver", "error"),
    [
        *((check, f"--waive {check}: ") for check in ("identity", "unique", "position")),
        ("batery", "'batery'"),
        ("battery:uav7", "[unknown-vehicle]"),
    ],
)
def test_a_check_that_cannot_be_waived_is_refused_before_the_flight(
    command: str, waiver: str, error: str, tmp_path: Path
) -> None:
    result = swarmctl(command, "--config", config(tmp_path, SMALL), "--clock", "virtual", "--waive", waiver)
    assert result.exit_code == 2
    assert error in result.stderr


def test_an_agent_refuses_a_check_that_cannot_be_waived(tmp_path: Path) -> None:
    words = ("agent", "--config", config(tmp_path, SMALL), "--uav", "uav1", "--launch", "when-ready")
    result = swarmctl(*words, "--waive", "identity")
    assert result.exit_code == 2
    assert "--waive identity: " in result.stderr
