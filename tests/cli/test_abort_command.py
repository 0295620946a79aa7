"""`swarmctl abort` as a person in a hurry meets it: what it refuses, gives and says, and the exit code."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from station_threads import station_in_a_thread
from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder


@pytest.fixture(autouse=True)
def _nobody_else_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def abort(words: str) -> Result:
    return CliRunner().invoke(cli, ["abort", *words.split()])


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("--all", "Missing argument"),
        ("stop --all", "Invalid value for"),
        ("launch --all", "Invalid value for"),
        ("hold", "which vehicles? give --uav NAME"),
        ("hold --all --uav 1", "which vehicles?"),
        ("land --all --connect tcp/127.0.0.1:7447", "which swarm"),
        ("return --all --config nowhere.yaml", "there is no such file"),
    ],
)
def test_what_is_not_clear_is_a_wrong_usage_and_says_what_is_missing(words: str, why: str) -> None:
    result = abort(words)
    assert result.exit_code == 2
    assert why in result.stderr


def test_where_nothing_flies_it_says_so() -> None:
    result = abort("hold --all")
    assert result.exit_code == 1
    assert "no swarm of this user flies on this machine" in result.stderr


@pytest.mark.parametrize(
    ("how", "order"), [("hold", FlightOrder.HOLD), ("return", FlightOrder.RETURN), ("land", FlightOrder.LAND)]
)
def test_all_are_told_and_what_each_says_is_printed(how: str, order: FlightOrder) -> None:
    with station_in_a_thread() as station:
        result = abort(f"{how} --all")
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [f"uav1: {how} ordered", f"uav2: {how} ordered"]
    assert station.posted == [(uav, ev.OperatorCommand(order, 1)) for uav in (1, 2)]


def test_one_is_told_by_its_name_and_the_other_flies_on() -> None:
    with station_in_a_thread() as station:
        result = abort("land --uav uav2 --swarm test")
    assert (result.exit_code, result.stdout) == (0, "uav2: land ordered\n")
    assert [uav for uav, _ in station.posted] == [2]


def test_a_vehicle_that_is_not_there_is_said_and_nobody_is_told() -> None:
    with station_in_a_thread() as station:
        result = abort("hold --uav 9")
    assert result.exit_code == 1
    assert "test refused: nothing was changed: no vehicle has the system id or name 9" in result.stderr
    assert station.posted == []


def test_a_name_that_is_misspelt_keeps_nobody_else_in_the_air() -> None:
    with station_in_a_thread() as station:
        result = abort("land --uav nosuch --uav uav1")
    assert result.exit_code == 1
    assert [uav for uav, _ in station.posted] == [1]
    assert "uav1: land ordered" in result.stdout
    assert "nosuch: not ordered: " in result.stderr
    assert "no vehicle has the system id or name nosuch" in result.stderr
