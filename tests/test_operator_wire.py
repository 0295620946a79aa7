"""An operator's commands on the wire: what is taken, what is refused, and who can come in at all."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import json
import math
import os
import re
import socket
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
from flights import small
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from swarmctl import operate
from swarmctl.bus import desk, directory, keys
from swarmctl.bus.base import MAX_MESSAGE_BYTES, MAX_QUESTION_BYTES, BusError, Transport
from swarmctl.bus.desk import Desk, Tally
from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.memory import MemoryBus
from swarmctl.bus.open import opened
from swarmctl.bus.zenoh_bus import QUESTIONS, ZenohBus
from swarmctl.cli import cli
from swarmctl.clock import run_virtual
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    OperatorAnswer,
    SetWeights,
    VehicleAnswer,
    decode_answer,
    decode_command,
    encode,
)
from swarmctl.core.roster import meant_by
from swarmctl.core.threat import FiringStrength
from swarmctl.preflight import machine

KEY = "swarmctl/test/station/request/weights/operator"
ANYWHERE = BusEndpoint("127.0.0.1", 0)


def packed(**fields: object) -> bytes:
    return b"\x01" + msgspec.msgpack.encode({"type": "set_weights", **fields})


WRONG: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "empty payload"),
    "no MessagePack": (b"\x01nonsense", "not a message of version 1"),
    "another version": (b"\x02" + packed(uavs=[1], w=0.5)[1:], "message version 2"),
    "a message of UAVs": (b"\x01" + msgspec.msgpack.encode({"type": "state", "sender": 1}), "Invalid value"),
    "w above 1": (packed(uavs=[1], w=1.5), "w = 1.5: expected 0"),
    "w below 0": (packed(uavs=[1], w=-0.1), "w = -0.1: expected 0"),
    "w not a number": (packed(uavs=[1], w=math.nan), "w = nan: expected 0"),
    "w a truth value": (packed(uavs=[1], w=True), "Expected `float | null`, got `bool`"),
    "strengths that grow": (packed(uavs=[1], firing_strength=[0.1, 0.3, 0.6]), "decrease strictly"),
    "strengths above 1": (packed(uavs=[1], firing_strength=[1.1, 0.3, 0.1]), "probabilities in [0, 1]"),
    "two strengths": (packed(uavs=[1], firing_strength=[0.6, 0.3]), "length 3, got 2"),
    "nothing to change": (packed(uavs=[1]), "nothing to change"),
    "nobody named": (packed(uavs=[], w=0.5), "no vehicle named"),
    "silent about whom": (packed(w=0.5), "missing required field `uavs`"),
    "more than is known": (packed(uavs=[1], w=0.5, psi=3.0), "unknown field `psi`"),
    "more vehicles than there can be": (
        packed(uavs=[1] * 255, w=0.5),
        "255 vehicles named: expected at most",
    ),
    "no system id": (packed(uavs=[0], w=0.5), "system id 0: expected 1 to 254"),
    "a system id too high": (packed(uavs=[255], w=0.5), "system id 255: expected 1 to 254"),
    "an empty name": (packed(uavs=[""], w=0.5), "name of 0 characters"),
    "a name too long": (packed(uavs=["x" * 33], w=0.5), "name of 33 characters"),
}
FOREIGN: dict[str, tuple[bytes, str]] = {
    "a vehicle of another swarm": (
        packed(uavs=[1, 9], w=0.5),
        "nothing was changed: no vehicle has the system id or name 9; there is 1 (uav1), 2 (uav2)",
    ),
    "a name of another swarm": (packed(uavs=["alpha"], w=0.5), "no vehicle has the system id or name alpha;"),
    "many of another swarm": (
        packed(uavs=list(range(10, 100)), w=0.5),
        "name 10, 11, 12, 13, 14, 15, 16, 17, 18, 19 and 80 more; there is 1 (uav1)",
    ),
    "too long to be read": (packed(uavs=[1], w=0.5) + bytes(MAX_QUESTION_BYTES), "more than 16384 bytes"),
}
"""what the desk alone can refuse"""


@pytest.mark.parametrize("name", WRONG)
def test_what_makes_no_sense_is_no_command(name: str) -> None:
    payload, why = WRONG[name]
    with pytest.raises(BadMessage) as refused:
        decode_command(payload)
    assert why in str(refused.value)


@given(
    uavs=st.none()
    | st.lists(st.integers(1, 254) | st.text(min_size=1, max_size=32), min_size=1, max_size=5).map(tuple),
    w=st.floats(0.0, 1.0),
    strengths=st.none() | st.just((0.7, 0.3, 0.1)),
)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_a_command_survives_the_wire(
    uavs: tuple[int | str, ...] | None, w: float, strengths: tuple[float, float, float] | None
) -> None:
    command = SetWeights(uavs, w, strengths)
    assert decode_command(encode(command)) == command


@given(st.binary(max_size=60))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_whatever_arrives_at_the_desk_is_a_command_or_refused(data: bytes) -> None:
    with suppress(BadMessage):
        decode_command(b"\x01" + data)
    with suppress(BadMessage):
        decode_answer(b"\x01" + data)


def test_an_answer_of_a_later_version_is_understood_as_far_as_it_is_known() -> None:
    later = {"type": "operator_answer", "refused": "no", "vehicles": [], "more": 1}
    assert decode_answer(b"\x01" + msgspec.msgpack.encode(later)) == OperatorAnswer(refused="no")


# --- the desk, over every transport


class Station:
    """A desk with two agents that take everything at once, unless they are slow."""

    def __init__(self, transport: Transport, *, slow: tuple[int, ...] = ()) -> None:
        self.said: list[str] = []
        self.tally = Tally()
        self.posted: list[tuple[int, ev.WeightsChanged]] = []
        self.desk = Desk(transport, "test", self.said.append, self.tally)
        for uav in (1, 2):
            self.desk.join(uav, f"uav{uav}", self._agent(uav, slow=uav in slow))

    def _agent(self, uav: int, *, slow: bool) -> Callable[[ev.WeightsChanged], None]:
        def post(event: ev.WeightsChanged) -> None:
            self.posted.append((uav, event))
            if not slow:
                self.desk.answered(event.command, VehicleAnswer(uav, f"uav{uav}", "taken", 5))

        return post


@contextmanager
def in_memory() -> Iterator[tuple[Transport, Transport]]:
    bus = MemoryBus()
    yield bus, bus


@contextmanager
def over_zenoh() -> Iterator[tuple[Transport, Transport]]:
    """(the ground station's bus, the operator's), as two processes would have them."""
    with ZenohBus(listen=ANYWHERE, open_keys=(KEY,)) as ground:
        assert ground.endpoint is not None
        with ZenohBus(connect=ground.endpoint) as operator:
            yield ground, operator


Both = Callable[[], contextlib.AbstractContextManager[tuple[Transport, Transport]]]


@pytest.fixture(params=[in_memory, over_zenoh])
def both(request: pytest.FixtureRequest) -> Both:
    made: Both = request.param
    return made


def test_a_command_reaches_the_vehicles_it_names_and_their_answers_come_back(both: Both) -> None:
    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            command = SetWeights((2,), firing_strength=(0.7, 0.3, 0.1))
            (answer,) = await operator.ask(KEY, encode(command), 5.0)
            assert decode_answer(answer) == OperatorAnswer((VehicleAnswer(2, "uav2", "taken", 5),))
            assert station.posted == [(2, ev.WeightsChanged(1, None, FiringStrength(0.7, 0.3, 0.1)))]
            (answer,) = await operator.ask(KEY, encode(SetWeights(None, w=0.2)), 5.0)
            assert [v.uav for v in decode_answer(answer).vehicles] == [1, 2]
            assert [event.command for _, event in station.posted] == [1, 2, 2]

    asyncio.run(scene())


def test_what_is_no_command_for_this_swarm_moves_nobody_is_counted_shown_and_answered(
    both: Both, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(desk, "BURST", 99)

    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            for number, (payload, why) in enumerate((WRONG | FOREIGN).values(), start=1):
                (answer,) = await operator.ask(KEY, payload, 5.0)
                assert why in decode_answer(answer).refused
                assert station.tally == Tally(passed_on=0, refused=number)
                assert why in station.said[-1]
            assert station.posted == []

    asyncio.run(scene())


def test_the_largest_command_that_makes_sense_is_read() -> None:
    names = tuple("\N{BLACK STAR}" * 8 + f"{n:08}" for n in range(254))
    assert all(len(name.encode()) == 32 for name in names)
    assert len(encode(SetWeights(names, 0.5, (0.7, 0.3, 0.1)))) <= MAX_QUESTION_BYTES


def test_a_flood_of_bytes_ends_at_the_door() -> None:
    """Zenoh drops what is larger than its listener allows; the operator hears of it as of silence."""

    async def scene() -> None:
        with over_zenoh() as (ground, operator):
            station = Station(ground)
            with suppress(TimeoutError):
                assert await operator.ask(KEY, bytes(4 * MAX_MESSAGE_BYTES), 1.0) == ()
            assert station.tally == Tally()
            assert ground.endpoint is not None
            with ZenohBus(connect=ground.endpoint) as another:
                assert len(await another.ask(KEY, encode(SetWeights((1,), w=0.2)), 5.0)) == 1

    asyncio.run(scene())


def test_commands_that_come_too_fast_are_refused_and_said_once_until_there_was_a_pause() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)

        async def give(n: int) -> list[str]:
            answers = [await bus.ask(KEY, encode(SetWeights((1,), w=0.2)), 5.0) for _ in range(n)]
            return [decode_answer(answer).refused for (answer,) in answers]

        for flood in (1, 2):
            refused = await give(30)
            assert refused[:8] == [""] * 8
            assert all("faster than 4 a second; nothing was changed" in why for why in refused[8:])
            assert station.tally == Tally(passed_on=8 * flood, refused=22 * flood)
            assert len(station.posted) == 8 * flood
            assert len(station.said) == flood
            await asyncio.sleep(2.0)
        await give(8)
        await asyncio.sleep(0.5)
        assert await give(2) == ["", ""]
        assert len(station.said) == 2

    run_virtual(scene())


def test_a_wildcard_that_comes_too_fast_is_not_even_said() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        served = bus._served[KEY]  # which matches no wildcards by itself
        for _ in range(99):
            served("**", b"", lambda _: pytest.fail("a wildcard was answered"))
        assert station.tally.refused == 99
        assert len(station.said) == desk.BURST + 1

    run_virtual(scene())


def test_questions_displace_nothing_that_vehicles_tell_each_other() -> None:
    """None is served before the loop turns: what is too much by then is let go, its asker told nothing."""

    async def scene() -> None:
        heard: list[bytes] = []
        with ZenohBus() as bus:
            bus.subscribe("swarmctl/test/uav/1/**", lambda _, payload: heard.append(payload))
            bus.serve(KEY, lambda _, payload, reply: reply(payload or b""))
            asked = [asyncio.create_task(bus.ask(KEY, b"?", 5.0)) for _ in range(5 * QUESTIONS)]
            await asyncio.sleep(0)
            bus.put("swarmctl/test/uav/1/inform/state/2", b"here")
            answers = await asyncio.gather(*asked)
            assert heard == [b"here"]
            assert [a for a in answers if a] == [(b"?",)] * (len(answers) - bus.dropped)
            assert bus.dropped > 0

    asyncio.run(scene())


def test_what_is_shown_of_a_command_cannot_steer_a_terminal() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        await bus.ask(KEY, packed(uavs=[1], **{"\x1b[2J" + "x" * 9999: 1}), 5.0)
        (text,) = station.said
        assert text.isprintable()
        assert len(text) < 500

    asyncio.run(scene())


def test_nobody_answers_for_another_swarm(both: Both) -> None:
    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            key = keys.request("other", "weights")
            assert await operator.ask(key, encode(SetWeights(None, w=0.2)), 5.0) == ()
            assert station.posted == []

    asyncio.run(scene())


def test_a_vehicle_that_is_busy_is_not_waited_for() -> None:
    async def scene() -> tuple[OperatorAnswer, float]:
        bus = MemoryBus()
        Station(bus, slow=(2,))
        began_s = asyncio.get_running_loop().time()
        answer = await operate.ask(bus, operate.Station("test", ANYWHERE), SetWeights(None, w=0.2))
        return answer, asyncio.get_running_loop().time() - began_s

    answer, took_s = run_virtual(scene())
    assert [v.outcome for v in answer.vehicles] == ["taken", "unconfirmed"]
    assert "has not come to it within 3 s" in answer.vehicles[1].note
    assert took_s == pytest.approx(3.0)
    assert operate.has_failed(SetWeights(None, w=0.2), answer)


def test_a_vehicle_is_given_no_command_before_it_has_come_to_the_last() -> None:
    async def scene() -> None:
        bus, there = MemoryBus(), operate.Station("test", ANYWHERE)
        station = Station(bus, slow=(2,))
        await operate.ask(bus, there, SetWeights((2,), w=0.2))
        assert len(station.posted) == 1

        both_named = await operate.ask(bus, there, SetWeights(None, w=0.3))
        assert [(v.uav, v.outcome) for v in both_named.vehicles] == [(1, "taken"), (2, "refused")]
        assert "has not come to the command before" in both_named.vehicles[1].note
        assert operate.has_failed(SetWeights(None, w=0.3), both_named)

        alone = await operate.ask(bus, there, SetWeights((2,), w=0.3))
        assert "has come to the command before" in alone.refused
        assert [(uav, event.command) for uav, event in station.posted] == [(2, 1), (1, 2)]
        assert station.tally == Tally(passed_on=2, refused=1)

        # Its answer comes after all: nobody waits for it, but it is free.
        station.desk.answered(1, VehicleAnswer(2, "uav2", "taken", 5))
        await operate.ask(bus, there, SetWeights((2,), w=0.3))
        assert [(uav, event.command) for uav, event in station.posted] == [(2, 1), (1, 2), (2, 3)]

    run_virtual(scene())


def test_a_vehicle_is_named_by_its_name_or_its_system_id() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        for uavs in ((2,), ("2",), ("uav2",), ("uav2", 2)):
            answer = await operate.ask(bus, operate.Station("test", ANYWHERE), SetWeights(uavs, w=0.2))
            assert [v.uav for v in answer.vehicles] == [2]
        assert [uav for uav, _ in station.posted] == [2] * 4

    run_virtual(scene())


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["alpha"], [3]), (["3"], [3]), ([3], [3]), (["7"], [5]), (["5"], [5]), (["9", "alpha", 3], [3, 9]),
        (["03"], "no vehicle has the system id or name 03; there is 3 (alpha), 5 (7), 9 (3x), 11 (9x)"),
        (["Alpha"], "no vehicle has"),
        ([""], "no vehicle has"),
    ],
)  # fmt: skip
def test_a_name_or_system_id_means_one_vehicle(words: list[int | str], meant: list[int] | str) -> None:
    names = {3: "alpha", 5: "7", 9: "3x", 11: "9x"}
    if isinstance(meant, list):
        assert meant_by(words, names) == meant
    else:
        with pytest.raises(ValueError, match=re.escape(meant)):
            meant_by(words, names)


def test_a_word_that_is_the_name_of_one_and_the_system_id_of_another_is_not_guessed() -> None:
    with pytest.raises(ValueError, match=r"3 means two vehicles, 3 \(alpha\), 5 \(3\): say the one by"):
        meant_by(["3"], {3: "alpha", 5: "3"})


def test_a_station_that_is_stuck_is_said_to_leave_it_open() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        bus.serve(KEY, lambda key, payload, reply: None)
        await operate.ask(bus, operate.Station("test", ANYWHERE), SetWeights((1,), w=0.2))

    with pytest.raises(operate.NoAnswer, match="whether it took the command is not known"):
        run_virtual(scene())


# --- who can come in


def test_a_wildcard_is_refused_and_counted() -> None:
    """Asked inside the process, where no access rule stands before the desk."""

    async def scene() -> None:
        with ZenohBus() as bus:
            station = Station(bus)
            for key in ("swarmctl/*/station/request/weights/operator", "swarmctl/test/**", "**"):
                assert await bus.ask(key, encode(SetWeights(None, w=0.2)), 5.0) == ()
            assert station.posted == []
            assert station.tally.refused == 1 + 2 + 2  # once at each key that is meant

    asyncio.run(scene())


def test_from_outside_one_can_ask_under_one_key_and_nothing_else() -> None:
    async def scene() -> None:
        heard: list[str] = []
        overheard: list[str] = []
        with over_zenoh() as (ground, operator):
            station = Station(ground)
            ground.subscribe(keys.inbox("test", 1), lambda key, _: heard.append(key))
            ground.subscribe("**", lambda key, _: heard.append(key))
            operator.subscribe("swarmctl/test/**", lambda key, _: overheard.append(key))
            for key in (
                "swarmctl/test/uav/1/inform/state/9",
                "swarmctl/test/uav/*/inform/state/9",
                "**",
                KEY,
            ):
                operator.put(key, b"from outside")
            for key in ("swarmctl/*/station/request/weights/operator", "swarmctl/test/**", "**"):
                assert await operator.ask(key, encode(SetWeights(None, w=0.2)), 5.0) == ()
            ground.put("swarmctl/test/uav/1/inform/state/2", b"among ourselves")
            # What came before on the same connection has been looked at when this is answered.
            assert len(await operator.ask(KEY, encode(SetWeights((1,), w=0.2)), 5.0)) == 1
            assert heard == ["swarmctl/test/uav/1/inform/state/2"] * 2
            assert station.tally == Tally(passed_on=1, refused=0)
            # Its own it hears at once; of the swarm's nothing.
            assert "swarmctl/test/uav/1/inform/state/9" in overheard
            assert "swarmctl/test/uav/1/inform/state/2" not in overheard

    asyncio.run(scene())


def test_a_bus_by_itself_lets_nobody_in() -> None:
    async def scene() -> None:
        with ZenohBus() as bus:
            assert bus.endpoint is None

    asyncio.run(scene())


def taken_port(held: contextlib.ExitStack) -> int:
    holder = held.enter_context(contextlib.closing(socket.socket()))
    holder.bind(("127.0.0.1", 0))
    holder.listen()
    return int(holder.getsockname()[1])


def test_a_taken_port_is_said_with_the_cure() -> None:
    async def scene(port: int) -> None:
        with opened("test", f"tcp/127.0.0.1:{port}", print):
            pass

    with contextlib.ExitStack() as held:
        port = taken_port(held)
        with pytest.raises(
            BusError, match=rf"cannot listen at tcp/127.0.0.1:{port}: the port is taken; .*none"
        ):
            asyncio.run(scene(port))
        scenario = small(communication={"bus": "zenoh", "listen": f"tcp/127.0.0.1:{port}"})
        (line,) = machine.troubles(scenario, Path())
        assert f"communication.listen: tcp/127.0.0.1:{port}: port {port} is taken" in line


def test_where_nobody_listens_is_said() -> None:
    async def scene() -> None:
        with contextlib.ExitStack() as held:
            station = operate.Station("test", BusEndpoint("127.0.0.1", taken_port(held)))
        await operate.give(station, SetWeights(None, w=0.2))

    with pytest.raises(BusError, match=r"no swarm listens at tcp/127\.0\.0\.1:.* has its flight ended"):
        asyncio.run(scene())


@pytest.mark.parametrize(
    ("text", "host", "port", "loopback"),
    [
        ("tcp/127.0.0.1:7447", "127.0.0.1", 7447, True),
        ("tcp/localhost:0", "localhost", 0, True),
        ("tcp/[::1]:7447", "::1", 7447, True),
        ("tcp/0.0.0.0:7447", "0.0.0.0", 7447, False),
        ("tcp/ground.example:7447", "ground.example", 7447, False),
    ],
)
def test_an_endpoint_is_read_and_written(text: str, host: str, port: int, loopback: bool) -> None:
    endpoint = parse_endpoint(text)
    assert (endpoint.host, endpoint.port, endpoint.is_loopback) == (host, port, loopback)
    assert str(endpoint) == text


@pytest.mark.parametrize(
    "text",
    ["", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "udp/127.0.0.1:7447", "tcp/a:70000", "tcp/*:1"],
)
def test_what_is_no_endpoint_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected tcp/HOST:PORT"):
        parse_endpoint(text)


# --- finding a swarm


@pytest.fixture
def nobody_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"swarmctl-{os.getuid()}"


HERE, THERE = BusEndpoint("127.0.0.1", 4001), BusEndpoint("127.0.0.1", 4002)


def test_a_flight_is_found_by_its_name_as_long_as_it_lasts(nobody_flies: Path) -> None:
    with directory.listed("one", HERE), directory.listed("two", THERE):
        assert operate.find("two", None, None) == operate.Station("two", THERE)
        assert stat.S_IMODE(nobody_flies.stat().st_mode) == 0o700
    assert directory.flying() == []


def test_the_only_flight_need_not_be_named(nobody_flies: Path) -> None:
    with directory.listed("one", HERE):
        assert operate.find(None, None, None) == operate.Station("one", HERE)


def test_of_several_flights_none_is_guessed(nobody_flies: Path) -> None:
    with directory.listed("one", HERE), directory.listed("two", THERE):
        with pytest.raises(operate.Unclear, match=r"one at tcp/127.0.0.1:4001 .*two at .*--swarm NAME"):
            operate.find(None, None, None)
        with pytest.raises(BusError, match=r"no swarm three of this user flies .*; there is one, two"):
            operate.find("three", None, None)


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
        (entry,) = directory.flying()
        assert (entry.swarm, entry.pid) == ("killed", process.pid)
        process.kill()
    assert len(list(nobody_flies.iterdir())) == 1
    assert directory.flying() == []
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
    assert directory.flying() == []
    assert list(nobody_flies.iterdir()) == []


def test_a_flight_that_is_about_to_be_listed_is_neither_removed_nor_found(
    nobody_flies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody looks just before it has its lock, and just before it has its name."""
    lock, rename, looks = fcntl.flock, Path.rename, []

    def locks(file: Any, how: int) -> None:
        if how == fcntl.LOCK_EX and not looks:
            looks.append(directory.flying())
        lock(file, how)

    def renames(draft: Path, path: Path) -> Path:
        looks.append(directory.flying())
        return rename(draft, path)

    monkeypatch.setattr(fcntl, "flock", locks)
    monkeypatch.setattr(Path, "rename", renames)
    with directory.listed("one", HERE):
        assert looks == [[], []]
        assert [entry.swarm for entry in directory.flying()] == ["one"]
    assert list(nobody_flies.iterdir()) == []


