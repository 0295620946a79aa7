"""How the command line finds a swarm in flight, and gives it commands."""

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
from pathlib import Path
from typing import Any

import pytest
from flights import small
from station_threads import station_in_a_thread
from typer.testing import CliRunner

from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.open import open_bus
from swarmctl.cli.main import cli
from swarmctl.core import events as ev
from swarmctl.core.threat import FiringStrength
from swarmctl.station import client


@pytest.fixture
def nobody_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"swarmctl-{os.getuid()}"


HERE, THERE = BusEndpoint("127.0.0.1", 4001), BusEndpoint("127.0.0.1", 4002)


def test_a_flight_is_found_by_its_name_as_long_as_it_lasts(nobody_flies: Path) -> None:
    with directory.registered("one", HERE), directory.registered("two", THERE):
        assert client.find("two", None, None) == client.Station("two", THERE)
        assert stat.S_IMODE(nobody_flies.stat().st_mode) == 0o700
    assert directory.running_swarms() == []


def test_the_only_flight_need_not_be_named(nobody_flies: Path) -> None:
    with directory.registered("one", HERE):
        assert client.find(None, None, None) == client.Station("one", HERE)


def test_of_several_flights_none_is_guessed(nobody_flies: Path) -> None:
    with directory.registered("one", HERE), directory.registered("two", THERE):
        with pytest.raises(client.Unclear, match=r"one at tcp/127.0.0.1:4001 .*two at .*--swarm NAME"):
            client.find(None, None, None)
        with pytest.raises(BusError, match=r"no swarm three of this user flies .*; there is one, two"):
            client.find("three", None, None)


LISTED_FOR_EVER = """\
import sys, time
from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
with directory.listed("killed", BusEndpoint("127.0.0.1", 4003)):
    print("listed", flush=True)
    time.sleep(60)
"""


