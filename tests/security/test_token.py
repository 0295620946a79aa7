"""The token of a flight: who does not have it can neither order, nor set, nor report."""

from __future__ import annotations

import asyncio
import os
import stat
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from flights import Ui, small
from operator_station import ANYWHERE, KEY, ORDER, Station, StubAgent

from swarmctl.bus import directory, keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.external_observations import BURST, ReportReceiver
from swarmctl.bus.operator_service import CHECKED_BURST, SHOWN_BURST
from swarmctl.bus.sensor_reports import RejectReason, Report, decode_answer
from swarmctl.bus.sensor_reports import encode as encode_report
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.open import open_bus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core import messages
from swarmctl.core.grid import Grid
from swarmctl.core.messages import GiveOrder, SetWeights, encode
from swarmctl.flight import operator_orders
from swarmctl.flight.resources import open_records, open_resources
from swarmctl.flight.run import DEFAULT_OPTIONS, run_of
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.security.files import KeyringError
from swarmctl.security.requests import TokenSigning, by_token, sign_request
from swarmctl.security.token import TOKEN_FILE, Token, new_token, token_of_environment
from swarmctl.station import client, commands
from swarmctl.station.commands import Answers

GRID = Grid(8, 8, 50.0, 46.0, 14.4)
LOOK = keys.sensor_report("test", 1)
REPORT = encode_report(Report(1, cells=((4, 7, True),)))
VEHICLES = keys.swarm_vehicles("test")
COMMANDS = {
    ORDER: encode(GiveOrder((2,), "land")),
    KEY: encode(SetWeights((2,), w=0.2)),
    VEHICLES: b"",
    LOOK: REPORT,
}


def why(data: bytes) -> str:
    """Return the reason of a refusal, "" for another answer."""
    answer = messages.decode_answer(data[64:], messages.VehicleAnswer)
    return answer.why if isinstance(answer, messages.Refusal) else ""


@pytest.fixture(autouse=True)
def users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of running swarms of the user that flies."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv(TOKEN_FILE, raising=False)
    return tmp_path / f"swarmctl-{os.getuid()}"


def test_another_user_who_knows_port_and_name_changes_nothing() -> None:
    """The attacker speaks Zenoh to the flight's port; it has all but the file with the token."""
    token, other = new_token(), new_token()

    def signed(key: str, by: Token = other, **changed: str) -> bytes:
        return sign_request("test", changed.get("key", key), COMMANDS[key], time.time(), by.sign)

    forgeries: list[Callable[[str], bytes]] = [
        lambda key: COMMANDS[key],
        lambda key: bytes(64) + COMMANDS[key],
        lambda key: bytes(64) + signed(key)[64:],
        signed,
        lambda key: signed(key, Token("")),
    ]

    async def scene() -> None:
        reports: list[object] = []
        with open_bus("test", (1, 2), "tcp/127.0.0.1:0", token.text, print) as ground:
            authentication = by_token("test", token, 5.0, time.time)
            station = Station(ground, authentication=authentication)
            receiver = ReportReceiver(
                ground,
                "test",
                1,
                GRID,
                time.time,
                lambda *report: reports.append(report),
                station.said.append,
                authentication=authentication,
            )
            assert ground.endpoint is not None
            with ZenohBus(zenoh_config.visitor(ground.endpoint)) as attacker:
                for forgery in forgeries:
                    for key in COMMANDS:
                        (answer,) = await attacker.ask(key, forgery(key), 5.0)
                        if key == LOOK:
                            assert not decode_answer(answer[64:]).taken
                        else:
                            assert "[wrong-token]" in why(answer)
                assert (station.posted, reports) == ([], [])
                assert station.counts.refused == 3 * len(forgeries)
                assert receiver.counts.refused == {RejectReason.UNSIGNED: len(forgeries)}
                assert len([text for text in station.said if "report" in text]) == 1  # shown once
                # What the operator sent cannot be sent again, not even by somebody who could read it.
                command = sign_request("test", KEY, COMMANDS[KEY], time.time(), token.sign)
                for refused in (False, True):
                    (answer,) = await attacker.ask(KEY, command, 5.0)
                    assert ("[command-replayed]" in why(answer)) is refused
                # Another vehicle refuses it.
                other_key = keys.request("test", "weights", 1)
                (answer,) = await attacker.ask(other_key, command, 5.0)
                assert "the request is for the key" in why(answer)
                assert len(station.posted) == 1
                # A flood of unsigned reports does not use up the sensor's own rate.
                for _ in range(2 * BURST):
                    attacker.put(LOOK, REPORT)
                (answer,) = await attacker.ask(LOOK, signed(LOOK, token), 5.0)
                assert decode_answer(answer[64:]).taken

    asyncio.run(scene())


