"""Shipped configurations by `--example`, and the starter configuration of `swarmctl init`."""

from __future__ import annotations

from pathlib import Path

import pytest
from swarmctl_process import SHIPPED, swarmctl

from swarmctl.cli.console import FAILED, OK, USAGE
from swarmctl.config.model import load
from swarmctl.config.roster import load_roster


@pytest.mark.parametrize("command", [("check", "--out", "runs"), ("plan", "--out", "runs")])
def test_an_example_gives_the_same_result_as_its_file(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    by_name = swarmctl(*command, "--example", "swarm")
    by_file = swarmctl(*command, "--config", SHIPPED)
    assert (by_name.exit_code, by_file.exit_code) == (OK, OK)
    assert by_name.output.splitlines()[:5] == by_file.output.splitlines()[:5]


@pytest.mark.parametrize("command", ["fly", "plan", "check", "preflight"])
@pytest.mark.parametrize(
    "options",
    [(), ("--example", "swram"), ("--example", "swarm", "--config", str(SHIPPED))],
    ids=["neither", "unknown", "both"],
)
def test_a_command_needs_one_known_configuration(command: str, options: tuple[str, ...]) -> None:
    result = swarmctl(command, *options)
    assert result.exit_code == USAGE
    assert "--example" in result.stderr


def test_an_unknown_example_is_refused_with_the_known_ones() -> None:
    assert "apart, arrive, " in swarmctl("check", "--example", "swram").stderr


@pytest.mark.virtual
def test_fly_and_preflight_take_an_example(tmp_path: Path) -> None:
    checked = swarmctl("preflight", "--example", "mixed", "--clock", "virtual")
    assert checked.exit_code == OK, checked.output
    # The example has no vehicle for `--real`.
    refused = swarmctl("fly", "--example", "mixed", "--real", "--out", tmp_path / "runs")
    assert refused.exit_code == USAGE
    assert refused.stderr.startswith("--real: ")


@pytest.mark.parametrize("options", [(), ("--vehicles", "2")])
def test_init_writes_a_configuration_that_passes_check(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written = swarmctl("init", *options)
    assert written.exit_code == OK, written.output
    file = tmp_path / "swarm.yaml"
    assert len(load_roster(file).names) == int(options[-1] if options else 5)
    assert swarmctl("check", "--config", file).exit_code == OK


def test_init_writes_real_vehicles_with_lines_to_edit(tmp_path: Path) -> None:
    file = tmp_path / "real.yaml"
    assert swarmctl("init", file, "--vehicles", "3", "--real").exit_code == OK
    assert load(file).sensor.source == "external"  # no real aircraft acts on invented hostiles
    assert load_roster(file).names == {1: "uav1", 2: "uav2", 3: "uav3"}
    assert "# EDIT" in file.read_text()
    assert swarmctl("plan", "--config", file, "--out", tmp_path / "runs").exit_code == OK


def test_init_does_not_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text("name: mine\n")
    result = swarmctl("init", file)
    assert result.exit_code == FAILED
    assert str(file) in result.stderr
    assert file.read_text() == "name: mine\n"


def test_init_reports_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    file = tmp_path / "nowhere" / "swarm.yaml"
    result = swarmctl("init", file)
    assert result.exit_code == FAILED
    assert str(file) in result.stderr.replace("\n", "")
