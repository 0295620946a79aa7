"""`swarmctl abort`: its orders, refusals, output and exit codes."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

import pytest
from station_threads import station_in_a_thread
from typer.testing import CliRunner, Result

from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.cli.main import cli
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder
from swarmctl.core.messages import VehicleAnswer
from swarmctl.report.answers import order_line


@pytest.fixture(autouse=True)
def _no_other_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def run(words: str) -> Result:
    return CliRunner().invoke(cli, words.split())


def abort(words: str) -> Result:
    return run(f"abort {words}")


def ordered(order: str, uav: int) -> str:
    """Return the line about a vehicle that takes an order."""
    return order_line(order, VehicleAnswer(uav, f"uav{uav}", "taken"))


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--all", "Missing argument"),
        ("stop --all", "Invalid value for"),
        ("launch --all", "Invalid value for"),
        ("hold", "[which-vehicles]"),
        ("hold --all --uav 1", "[which-vehicles]"),
        ("hold --uav ,", "[which-vehicles]"),
        ("land --all --connect tcp/127.0.0.1:7447", "[which-swarm]"),
        ("return --all --config nowhere.yaml", "nowhere.yaml: "),
    ],
)
def test_an_unclear_abort_is_a_usage_error(words: str, reason: str) -> None:
    result = abort(words)
    assert result.exit_code == 2
    assert reason in result.stderr


def test_an_abort_without_a_running_swarm_is_an_error() -> None:
    result = abort("hold --all")
    assert result.exit_code == 1
    assert "[no-swarm]" in result.stderr


@pytest.mark.parametrize(
    ("how", "order"), [("hold", FlightOrder.HOLD), ("return", FlightOrder.RETURN), ("land", FlightOrder.LAND)]
)
def test_all_vehicles_get_the_order_and_their_answers_are_printed(how: str, order: FlightOrder) -> None:
    with station_in_a_thread() as station:
        result = abort(f"{how} --all")
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [ordered(how, uav) for uav in (1, 2)]
    given = [(uav, event.order) for uav, event in station.posted if isinstance(event, ev.OperatorCommand)]
    # A return begins after a hold, at a time that the second command tells.
    assert given == [(uav, order) for uav in (1, 2)] * (2 if how == "return" else 1)


def test_an_abort_by_name_leaves_the_other_vehicle_flying() -> None:
    with station_in_a_thread() as station:
        result = abort("land --uav uav2 --swarm test")
    assert (result.exit_code, result.stdout.splitlines()) == (0, [ordered("land", 2)])
    assert [uav for uav, _ in station.posted] == [2]


def test_an_unknown_vehicle_is_refused_and_no_vehicle_gets_the_order() -> None:
    with station_in_a_thread() as station:
        result = abort("hold --uav 9")
    assert result.exit_code == 1
    assert "1 (uav1), 2 (uav2)" in result.stderr
    assert station.posted == []


@pytest.mark.parametrize("command", ["abort", "order"])
def test_a_misspelt_name_does_not_keep_the_others_in_the_air(command: str) -> None:
    with station_in_a_thread() as station:
        result = run(f"{command} land --uav nosuch,uav1")
    assert result.exit_code == 1
    assert [uav for uav, _ in station.posted] == [1]
    assert ordered("land", 1) in result.stdout.splitlines()
    assert re.search(r"^nosuch: .*\[unknown-vehicle\]$", result.stderr, re.MULTILINE)


def test_a_misspelt_name_keeps_all_vehicles_on_the_ground() -> None:
    with station_in_a_thread() as station:
        result = run("order launch --uav nosuch --uav uav1")
    assert result.exit_code == 1
    assert "[unknown-vehicle]" in result.stderr
    assert station.posted == []


def test_vehicles_to_ignore_are_typed_like_the_vehicles_to_launch() -> None:
    with station_in_a_thread() as station:
        result = run("order launch --uav uav1 --ignore nosuch,uav2")
    assert result.exit_code == 1
    assert "name nosuch;" in result.stderr
    assert station.posted == []


def test_an_unknown_name_is_answered_with_a_similar_name() -> None:
    with station_in_a_thread():
        assert "did you mean 'uav2'?" in run("order launch --uav uavv2").stderr
        assert "did you mean 'test'?" in run("order launch --all --swarm tset").stderr


@pytest.mark.parametrize("command", ["abort", "order"])
def test_several_flights_are_listed_once(command: str) -> None:
    with (
        directory.registered("one", BusEndpoint("127.0.0.1", 4001), "token"),
        directory.registered("two", BusEndpoint("127.0.0.1", 4002), "token"),
    ):
        result = run(f"{command} hold --all")
    assert result.exit_code == 2
    assert [result.stderr.count(endpoint) for endpoint in ("127.0.0.1:4001", "127.0.0.1:4002")] == [1, 1]


def test_an_abort_without_a_name_shows_the_flight_and_keeps_stale_records(tmp_path: Path) -> None:
    folder = tmp_path / f"swarmctl-{os.getuid()}"
    with station_in_a_thread() as station:
        stale = folder / "killed.1.json"
        stale.write_text('{"swarm": "killed", "endpoint": "tcp/127.0.0.1:4003", "pid": 1}')
        result = abort("hold --all")
    assert result.exit_code == 0
    assert re.search(r"\btest .*tcp/127\.0\.0\.1:\d+", result.stderr)
    assert "killed" not in result.stderr
    assert stale.exists()
    assert len(station.posted) == 2
    assert "may have ended" in abort("return --all --swarm test").stderr