def test_a_flood_without_the_token_keeps_no_command_out() -> None:
    token, answered = new_token(), []

    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, authentication=by_token("test", token, 5.0, time.time))
        flight, signing = (
            client.FlightEndpoints("test", ANYWHERE),
            TokenSigning("test", {}, token, time.time),
        )
        for _ in range(5000):
            bus._served[KEY](KEY, COMMANDS[KEY], answered.append)
        answer = await commands.ask(bus, flight, SetWeights(None, w=0.2), signing)
        assert [vehicle.outcome for vehicle in answer] == ["taken", "taken"]
        assert station.counts.refused == 5000
        assert len(answered) == CHECKED_BURST
        assert len(station.said) <= SHOWN_BURST

    run_virtual(scene())


@pytest.mark.parametrize("token", [None, new_token()])
def test_a_command_without_the_token_fails_with_a_remedy(token: Token | None) -> None:
    signing = TokenSigning("test", {}, token, time.time)

    async def scene() -> None:
        with open_bus("test", (1, 2), "tcp/127.0.0.1:0", "t" * 32, print) as ground:
            Station(ground, authentication=by_token("test", Token("t" * 32), 5.0, time.time))
            assert ground.endpoint is not None
            with ZenohBus(zenoh_config.visitor(ground.endpoint)) as bus:
                flight = client.FlightEndpoints("test", ground.endpoint)
                await commands.ask(bus, flight, SetWeights(None, w=0.2), signing)

    with pytest.raises(
        client.NoValidAnswer, match=r"SWARMCTL_TOKEN_FILE.*\[wrong-token\]" if token else "no-token"
    ):
        asyncio.run(scene())


def test_the_agents_whose_token_is_here_get_the_order_and_the_others_are_named() -> None:
    signing = TokenSigning("test", {1: new_token()}, None, time.time)
    flight = client.FlightEndpoints("test", ANYWHERE, agents={1: "uav1", 2: "uav2"})

    async def scene() -> list[str]:
        with ZenohBus() as bus:
            asked = await commands.ask(bus, flight, GiveOrder(None, "land"), signing)
        return [f"{answer.outcome}: {answer.note}" for answer in asked]

    first, second = asyncio.run(scene())
    assert first.startswith("silent")
    assert second.startswith("refused")
    assert "[no-token]" in second