def test_a_folder_that_can_not_be_written_to_is_said_and_nothing_is_left(
    nobody_flies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(json, "dump", full)
    with pytest.raises(BusError, match="No space left"), directory.listed("one", HERE):
        pass
    assert list(nobody_flies.iterdir()) == []


@pytest.mark.parametrize("name", [".", "..", ".dot", "-x", "_x", "", "a/b", "a*", "x" * 65])
def test_a_name_that_nobody_could_find_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        small(name=name)


@pytest.mark.parametrize("name", ["a", "7", "a.b", "x" * 64])
def test_a_swarm_of_any_other_name_is_found(name: str, nobody_flies: Path) -> None:
    assert small(name=name).config.name == name
    with directory.listed(name, HERE):
        assert operate.find(name, None, None) == operate.Station(name, HERE)


def test_a_folder_that_others_can_write_to_is_not_believed(nobody_flies: Path) -> None:
    nobody_flies.mkdir(mode=0o700)
    nobody_flies.chmod(0o777)
    with pytest.raises(BusError, match="nobody else can write to"):
        directory.flying()


def test_a_flight_that_cannot_be_listed_says_how_it_is_reached(nobody_flies: Path) -> None:
    nobody_flies.write_text("in the way")
    said: list[str] = []

    async def scene() -> None:
        with opened("test", "tcp/127.0.0.1:0", said.append) as bus:
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
        with opened("test", listen, said.append) as bus:
            found = [entry.endpoint for entry in directory.flying()]
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
    assert operate.find(swarm, config, connect) == operate.Station(*expected)


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
    with pytest.raises(operate.Unclear, match=why):
        operate.find(swarm, config, connect)


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


@contextmanager
def station_in_a_thread() -> Iterator[Station]:
    """A ground station that listens while the command line runs beside it."""
    ready, over = threading.Event(), threading.Event()
    made: list[Station] = []

    async def scene() -> None:
        with opened("test", "tcp/127.0.0.1:0", print) as bus:
            made.append(Station(bus))
            ready.set()
            await asyncio.to_thread(over.wait)

    thread = threading.Thread(target=asyncio.run, args=(scene(),))
    thread.start()
    try:
        assert ready.wait(10.0)
        yield made[0]
    finally:
        over.set()
        thread.join()


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