def test_what_a_killed_flight_left_is_known_for_that_and_removed(nobody_flies: Path) -> None:
    command = [sys.executable, "-c", LISTED_FOR_EVER]
    environment = {**os.environ, "TMPDIR": str(nobody_flies.parent)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "listed\n"
        (entry,) = directory.running_swarms()
        assert (entry.swarm, entry.pid) == ("killed", process.pid)
        process.kill()
    assert len(list(nobody_flies.iterdir())) == 1
    assert directory.running_swarms() == []
    assert list(nobody_flies.iterdir()) == []


KILLED_BEFORE_IT_WAS_LISTED = """\
import os, pathlib, signal
from swarmctl.bus import directory
from swarmctl.bus.endpoint import BusEndpoint
pathlib.Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
with directory.listed("killed", BusEndpoint("127.0.0.1", 4003)):
    pass
"""


def test_what_a_flight_left_that_was_killed_before_it_was_listed_is_removed(nobody_flies: Path) -> None:
    command = [sys.executable, "-c", KILLED_BEFORE_IT_WAS_LISTED]
    subprocess.run(command, env={**os.environ, "TMPDIR": str(nobody_flies.parent)}, check=False)
    assert [path.name[:8] for path in nobody_flies.iterdir()] == [".killed."]
    assert directory.running_swarms() == []
    assert list(nobody_flies.iterdir()) == []


def test_a_flight_that_is_about_to_be_listed_is_neither_removed_nor_found(
    nobody_flies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody looks just before it has its lock, and just before it has its name."""
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
    with directory.registered("one", HERE):
        assert looks == [[], []]
        assert [entry.swarm for entry in directory.running_swarms()] == ["one"]
    assert list(nobody_flies.iterdir()) == []


def test_a_folder_that_can_not_be_written_to_is_said_and_nothing_is_left(
    nobody_flies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(json, "dump", full)
    with pytest.raises(BusError, match="No space left"), directory.registered("one", HERE):
        pass
    assert list(nobody_flies.iterdir()) == []


@pytest.mark.parametrize("name", [".", "..", ".dot", "-x", "_x", "", "a/b", "a*", "x" * 65])
def test_a_name_that_nobody_could_find_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        small(name=name)


@pytest.mark.parametrize("name", ["a", "7", "a.b", "x" * 64])
def test_a_swarm_of_any_other_name_is_found(name: str, nobody_flies: Path) -> None:
    assert small(name=name).config.name == name
    with directory.registered(name, HERE):
        assert client.find(name, None, None) == client.Station(name, HERE)


def test_a_folder_that_others_can_write_to_is_not_believed(nobody_flies: Path) -> None:
    nobody_flies.mkdir(mode=0o700)
    nobody_flies.chmod(0o777)
    with pytest.raises(BusError, match="nobody else can write to"):
        directory.running_swarms()


def test_a_flight_that_cannot_be_listed_says_how_it_is_reached(nobody_flies: Path) -> None:
    nobody_flies.write_text("in the way")
    said: list[str] = []

    async def scene() -> None:
        with open_bus("test", "tcp/127.0.0.1:0", said.append) as bus:
            assert bus.endpoint is not None
            assert f"--connect {bus.endpoint}" in said[0]

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("listen", "warned"),
    [("tcp/127.0.0.1:0", False), ("tcp/localhost:0", False), ("none", False), ("tcp/0.0.0.0:0", True)],
)
def test_who_listens_to_others_than_this_machine_says_so(
    listen: str, warned: bool, nobody_flies: Path
) -> None:
    said: list[str] = []

    async def scene() -> None:
        with open_bus("test", listen, said.append) as bus:
            found = [entry.endpoint for entry in directory.running_swarms()]
            assert found == ([bus.endpoint.reachable] if bus.endpoint is not None else [])

    asyncio.run(scene())
    assert any("can change this swarm's weights" in text for text in said) is warned


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
def test_an_endpoint_that_is_said_needs_no_search(
    nobody_flies: Path, swarm: str | None, config: Any, connect: str | None, expected: tuple[str, BusEndpoint]
) -> None:
    assert client.find(swarm, config, connect) == client.Station(*expected)


@pytest.mark.parametrize(
    ("swarm", "config", "connect", "why"),
    [
        (None, None, "tcp/ground:7447", "which swarm"),
        ("one", None, "ground:7447", "expected tcp/HOST:PORT"),
        ("one", None, "tcp/ground:0", "port 0"),
        ("o*", None, None, "expected a name"),
        (".dot", None, None, "expected a name"),
        ("a/b", None, None, "expected a name"),
        ("one", listening(), None, "the configuration is that of small"),
        (None, listening(listen="none"), None, "listens to nobody"),
        (None, listening(bus="memory"), None, "listens to nobody"),
    ],
)
def test_what_does_not_say_which_swarm_is_meant_is_refused(
    nobody_flies: Path, swarm: str | None, config: Any, connect: str | None, why: str
) -> None:
    with pytest.raises(client.Unclear, match=why):
        client.find(swarm, config, connect)


def test_the_configuration_refuses_what_is_no_endpoint() -> None:
    with pytest.raises(ValueError, match="expected tcp/HOST:PORT"):
        listening(listen="127.0.0.1:7447")
    assert json.loads(listening().model_dump_json())["communication"]["listen"] == "tcp/127.0.0.1:0"


# --- the command line


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("--w 0.5", "which vehicles? give --uav NAME (or its system id), which may be repeated, or --all"),
        ("--all --uav 1 --w 0.5", "which vehicles?"),
        ("--all", "nothing to change"),
        ("--all --w 1.5", "w = 1.5: expected 0"),
        ("--all --w nan", "w = nan: expected 0"),
        ("--all --w a", "Invalid value for '--w'"),
        ("--all --direct 0.7", "found 1, expected three"),
        ("--all --firing-strength 0.7,0.3", "found 2, expected three"),
        ("--all --firing-strength a,b,c", "expected three numbers"),
        ("--all --firing-strength 0.1,0.3,0.7", "decrease strictly"),
        ("--all --firing-strength 0.7,0.3,0.1 --direct 0.7", "says all three"),
        ("--all --w 0.5 --connect tcp/127.0.0.1:7447", "which swarm"),
        ("--all --w 0.5 --config nowhere.yaml", "there is no such file"),
    ],
)
def test_a_command_that_is_not_clear_is_a_wrong_usage(words: str, why: str, nobody_flies: Path) -> None:
    result = CliRunner().invoke(cli, ["set", *words.split()])
    assert result.exit_code == 2
    assert why in result.stderr


def test_where_no_swarm_flies_it_says_so(nobody_flies: Path) -> None:
    result = CliRunner().invoke(cli, ["set", "--uav", "3", "--w", "0.2"])
    assert result.exit_code == 1
    assert "no swarm of this user flies on this machine; a flight takes commands in real" in result.stderr
    assert "--clock virtual" in result.stderr


def test_a_command_is_given_and_answered(nobody_flies: Path) -> None:
    with station_in_a_thread() as station:
        words = "set --all --w 0.2 --direct 0.7 --first-neighbour 0.3 --second-neighbour 0.1"
        result = CliRunner().invoke(cli, words.split())
    assert result.exit_code == 0
    said = "w = 0.2 and firing strengths 0.7, 0.3, 0.1 from plan 5 on"
    said += "; plan 5 follows if another route is better"
    assert result.stdout.splitlines() == [f"uav1: {said}", f"uav2: {said}"]
    assert station.posted[0] == (1, ev.WeightsChanged(1, 0.2, FiringStrength(0.7, 0.3, 0.1)))


def test_a_command_for_a_vehicle_that_is_not_there_is_an_error_said_by_the_swarm(nobody_flies: Path) -> None:
    with station_in_a_thread():
        result = CliRunner().invoke(cli, ["set", "--uav", "1", "--uav", "9", "--w", "0.2"])
    assert result.exit_code == 1
    assert "test refused: nothing was changed: no vehicle has the system id or name 9" in result.stderr


def test_a_command_names_vehicles_by_name_or_system_id(nobody_flies: Path) -> None:
    with station_in_a_thread() as station:
        result = CliRunner().invoke(cli, ["set", "--uav", "uav2", "--uav", "1", "--w", "0.2"])
    assert result.exit_code == 0
    assert [uav for uav, _ in station.posted] == [1, 2]
