"""The bus: the same behaviour over every transport, and the reach model above them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmctl.bus import keys
from swarmctl.bus.base import BusError, Transport
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


async def heard(inboxes: dict[int, list[Message]], count: int) -> None:
    async with asyncio.timeout(5.0):
        while sum(map(len, inboxes.values())) < count:  # noqa: ASYNC110
            await asyncio.sleep(0)


def test_everyone_hears_what_one_says_and_itself_does_not(
    bus: Callable[..., AbstractContextManager[Transport]],
) -> None:
    async def scene() -> None:
        with bus() as transport:
            network = Network(transport, "test", None)
            inboxes: dict[int, list[Message]] = {n: [] for n in (1, 2, 3)}
            for uav, inbox in inboxes.items():
                network.join(uav, inbox.append)
            assert network.publish(SEEN) == 2
            await heard(inboxes, 2)
            assert inboxes == {1: [], 2: [SEEN], 3: [SEEN]}

    asyncio.run(scene())


def test_messages_of_one_sender_arrive_in_order(
    bus: Callable[..., AbstractContextManager[Transport]],
) -> None:
    async def scene() -> None:
        with bus() as transport:
            network = Network(transport, "test", None)
            inboxes: dict[int, list[Message]] = {1: [], 2: []}
            for uav, inbox in inboxes.items():
                network.join(uav, inbox.append)
            said = [ObservationShared(1, Observation(1, n, 0.0, ())) for n in range(50)]
            for message in said:
                network.publish(message)
            await heard(inboxes, 50)
            assert inboxes[2] == said

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
            network = Network(transport, "test", None)
            inbox: list[Message] = []
            network.join(3, inbox.append)
            network.join(1, inbox.append)
            transport.put(keys.inform("test", 3, SEEN)[:-1] + str(key_from), payload)
            network.publish(SEEN)
            await heard({3: inbox}, 1)
            assert network.refused == 1
            assert inbox == [SEEN]

    asyncio.run(scene())


def test_a_zenoh_endpoint_that_cannot_be_is_an_error_with_its_name() -> None:
    async def scene() -> None:
        with pytest.raises(BusError, match="tcp/nowhere"):
            ZenohBus(listen=["tcp/nowhere.invalid:1"])

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
