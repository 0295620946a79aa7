"""Access to the service for operators' commands: keys, ports and endpoints."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from pathlib import Path

import pytest
from flights import small
from operator_station import ANYWHERE, KEY, Station, StubAgent, zenoh_pair

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.operator_service import CommandCounts, OperatorService
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.open import open_bus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core.messages import MAX_SYSTEM_ID, GiveOrder, SetWeights, VehicleAnswer, encode
from swarmctl.preflight import host
from swarmctl.station import client, commands


def test_a_wildcard_is_refused_and_counted() -> None:
    """The query comes from the same process, where no access rule protects the service."""

    async def scene() -> None:
        with ZenohBus() as bus:
            station = Station(bus)
            for key in ("swarmctl/test/uav/*/request/weights/operator", "swarmctl/test/**", "**"):
                assert await bus.ask(key, encode(SetWeights((2,), w=0.2)), 5.0) == ()
            assert station.posted == []
            assert station.counts.refused == 2 + 5 + 5  # once for each matched key

    asyncio.run(scene())


def test_another_process_has_access_to_the_operator_key_only() -> None:
    async def scene() -> None:
        received: list[str] = []
        received_by_operator: list[str] = []
        with zenoh_pair() as (ground, operator):
            station = Station(ground)
            ground.subscribe(keys.inbox("test", 1), lambda key, _: received.append(key))
            ground.subscribe("**", lambda key, _: received.append(key))
            operator.subscribe("swarmctl/test/**", lambda key, _: received_by_operator.append(key))
            for key in (
                "swarmctl/test/uav/1/inform/state/9",
                "swarmctl/test/uav/*/inform/state/9",
                "**",
                KEY,
            ):
                operator.put(key, b"from outside")
            for key in ("swarmctl/test/uav/*/request/weights/operator", "swarmctl/test/**", "**"):
                assert await operator.ask(key, encode(SetWeights((2,), w=0.2)), 5.0) == ()
            ground.put("swarmctl/test/uav/1/inform/state/2", b"within the swarm")
            # The answer shows that all earlier messages on this connection were handled.
            assert len(await operator.ask(KEY, encode(SetWeights((2,), w=0.2)), 5.0)) == 1
            assert received == ["swarmctl/test/uav/1/inform/state/2"] * 2
            assert station.counts == CommandCounts(passed_on=1, refused=0)
            # The operator receives its own message and no message of the swarm.
            assert "swarmctl/test/uav/1/inform/state/9" in received_by_operator
            assert "swarmctl/test/uav/1/inform/state/2" not in received_by_operator

    asyncio.run(scene())


def test_a_command_reaches_all_vehicles_of_the_largest_swarm_at_once() -> None:
    def agent(uav: int) -> StubAgent:
        taken = VehicleAnswer(uav, f"uav{uav}", "taken")
        return StubAgent(taken.name, lambda _event, answer_to: answer_to(taken))

    async def scene() -> None:
        uavs = range(1, MAX_SYSTEM_ID + 1)
        with ZenohBus(zenoh_config.whole_swarm(ANYWHERE, "test", uavs)) as ground:
            service = OperatorService(ground, "test", print, {u: agent(u) for u in uavs}, flies_all=True)
            assert ground.endpoint is not None
            flight = client.FlightEndpoints("test", ground.endpoint)
            answers = await commands.send(flight, GiveOrder(None, "hold"))
            assert [(v.uav, v.outcome) for v in answers] == [(uav, "taken") for uav in uavs]
            assert service.counts == CommandCounts(passed_on=MAX_SYSTEM_ID)

    asyncio.run(scene())


def occupied_port(held: contextlib.ExitStack) -> int:
    holder = held.enter_context(contextlib.closing(socket.socket()))
    holder.bind(("127.0.0.1", 0))
    holder.listen()
    return int(holder.getsockname()[1])


def test_an_occupied_port_is_an_error_with_advice() -> None:
    async def scene(port: int) -> None:
        with open_bus("test", (1,), f"tcp/127.0.0.1:{port}", "token", print):
            pass

    with contextlib.ExitStack() as held:
        port = occupied_port(held)
        with pytest.raises(BusError, match=rf"communication.listen: .*tcp/127.0.0.1:{port}: .*`none`"):
            asyncio.run(scene(port))
        scenario = small(communication={"bus": "zenoh", "listen": f"tcp/127.0.0.1:{port}"})
        (line,) = host.troubles(scenario, Path())
        assert f"communication.listen: tcp/127.0.0.1:{port}" in line


def test_an_endpoint_without_a_swarm_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_config, "JOIN_MS", 200)

    async def scene() -> None:
        with contextlib.ExitStack() as held:
            station = client.FlightEndpoints("test", BusEndpoint("127.0.0.1", occupied_port(held)))
        await commands.send(station, SetWeights(None, w=0.2))

    with pytest.raises(BusError, match=r"tcp/127\.0\.0\.1:.*\[no-swarm-at-endpoint\]"):
        asyncio.run(scene())


@pytest.mark.parametrize(
    ("text", "host", "port", "loopback"),
    [
        ("tcp/127.0.0.1:7447", "127.0.0.1", 7447, True),
        ("tcp/localhost:0", "localhost", 0, True),
        ("tcp/[::1]:7447", "::1", 7447, True),
        ("tcp/0.0.0.0:7447", "0.0.0.0", 7447, False),
        ("tcp/ground.example:7447", "ground.example", 7447, False),
        ("tls/ground:7447", "ground", 7447, False),
        ("quic/[::1]:1", "::1", 1, True),
    ],
)
def test_an_endpoint_is_read_and_written(text: str, host: str, port: int, loopback: bool) -> None:
    endpoint = parse_endpoint(text)
    assert (endpoint.host, endpoint.port, endpoint.is_loopback) == (host, port, loopback)
    assert endpoint.is_certified == (not text.startswith("tcp"))
    assert str(endpoint) == text


@pytest.mark.parametrize(
    "text",
    ["", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "udp/127.0.0.1:7447", "tcp/a:70000", "tcp/*:1"],
)
def test_an_invalid_endpoint_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"tcp/HOST:PORT"):
        parse_endpoint(text)
