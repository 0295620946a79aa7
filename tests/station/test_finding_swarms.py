"""The command line finds a swarm in flight, and sends it commands."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import json
import os
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from flights import small
from station_threads import station_in_a_thread
from typer.testing import CliRunner

from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.open import open_bus
from swarmctl.cli.main import cli
from swarmctl.core import events as ev
from swarmctl.core.messages import GiveOrder, VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.station import client, commands


@pytest.fixture
def no_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"swarmctl-{os.getuid()}"


HERE, THERE = BusEndpoint("127.0.0.1", 4001), BusEndpoint("127.0.0.1", 4002)


def test_a_flight_is_found_by_its_name_until_its_end(no_flight: Path) -> None:
    with directory.registered("one", HERE, "token"), directory.registered("two", THERE, "token"):
        assert client.find("two", None, None) == client.FlightEndpoints("two", THERE)
        assert stat.S_IMODE(no_flight.stat().st_mode) == 0o700
    assert directory.running_swarms() == []


def test_several_flights_need_a_name(no_flight: Path) -> None:
    with directory.registered("one", HERE, "token"), directory.registered("two", THERE, "token"):
        with pytest.raises(client.BadOptions, match=r"one .*tcp/127.0.0.1:4001 .*two .*\[which-swarm\]"):
            client.find(None, None, None)
        with pytest.raises(BusError, match=r"three.*one .*two .*\[no-swarm\]"):
            client.find("three", None, None)


def test_two_flights_of_one_name_are_told_apart_by_their_endpoints(no_flight: Path) -> None:
    with directory.registered("one", HERE, "first" * 8):
        (record,) = no_flight.glob("one.*.json")
        other = json.loads(record.read_text()) | {"endpoint": str(THERE), "token": "second" * 8}
        with (no_flight / "one.1.json").open("w") as file:  # of another process
            file.write(json.dumps(other))
            file.flush()
            fcntl.flock(file, fcntl.LOCK_EX)
            for config in (None, listening(), listening(router="tcp/10.0.0.1:7447")):
                name = None if config is None else config.model_copy(update={"name": "one"})
                with pytest.raises(client.BadOptions, match=r"4002.*4001.*--connect tcp.*\[which-swarm\]"):
                    client.find("one", name, None)
            for swarm in ("one", None):
                found = client.find(swarm, None, str(THERE))
                assert found == client.FlightEndpoints("one", THERE)
                assert client.local_token(found) == "second" * 8


LISTED_FOR_EVER = """\
import sys, time
from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
with directory.registered("killed", BusEndpoint("127.0.0.1", 4003), "token"):
    print("listed", flush=True)
    time.sleep(60)
"""


def test_a_killed_flights_record_is_ignored_and_removed_by_the_next_flight(no_flight: Path) -> None:
    command = [sys.executable, "-c", LISTED_FOR_EVER]
    environment = {**os.environ, "TMPDIR": str(no_flight.parent)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "listed\n"
        (entry,) = directory.running_swarms()
        assert (entry.swarm, entry.pid) == ("killed", process.pid)
        process.kill()
    assert len(list(no_flight.iterdir())) == 1
    assert directory.running_swarms() == []
    assert len(list(no_flight.iterdir())) == 1, "readers leave a stale record alone"
    with directory.registered("next", HERE, "token"):
        assert [entry.swarm for entry in directory.running_swarms()] == ["next"]
    assert list(no_flight.glob("killed*")) == []


KILLED_BEFORE_IT_WAS_LISTED = """\
import os, pathlib, signal
from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
pathlib.Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
with directory.registered("killed", BusEndpoint("127.0.0.1", 4003), "token"):
    pass
"""


def test_the_draft_record_of_a_killed_flight_is_ignored_and_removed_by_the_next_flight(
    no_flight: Path,
) -> None:
    command = [sys.executable, "-c", KILLED_BEFORE_IT_WAS_LISTED]
    subprocess.run(command, env={**os.environ, "TMPDIR": str(no_flight.parent)}, check=False)
    assert [path.name[:8] for path in no_flight.iterdir()] == [".killed."]
    assert directory.running_swarms() == []
    with directory.registered("next", HERE, "token"):
        pass
    assert list(no_flight.glob(".killed*")) == []


def test_a_flight_that_is_being_registered_is_neither_removed_nor_found(
    no_flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process reads the directory just before the lock, and just before the file has its name."""
    lock, rename, looks = fcntl.flock, Path.rename, []

    def locks(file: Any, how: int) -> None:
        if how == fcntl.LOCK_EX and not looks:
            looks.append(directory.running_swarms())
        lock(file, how)

    def renames(draft: Path, path: Path) -> Path:
        looks.append(directory.running_swarms())
        return rename(draft, path)

    monkeypatch.setattr(fcntl, "flock", locks)
    monkeypatch.setattr(Path, "rename", renames)
    with directory.registered("one", HERE, "token"):
        assert looks == [[], []]
        assert [entry.swarm for entry in directory.running_swarms()] == ["one"]
    assert list(no_flight.glob("*.json")) == []


