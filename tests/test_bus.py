"""The bus: the same behaviour over every transport, and the reach model above them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmctl.bus import keys
from swarmctl.bus.base import Transport
from swarmctl.bus.memory import MemoryBus
from swarmctl.bus.network import Network, recipients
from swarmctl.bus.zenoh_bus import ZenohBus
from swarmctl.core.belief import Observation
from swarmctl.core.messages import BadMessage, Message, ObservationShared, StateShared, decode, encode

SEEN = ObservationShared(1, Observation(1, 5, 2.5, ((3, 4, True), (3, 5, False))))


def state(sender: int, lat_deg: float, phase: str = "flying") -> StateShared:
    return StateShared(sender, 1.0, lat_deg, 14.0, 30.0, phase, 0, 0)


BUSES: dict[str, Callable[[], AbstractContextManager[Transport]]] = {
    "memory": lambda: closing(MemoryBus()),
    "zenoh": ZenohBus,
}


@pytest.fixture(params=BUSES)
def bus(request: pytest.FixtureRequest) -> Callable[[], AbstractContextManager[Transport]]:
    return BUSES[request.param]


class Swarm:
    """UAVs on one network, and what each hears."""

    def __init__(self, transport: Transport, *uavs: int) -> None:
        self.network = Network(transport, "test", None)
        self.inboxes: dict[int, asyncio.Queue[Message]] = {uav: asyncio.Queue() for uav in uavs}
        for uav, inbox in self.inboxes.items():
            self.network.join(uav, inbox.put_nowait)

    async def next_of(self, uav: int) -> Message:
        async with asyncio.timeout(5.0):
            return await self.inboxes[uav].get()


def test_everyone_hears_what_one_says_and_itself_does_not(
    bus: Callable[..., AbstractContextManager[Transport]],
) -> None:
    async def scene() -> None:
        with bus() as transport:
            swarm = Swarm(transport, 1, 2, 3)
            assert swarm.network.publish(SEEN) == 2
            assert [await swarm.next_of(2), await swarm.next_of(3)] == [SEEN, SEEN]
            assert swarm.inboxes[1].empty()

    asyncio.run(scene())


def test_messages_of_one_sender_arrive_in_order(
    bus: Callable[..., AbstractContextManager[Transport]],
) -> None:
    async def scene() -> None:
        with bus() as transport:
            swarm = Swarm(transport, 1, 2)
            said = [ObservationShared(1, Observation(1, n, 0.0, ())) for n in range(50)]
            for message in said:
                swarm.network.publish(message)
            assert [await swarm.next_of(2) for _ in said] == said

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("key_from", "payload"),
    [
        (2, encode(SEEN)),
        (1, b""),
        (1, b"\x01nonsense"),
        (1, bytes((9,)) + encode(SEEN)[1:]),
        (3, encode(SEEN)),
    ],
    ids=["forged sender", "empty", "no MessagePack", "another version", "from itself"],
)
def test_what_is_no_message_of_its_sender_is_refused_and_counted(
    key_from: int, payload: bytes, bus: Callable[..., AbstractContextManager[Transport]]
) -> None:
    async def scene() -> None:
        with bus() as transport:
            swarm = Swarm(transport, 1, 3)
            transport.put(keys.inform("test", 3, SEEN)[:-1] + str(key_from), payload)
            swarm.network.publish(SEEN)
            assert await swarm.next_of(3) == SEEN
            assert swarm.network.refused == 1

    asyncio.run(scene())


STATES: dict[int, StateShared | None] = {1: state(1, 46.0), 2: state(2, 46.3), 3: state(3, 46.1), 4: None}


@pytest.mark.parametrize(
    ("k", "expected"),
    [(0, ()), (1, (3,)), (2, (3, 2)), (3, (2, 3, 4)), (9, (2, 3, 4)), (None, (2, 3, 4))],
)
def test_the_nearest_k_are_reached(k: int | None, expected: tuple[int, ...]) -> None:
    assert recipients(1, STATES, k) == expected


def test_a_failed_uav_is_not_reached() -> None:
    assert recipients(1, {**STATES, 3: state(3, 46.1, "failed")}, 1) == (2,)


@given(
    observer=st.integers(1, 255),
    seq=st.integers(0, 2**32),
    time_s=st.floats(allow_nan=False, allow_infinity=False),
    cells=st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 9999), st.booleans()), max_size=9),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_message_survives_the_wire(
    observer: int, seq: int, time_s: float, cells: list[tuple[int, int, bool]]
) -> None:
    message = ObservationShared(observer, Observation(observer, seq, time_s, tuple(cells)))
    assert decode(encode(message)) == message


@given(st.binary(max_size=60))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_whatever_arrives_is_a_message_or_refused(data: bytes) -> None:
    with suppress(BadMessage):
        decode(b"\x01" + data)
