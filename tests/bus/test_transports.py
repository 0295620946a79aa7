"""The behaviour of every transport: receivers, order and counters."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass

import pytest
from zenoh_nodes import SWARM, UAVS, client_of, credentials, here, meet, router_process, until

from swarmctl.bus import keys
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES, MAX_QUERY_BYTES, Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.zenoh import ZenohBus

pytestmark = pytest.mark.interop


@dataclass(frozen=True, slots=True)
class Ends:
    """Two vehicles and the operator, each on its own machine if the transport has machines."""

    one: Transport
    two: Transport
    operator: Transport

    async def met(self) -> None:
        await meet(*(end for end in (self.one, self.two, self.operator) if isinstance(end, ZenohBus)))


@contextmanager
def in_memory() -> Iterator[Ends]:
    with contextlib.closing(MemoryBus()) as bus:
        yield Ends(bus, bus, bus)


@contextmanager
def in_one_process() -> Iterator[Ends]:
    with ZenohBus() as bus:
        yield Ends(bus, bus, bus)


def star(protocol: str) -> Callable[[], AbstractContextManager[Ends]]:
    @contextmanager
    def ends() -> Iterator[Ends]:
        with router_process(protocol) as router, ExitStack() as stack:
            yield Ends(
                *(
                    stack.enter_context(ZenohBus(client_of(router.there, name)))
                    for name in ("uav1", "uav2", "operator")
                )
            )

    return ends


def mesh(protocol: str) -> Callable[[], AbstractContextManager[Ends]]:
    """uav1 and uav2 do not reach each other, but both reach uav3; the ground station reaches uav1."""

    @contextmanager
    def ends() -> Iterator[Ends]:
        places = {name: here(protocol) for name in ("uav1", "uav2", "uav3")}

        def node(name: str, *neighbours: str) -> ZenohBus:
            there = [places[neighbour] for neighbour in neighbours]
            own = credentials(protocol, name)
            return ZenohBus(zenoh_config.mesh_node(places[name], there, SWARM, UAVS, own))

        # The first node that opens has no neighbour yet.
        with (
            node("uav1", "uav3") as one,
            node("uav3") as _,
            node("uav2", "uav3") as two,
            ZenohBus(client_of(places["uav1"], "operator")) as operator,
        ):
            yield Ends(one, two, operator)

    return ends


TRANSPORTS: dict[str, Callable[[], AbstractContextManager[Ends]]] = {
    "memory": in_memory,
    "one process": in_one_process,
    "star tcp": star("tcp"),
    "star tls": star("tls"),
    "star quic": star("quic"),
    "mesh tcp": mesh("tcp"),
    "mesh tls": mesh("tls"),
}
OF_ONE = (in_memory, in_one_process)


@pytest.fixture(params=TRANSPORTS)
def ends(request: pytest.FixtureRequest) -> Callable[[], AbstractContextManager[Ends]]:
    return TRANSPORTS[request.param]


@pytest.fixture(params=OF_ONE)
def alone(request: pytest.FixtureRequest) -> Callable[[], AbstractContextManager[Ends]]:
    made: Callable[[], AbstractContextManager[Ends]] = request.param
    return made


def state(to: int, sender: int) -> str:
    return keys.uav_message(SWARM, to, "inform/state", sender)


def test_messages_and_queries_reach_their_receiver_in_order(
    ends: Callable[[], AbstractContextManager[Ends]],
) -> None:
    """A single scene, as the set-up of a transport takes long."""

    async def scene() -> None:
        with ends() as net:
            received: dict[str, list[tuple[str, bytes]]] = {"one": [], "two": [], "station": []}
            net.one.subscribe(keys.inbox(SWARM, 1), lambda *delivered: received["one"].append(delivered))
            net.two.subscribe(keys.inbox(SWARM, 2), lambda *delivered: received["two"].append(delivered))
            net.operator.subscribe(
                keys.station(SWARM), lambda *delivered: received["station"].append(delivered)
            )
            weights, order = (keys.request(SWARM, kind, 2) for kind in keys.REQUEST_KINDS)
            asked: list[bytes | None] = []

            def serve(key: str, payload: bytes | None, reply: Callable[[bytes], None]) -> None:
                asked.append(payload)
                reply(b"answer")

            net.two.serve(weights, serve)
            await net.met()
            await until(
                lambda: received["two"], "the first message", lambda: net.one.put(state(2, 1), b"hello")
            )
            await until(
                lambda: received["station"],
                "the first message to the station",
                lambda: net.two.put(keys.to_station(SWARM, 2), b"hello"),
            )
            await asyncio.sleep(0.1)
            for delivered in received.values():
                delivered.clear()

            numbers = [str(n).encode() for n in range(100)]
            for number in numbers:
                net.one.put(state(2, 1), number)
            net.two.put(keys.to_station(SWARM, 2), b"2")
            await until(lambda: len(received["two"]) >= 100 and received["station"], "all messages")
            assert received["two"] == [(state(2, 1), n) for n in numbers]
            received["two"].clear()
            dropped = net.one.dropped
            net.one.put(state(2, 1), bytes(MAX_MESSAGE_BYTES + 1))
            assert net.one.dropped == dropped + 1
            # The longest message is sent in fragments, which a busy machine may drop.
            longest = bytes(MAX_MESSAGE_BYTES)
            await until(
                lambda: received["two"], "the longest message", lambda: net.one.put(state(2, 1), longest)
            )
            assert set(received["two"]) == {(state(2, 1), longest)}
            assert received["station"] == [(keys.to_station(SWARM, 2), b"2")]
            assert received["one"] == []

            assert await net.operator.ask(weights, b"question", 5.0) == (b"answer",)
            assert await net.operator.ask(weights, bytes(MAX_QUERY_BYTES + 1), 5.0) == (b"answer",)
            assert asked == [b"question", None]
            assert await net.operator.ask(order, b"unserved", 5.0) == ()

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("expression", "key", "is_heard"),
    [
        ("swarmctl/a/**", "swarmctl/a/b", True),
        ("swarmctl/a/**", "swarmctl/a/b/c", True),
        ("swarmctl/a/**", "swarmctl/ab/c", False),
        ("**", "swarmctl/a", True),
        ("swarmctl/a", "swarmctl/a", True),
        ("swarmctl/a", "swarmctl/a/b", False),
    ],
)
def test_an_expression_is_a_key_or_a_prefix(
    expression: str, key: str, is_heard: bool, alone: Callable[[], AbstractContextManager[Ends]]
) -> None:
    async def scene() -> None:
        received: list[str] = []
        last: list[str] = []
        with alone() as net:
            net.one.subscribe(expression, lambda key, _: received.append(key))
            net.one.subscribe("last", lambda key, _: last.append(key))
            net.one.put(key, b"")
            net.one.put("last", b"")
            await until(lambda: last, "the last message")
            assert received == ([key] if is_heard else []) + (["last"] if expression == "**" else [])

    asyncio.run(scene())


@pytest.mark.parametrize("expression", ["a/*/b", "a/*", "a/**/b", "a/$*", "*/**"])
def test_other_expressions_are_refused(
    expression: str, alone: Callable[[], AbstractContextManager[Ends]]
) -> None:
    async def scene() -> None:
        with alone() as net, pytest.raises(ValueError, match=r"/\*\*"):
            net.one.subscribe(expression, lambda *_: None)

    asyncio.run(scene())


def buses_that_report(failures: list[tuple[str, str]]) -> list[Callable[[], Transport]]:
    def report(key: str, error: Exception) -> None:
        failures.append((key, str(error)))

    return [lambda: MemoryBus(on_failure=report), lambda: ZenohBus(on_failure=report)]


@pytest.mark.parametrize("which", [0, 1], ids=["memory", "zenoh"])
def test_a_bug_in_a_receiver_stops_neither_other_receivers_nor_the_loop(which: int) -> None:
    failures: list[tuple[str, str]] = []

    def fails(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    async def scene() -> None:
        received: list[bytes] = []
        bus = buses_that_report(failures)[which]()
        with contextlib.closing(bus):
            bus.subscribe("a/**", fails)
            bus.subscribe("a/**", lambda _, payload: received.append(payload))
            bus.serve("a/q", fails)
            for n in range(3):
                bus.put("a/b", bytes((n,)))
            with contextlib.suppress(TimeoutError):
                await bus.ask("a/q", b"", 0.2)
            await until(lambda: len(received) == 3 and bus.failed == 4, "the other receivers")
            assert received == [b"\0", b"\1", b"\2"]
            assert sorted(failures) == [("a/b", "a bug")] * 3 + [("a/q", "a bug")]

    asyncio.run(scene())


def test_a_subscription_to_anothers_inbox_does_not_divert_its_messages() -> None:
    """A monitor on the bus of a sender hides no receiver."""

    async def scene() -> None:
        with star("tcp")() as net:
            monitored: list[str] = []
            received: list[str] = []
            net.one.subscribe(f"swarmctl/{SWARM}/**", lambda key, _: monitored.append(key))
            net.two.subscribe(keys.inbox(SWARM, 2), lambda key, _: received.append(key))
            await net.met()
            await until(lambda: received, "the message to uav2", lambda: net.one.put(state(2, 1), b""))
            assert monitored[0] == state(2, 1)

    asyncio.run(scene())


def test_a_closed_bus_neither_sends_nor_receives() -> None:
    async def scene() -> None:
        received: list[str] = []
        bus = ZenohBus()
        bus.subscribe("a/**", lambda key, _: received.append(key))
        bus.put("a/b", b"on its way")
        bus.close()
        bus.close()
        bus.put("a/b", b"too late")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert received == []

    asyncio.run(scene())


def test_messages_before_the_opening_of_the_session_are_dropped_and_counted() -> None:
    async def scene() -> None:
        with ZenohBus(client_of(here("tcp"), "uav1")) as bus:
            bus.put(state(2, 1), b"unreceived")
            assert (bus.dropped, bus.connected, bus.links) == (1, False, 0)
            assert await bus.ask(keys.request(SWARM, "weights", 2), b"", 1.0) == ()

    asyncio.run(scene())