def test_a_full_disk_is_an_error_and_leaves_no_record(
    no_flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(json, "dump", full)
    with pytest.raises(BusError, match="No space left"), directory.registered("one", HERE, "token"):
        pass
    assert list(no_flight.iterdir()) == []


@pytest.mark.parametrize("name", [".", "..", ".dot", "-x", "_x", "", "a/b", "a*", "x" * 65])
def test_an_invalid_swarm_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        small(name=name)


@pytest.mark.parametrize("name", ["a", "7", "a.b", "x" * 64])
def test_a_valid_swarm_name_is_found(name: str, no_flight: Path) -> None:
    assert small(name=name).config.name == name
    with directory.registered(name, HERE, "token"):
        assert client.find(name, None, None) == client.FlightEndpoints(name, HERE)


def linked(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(folder.parent / "elsewhere")


def of_mode(mode: int) -> Callable[[Path], None]:
    def made(folder: Path) -> None:
        folder.mkdir()
        folder.chmod(mode)

    return made


@pytest.mark.parametrize("made", [of_mode(0o777), of_mode(0o750), of_mode(0o705), linked])
def test_a_folder_that_other_users_have_access_to_is_refused(
    made: Callable[[Path], None], no_flight: Path
) -> None:
    made(no_flight)
    with pytest.raises(BusError, match=r"swarmctl-\d+.*\[open-folder\]"):
        directory.running_swarms()
    with (
        pytest.raises(BusError, match=r"\[open-folder\]"),
        directory.registered("one", HERE, "t" * 32),
    ):
        pass


def test_a_flight_that_cannot_be_registered_shows_its_endpoint(no_flight: Path) -> None:
    no_flight.write_text("in the way")
    lines: list[str] = []

    async def scene() -> None:
        with open_bus("test", (1,), "tcp/127.0.0.1:0", "token", lines.append) as bus:
            assert bus.endpoint is not None
            assert f"--connect {bus.endpoint}" in lines[0]

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("listen", "warned"),
    [("tcp/127.0.0.1:0", False), ("tcp/localhost:0", False), ("none", False), ("tcp/0.0.0.0:0", True)],
)
def test_an_endpoint_open_to_other_machines_is_a_warning(listen: str, warned: bool, no_flight: Path) -> None:
    lines: list[str] = []

    async def scene() -> None:
        with open_bus("test", (1,), listen, "token", lines.append) as bus:
            found = [entry.endpoint for entry in directory.running_swarms()]
            assert found == ([bus.endpoint.client_endpoint] if bus.endpoint is not None else [])

    asyncio.run(scene())
    assert any("[open-endpoint]" in text for text in lines) is warned


def listening(**communication: object) -> Any:
    return small(communication=communication).config


@pytest.mark.parametrize(
    ("swarm", "config", "connect", "expected"),
    [
        (None, listening(listen="tcp/0.0.0.0:7447"), None, ("small", BusEndpoint("127.0.0.1", 7447))),
        (None, listening(), "tcp/ground:7447", ("small", BusEndpoint("ground", 7447))),
        ("one", None, "tcp/[::1]:7447", ("one", BusEndpoint("::1", 7447))),
    ],
)
def test_a_given_endpoint_needs_no_search(
    no_flight: Path, swarm: str | None, config: Any, connect: str | None, expected: tuple[str, BusEndpoint]
) -> None:
    assert client.find(swarm, config, connect) == client.FlightEndpoints(*expected)


@pytest.mark.parametrize(
    ("swarm", "config", "connect", "reason"),
    [
        (None, None, "tcp/ground:7447", "which-swarm"),
        ("one", None, "ground:7447", "tcp/HOST:PORT"),
        ("one", None, "tcp/ground:0", "port 0"),
        ("o*", None, None, "--swarm"),
        (".dot", None, None, "--swarm"),
        ("a/b", None, None, "--swarm"),
        ("one", listening(), None, "--swarm is one, .* small"),
        (None, listening(listen="none"), None, "not-listening"),
        (None, listening(bus="memory"), None, "not-listening"),
    ],
)
def test_options_that_name_no_swarm_are_refused(
    no_flight: Path, swarm: str | None, config: Any, connect: str | None, reason: str
) -> None:
    with pytest.raises(client.BadOptions, match=reason):
        client.find(swarm, config, connect)


APART: dict[str, object] = {"router": "tcp/10.0.0.1:7447"}
MESHED: dict[str, object] = {"mesh": {"uav1": "tcp/10.0.0.1:7447", "uav2": "tcp/10.0.0.2:7447"}}
VEHICLES = {1: "uav1", 2: "uav2", 3: "uav3"}
ROUTER, OTHER = BusEndpoint("10.0.0.1", 7447), BusEndpoint("10.0.0.2", 7447)


def meant(communication: dict[str, object], connect: str | None = None) -> client.FlightEndpoints:
    return client.find(None, listening(bus="zenoh", **communication), connect)


def test_agents_in_several_processes_are_asked_at_the_router_or_in_the_mesh(no_flight: Path) -> None:
    assert meant(APART) == client.FlightEndpoints("small", ROUTER, agents=VEHICLES)
    assert meant(MESHED) == client.FlightEndpoints("small", ROUTER, (OTHER,), VEHICLES)
    assert meant(APART, "tcp/10.0.0.2:7447") == client.FlightEndpoints("small", OTHER, agents=VEHICLES)


def test_a_flight_of_one_process_on_this_machine_comes_first(no_flight: Path) -> None:
    here = BusEndpoint("127.0.0.1", 4001)
    with directory.registered("small", here, "token"):
        assert meant(APART) == client.FlightEndpoints("small", here)
    with directory.registered("another", here, "token"):
        assert meant(APART).agents == VEHICLES


def test_a_flight_that_has_ended_is_not_found(no_flight: Path) -> None:
    with directory.registered("one", HERE, "token"):
        assert client.find("one", None, None) == client.FlightEndpoints("one", HERE)
    with pytest.raises(BusError, match=r"may have ended.*\[no-swarm\]"):
        client.find("one", None, None)
    with directory.registered("one", HERE, "token"):
        assert client.find("one", None, None) == client.FlightEndpoints("one", HERE)


def test_agents_that_have_landed_are_silent(no_flight: Path) -> None:
    station = client.FlightEndpoints("s", HERE, agents={1: "a", 2: "b"})

    async def scene() -> list[VehicleAnswer]:
        return list(await commands.ask(MemoryBus(), station, GiveOrder(None, "return")))

    answers = run_virtual(scene())
    assert [answer.outcome for answer in answers] == ["silent", "silent"]
    assert all("[agent-silent]" in answer.note for answer in answers)


@pytest.mark.parametrize(
    ("age_s", "text"), [(0.4, "0 s"), (119.0, "119 s"), (120.0, "2 min"), (7200.0, "2 h")]
)
def test_a_flights_age_is_in_its_largest_unit(age_s: float, text: str) -> None:
    assert client.duration_text(age_s) == text


# --- the command line


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--w 0.5", "[which-vehicles]"),
        ("--all", "[nothing-to-change]"),
        ("--all --w 1.5", "w = 1.5: "),
        ("--all --w nan", "w = nan: "),
        ("--all --w a", "Invalid value for '--w'"),
        ("--all --firing-strength 0.7,0.3", "--firing-strength 0.7,0.3: "),
        ("--all --firing-strength a,b,c", "--firing-strength a,b,c: "),
        ("--all --firing-strength 0.1,0.3,0.7", "decrease strictly"),
    ],
)
def test_an_unclear_command_is_a_usage_error(words: str, reason: str, no_flight: Path) -> None:
    result = CliRunner().invoke(cli, ["set", *words.split()])
    assert result.exit_code == 2
    assert reason in result.stderr


def test_a_command_is_given_and_answered(no_flight: Path) -> None:
    with station_in_a_thread() as station:
        result = CliRunner().invoke(cli, ["set", "--all", "--w", "0.2", "--firing-strength", "0.7,0.3,0.1"])
    assert result.exit_code == 0
    for name, line in zip(("uav1", "uav2"), result.stdout.splitlines(), strict=True):
        assert line.startswith(f"{name}: w = 0.2 ")
        assert all(value in line for value in ("0.7, 0.3, 0.1", "plan 5"))
    assert station.posted[0] == (1, ev.WeightsChanged(1, 0.2, FiringStrength(0.7, 0.3, 0.1)))
