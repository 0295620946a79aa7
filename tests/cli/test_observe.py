"""`swarmctl observe`: reports of a person to the agent of a vehicle."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import re
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result
from zenoh_nodes import here

from swarmctl.bus import directory
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.external_observations import ReportReceiver
from swarmctl.bus.sensor_reports import Report, ReportedCells, report_schema
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.open import open_bus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.cli.main import cli
from swarmctl.core.grid import Grid
from swarmctl.core.records import replace
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import load_keyring
from swarmctl.security.requests import by_token
from swarmctl.security.token import new_token
from swarmctl.station import client
from swarmctl.station.client import FlightEndpoints, NoValidAnswer

GRID = Grid(8, 8, 50.0, 46.0, 14.4)
CONFIGURATION = """\
name: test
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
sensor: {source: external}
simulate: {count: 3}
"""


def ran(*words: str) -> Result:
    return CliRunner().invoke(cli, ["observe", *words])


@pytest.fixture
def no_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine on which no swarm is found."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@contextmanager
def beside(
    bus_of: Callable[[ExitStack], Transport], authentication: Authentication
) -> Iterator[list[tuple[ReportedCells, str]]]:
    """Yield the reports to vehicle 3 of the swarm `test`, by a bus in another thread."""
    ready, over = threading.Event(), threading.Event()
    taken: list[tuple[ReportedCells, str]] = []

    async def scene() -> None:
        with ExitStack() as stack:
            ReportReceiver(
                bus_of(stack),
                "test",
                3,
                GRID,
                lambda: 0.0,
                lambda *seen: taken.append(seen),
                print,
                authentication=authentication,
            )
            ready.set()
            await asyncio.to_thread(over.wait)

    thread = threading.Thread(target=asyncio.run, args=(scene(),))
    thread.start()
    try:
        assert ready.wait(10.0)
        yield taken
    finally:
        over.set()
        thread.join()


def flying() -> AbstractContextManager[list[tuple[ReportedCells, str]]]:
    """Return a swarm of one process, which the command line finds on this machine."""
    token = new_token()
    return beside(
        lambda stack: stack.enter_context(open_bus("test", (3,), "tcp/127.0.0.1:0", token.text, print)),
        by_token("test", token, 5.0, time.time),
    )


def through(
    router: Configuration, agent: Configuration
) -> AbstractContextManager[list[tuple[ReportedCells, str]]]:
    """Return a swarm in which vehicle 3 has its own agent, connected by a router."""
    token = new_token()
    has_token = not agent.connect[0].is_certified

    def bus_of(stack: ExitStack) -> Transport:
        if has_token:
            stack.enter_context(directory.registered_agent("test", 3, token.text))
        stack.enter_context(ZenohBus(router))
        return stack.enter_context(ZenohBus(replace(agent, is_patient=False)))

    return beside(bus_of, by_token("test", token, 5.0, time.time) if has_token else NO_AUTHENTICATION)


def accepted(result: Result) -> list[tuple[str, str, str]]:
    """Return row, column and content of each cell in the output."""
    return re.findall(r"\((\d+), (\d+)\) (occupied|clear)", result.stdout)


def test_a_persons_observation_is_accepted_and_printed(no_flight: Path) -> None:
    with flying() as taken:
        result = ran("--uav", "3", "--cell", "4,7", "--cell", "4,6", "--occupied")
    assert (result.exit_code, result.stderr) == (0, "")
    assert accepted(result) == [("4", "7", "occupied"), ("4", "6", "occupied")]
    assert taken == [(((4, 7, True), (4, 6, True)), "operator")]


def test_an_observation_by_position_and_by_vehicle_name_is_accepted(no_flight: Path) -> None:
    path = no_flight / "test.yaml"
    path.write_text(CONFIGURATION)
    lat_deg, lon_deg = GRID.centre((2, 5))
    with flying() as taken:
        result = ran("--config", str(path), "--uav", "uav3", "--at", f"{lat_deg},{lon_deg}", "--clear")
    assert (result.exit_code, result.stderr) == (0, "")
    assert accepted(result) == [("2", "5", "clear")]
    assert taken == [(((2, 5, False),), "operator")]


def test_a_negative_position_is_not_an_option(no_flight: Path) -> None:
    with flying():
        result = ran("--uav", "3", "--at", "-33.9,-70.6", "--clear")
    assert result.exit_code == 1
    assert "point -33.9000000, -70.6000000" in result.stderr


def test_a_refused_report_is_an_error_with_the_reason(no_flight: Path) -> None:
    with flying() as taken:
        result = ran("--uav", "3", "--cell", "99,0", "--occupied")
    assert result.exit_code == 1
    assert "cell [99, 0]" in result.stderr
    assert taken == []


def test_a_vehicle_without_a_report_receiver_is_an_error_with_advice(no_flight: Path) -> None:
    with flying():
        result = ran("--uav", "2", "--cell", "4,7", "--clear")
    assert result.exit_code == 1
    assert "[no-report-receiver]" in result.stderr
    assert "`sensor: {source: external}`" in result.stderr


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_a_report_reaches_an_agent_through_the_router(protocol: str, no_flight: Path) -> None:
    at = here(protocol)
    communication = f"router: {at}"
    shown: dict[str, Credentials | None] = {"router": None, "uav3": None}
    if protocol == "tls":
        communication += f", keys: {no_flight / 'keys'}"
        now = dt.datetime.now(dt.UTC)
        make_keys(no_flight / "keys", ["router", "uav3", "operator"], 5, now)
        shown = {name: load_keyring(no_flight / "keys", name, now).credentials for name in shown}
    path = no_flight / "test.yaml"
    path.write_text(f"{CONFIGURATION}communication: {{{communication}}}\n")
    router = zenoh_config.router(at, "test", [1, 2, 3], shown["router"])
    with through(router, zenoh_config.client(at, shown["uav3"])) as taken:
        # A declaration may arrive a moment after the link is up.
        for _ in range(100):
            result = ran("--config", str(path), "--uav", "uav3", "--cell", "4,7", "--occupied")
            if "[no-report-receiver]" not in result.stderr:
                break
    assert (result.exit_code, result.stderr) == (0, "")
    assert taken == [(((4, 7, True),), "operator")]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--cell 4,7 --clear", "[which-vehicle]"),
        ("--uav uav3 --cell 4,7 --clear", "--uav 'uav3': "),
        ("--uav 255 --cell 4,7 --clear", "--uav '255': "),
        ("--uav uav9 --cell 4,7 --clear --config F", "uav9"),
        ("--uav 3 --clear", "[which-cell]"),
        ("--uav 3 --cell 4,7 --at 46,14 --clear", "[which-cell]"),
        ("--uav 3 --cell 4,7", "[occupied-or-clear]"),
        ("--uav 3 --cell 4 --clear", "--cell '4': "),
        ("--uav 3 --cell 4,7,1 --clear", "--cell '4,7,1': "),
        ("--uav 3 --cell 4,x --clear", "--cell '4,x': "),
        ("--uav 3 --cell 4.5,7 --clear", "--cell '4.5,7': "),
        ("--uav 3 --cell inf,7 --clear", "--cell 'inf,7': "),
        ("--uav 3 --cell 1e30,7 --clear", "--cell '1e30,7': "),
        ("--uav 3 --at 91,14 --clear", "--at '91,14': "),
        ("--uav 3 --at nan,14 --clear", "--at 'nan,14': "),
        ("--uav 3 --cell 4,7 --clear --connect tcp/127.0.0.1:7447", "[which-swarm]"),
        ("--uav 3 --cell 4,7 --clear --config nowhere.yaml", "nowhere.yaml: "),
    ],
)
def test_an_unclear_report_is_a_usage_error(words: str, reason: str, no_flight: Path) -> None:
    path = no_flight / "test.yaml"
    path.write_text(CONFIGURATION)
    result = ran(*(str(path) if word == "F" else word for word in words.split()))
    assert result.exit_code == 2
    assert reason in result.stderr


def test_the_schema_of_reports_is_printed(no_flight: Path) -> None:
    result = ran("--schema")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == json.loads(json.dumps(report_schema()))


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        (b"nonsense", "test at tcp/127.0.0.1:7447"),
        (b'{"why": "because"}', "missing required field `taken`"),
        (None, "no-answer"),
    ],
)
def test_an_invalid_answer_is_an_error_and_not_a_bug(reply: bytes | None, reason: str) -> None:
    async def scene() -> None:
        bus: Transport = MemoryBus()
        bus.serve(
            "swarmctl/test/uav/3/inform/look/sensor",
            lambda _key, _payload, answer: None if reply is None else answer(reply),
        )
        station = FlightEndpoints("test", BusEndpoint("127.0.0.1", 7447))
        with pytest.raises(NoValidAnswer, match=reason):
            await client.report(bus, station, 3, Report(1, cells=((4, 7, True),)))

    run_virtual(scene())
