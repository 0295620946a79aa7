"""The table of firmware and simulator shows the recorded results, and gives each difference a reason."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from sim_vehicle.conformance.registry import all_checks
from sim_vehicle.conformance.table import conformance_table, pairs, read

DOCS = Path(__file__).parents[2] / "docs"


def command(*arguments: object) -> Any:
    app = typer.Typer()
    app.command()(conformance_table)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def recorded(folder: Path, name: str, results: dict[str, tuple[str, str]], *, simulator: bool) -> Path:
    """Write a result of the suite on an ArduCopter 4.6.2."""
    vehicle = {"autopilot": 3, "type": 2, "flight_sw_version": 0x04060200, "simulator": simulator}
    checks = [{"name": n, "result": outcome, "seen": seen} for n, (outcome, seen) in results.items()]
    path = folder / name
    path.write_text(json.dumps({"vehicle": vehicle, "checks": checks}))
    return path


def test_the_page_is_made_from_the_recorded_results_and_every_difference_has_a_reason() -> None:
    result = command(DOCS / "firmware.json")
    assert result.exit_code == 0
    assert result.stdout == (DOCS / "firmware.md").read_text(encoding="utf-8")


def test_the_recorded_checks_exist_and_no_firmware_fails_one() -> None:
    names = {check.name for check in all_checks()}
    for pair in pairs(read([DOCS / "firmware.json"])):
        assert set(pair.firmware.results) <= names
        assert [c for c, (outcome, _) in pair.firmware.results.items() if outcome == "failed"] == []


def test_a_difference_without_a_reason_is_shown_and_ends_with_1(tmp_path: Path) -> None:
    firmware = recorded(
        tmp_path, "a.json", {"home.a": ("passed", ""), "home.b": ("failed", "saw | 3")}, simulator=False
    )
    simulator = recorded(
        tmp_path, "b.json", {"home.a": ("passed", ""), "home.b": ("passed", "")}, simulator=True
    )
    result = command(firmware, simulator, "--compact", tmp_path / "all.json")
    assert result.exit_code == 1
    assert "| home | 1, 1 differs |" in result.stdout
    (row,) = [line for line in result.stdout.splitlines() if "`home.b`" in line]
    assert row.count("|") == 6
    assert command(tmp_path / "all.json").stdout == result.stdout


def test_a_later_result_replaces_an_earlier_one_and_an_unasked_check_is_none(tmp_path: Path) -> None:
    earlier = recorded(tmp_path, "a.json", {"home.a": ("failed", "late")}, simulator=False)
    unasked = recorded(
        tmp_path, "b.json", {"home.a": ("skipped", "not permitted: needs --allow-arm")}, simulator=False
    )
    later = recorded(tmp_path, "c.json", {"home.a": ("passed", "")}, simulator=False)
    simulator = recorded(tmp_path, "d.json", {"home.a": ("passed", "")}, simulator=True)
    assert command(earlier, unasked, simulator).exit_code == 1
    assert command(earlier, later, unasked, simulator).exit_code == 0


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"vehicle": 3}', '{"vehicles": [1]}'])
def test_a_file_of_another_kind_is_named(tmp_path: Path, content: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(content)
    result = command(path)
    assert result.exit_code == 2
    assert "other.json" in result.output


def test_a_firmware_needs_the_simulator_in_its_place(tmp_path: Path) -> None:
    alone = recorded(tmp_path, "a.json", {"home.a": ("passed", "")}, simulator=False)
    result = command(alone)
    assert result.exit_code == 2
    assert "ArduCopter" in result.output