def test_a_flight_demands_the_token_of_its_file(users_folder: Path, tmp_path: Path) -> None:
    """The file is there, and only for this user, before the flight accepts its first request."""
    scenario = small(
        communication={"bus": "zenoh"},
        vehicles=[
            {
                "name": "a",
                "sysid": 1,
                "url": "udpin://127.0.0.1:0",
                "start": {"lat_deg": 46.0, "lon_deg": 14.4},
                "goal": [7, 7],
            }
        ],
        simulate=None,
    )

    def check_token(checks: Authentication | None) -> None:
        (file,) = users_folder.glob("small.*.json")
        assert stat.S_IMODE(users_folder.stat().st_mode) == 0o700
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        (flight,) = directory.running_swarms()
        assert len(flight.token) >= 43  # 256 bits
        key = keys.request("small", "order", 1)
        assert checks is not None
        with pytest.raises(messages.BadMessage, match="wrong-token"):
            checks.verify(key, b"land")
        payload = sign_request("small", key, b"land", time.time(), Token(flight.token).sign)
        assert checks.verify(key, payload) == b"land"

    async def scene() -> None:
        run = run_of(scenario, tmp_path, Ui(), "real", lambda _: None, DEFAULT_OPTIONS)
        with open_records(run) as records:
            async with open_resources(run, None, records) as resources:
                check_token(resources.token_authentication)

    asyncio.run(scene())
    assert list(users_folder.glob("*.json")) == []


@pytest.mark.parametrize("command", [GiveOrder(None, "land"), SetWeights(None, w=0.2)])
@pytest.mark.parametrize("is_authenticated", [True, False])
def test_real_vehicles_take_nothing_from_a_bus_without_authentication(
    command: messages.Request, is_authenticated: bool
) -> None:
    token = new_token()
    authentication = by_token("small", token, 5.0, time.time) if is_authenticated else NO_AUTHENTICATION
    signing = TokenSigning("small", {}, token, time.time) if is_authenticated else NO_AUTHENTICATION
    taken = messages.VehicleAnswer(1, "alpha", "taken")
    agent = StubAgent("alpha", lambda _event, answer_to: answer_to(taken))
    members: Any = [  # not known to be simulated
        SimpleNamespace(name="alpha", identity=None, spec=SimpleNamespace(sysid=1), runner=agent)
    ]

    async def scene() -> Answers:
        bus = MemoryBus()
        operator_orders.operator_service_for(
            small(),
            bus,
            Ui().say,
            members,
            flies_all=True,
            has_keys=False,
            authentication=authentication,
        )
        return await commands.ask(bus, client.FlightEndpoints("small", ANYWHERE), command, signing)

    (answer,) = asyncio.run(scene())
    assert answer.outcome == ("taken" if is_authenticated else "refused")
    assert answer.note.endswith("[orders-need-keys]") is not is_authenticated


def test_the_token_of_a_file_serves_several_users_and_machines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "token"
    file.write_text("0123456789abcdef" * 4 + "\n")
    file.chmod(0o600)
    monkeypatch.setenv(TOKEN_FILE, str(file))
    assert token_of_environment() == Token("0123456789abcdef" * 4)


def other_readers(file: Path) -> None:
    file.chmod(0o640)


def linked(file: Path) -> None:
    file.rename(file.with_name("elsewhere"))
    file.symlink_to(file.with_name("elsewhere"))


def of_another_user(file: Path) -> None:
    os.chown(file, 12345, 12345)


UNUSABLE: dict[str, Callable[[Path], object]] = {
    "missing": Path.unlink,
    "a folder": lambda file: (file.unlink(), file.mkdir()),
    "a pipe": lambda file: (file.unlink(), os.mkfifo(file, 0o600)),
    "a symbolic link": linked,
    "readable by others": other_readers,
    "of another user": of_another_user,
    "too short": lambda file: file.write_text("secret"),
    "not ASCII": lambda file: file.write_text("é" * 40),
    "several lines": lambda file: file.write_text("a b\n" * 20),
}


@pytest.mark.parametrize("spoil", UNUSABLE.values(), ids=UNUSABLE)
def test_an_unusable_token_file_is_refused(
    spoil: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if spoil is of_another_user and os.getuid() != 0:
        pytest.skip("only root can give a file away")
    file = tmp_path / "token"
    file.write_text("0123456789abcdef" * 4)
    file.chmod(0o600)
    spoil(file)
    monkeypatch.setenv(TOKEN_FILE, str(file))
    with pytest.raises(KeyringError, match=r"token.*\[token-file\]"):
        token_of_environment()
