"""The agents of a process on a network: the same over every transport, with and without a radio model."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from node_swarm import state

from swarmctl.bus import keys
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.peer import RANKED_LAST_AFTER_S, PeerRecord, nearest_uavs
from swarmctl.bus.radio import LossReason, Radio, RadioSettings
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.inbox import TURN_S
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core.frames import Frame, FrameCodec, IntentPoint, IntentShared, RefusalReason
from swarmctl.core.geo import distance_m
from swarmctl.core.observation import BeliefItem, Observation
from swarmctl.flight.virtual_clock import run_virtual

OPTIONS, WITHOUT_SYNC = NodeOptions(20, 20), NodeOptions(20, 20, sync_every_s=0.0)
BUSES: dict[str, Callable[[], AbstractContextManager[Transport]]] = {
    "memory": lambda: closing(MemoryBus()),
    "zenoh": ZenohBus,
}
Open = Callable[[], AbstractContextManager[Transport]]


@pytest.fixture(params=BUSES)
def bus(request: pytest.FixtureRequest) -> Open:
    return BUSES[request.param]


class Swarm:
    """UAVs on one network, with the observations that each receives."""

    def __init__(
        self,
        transport: Transport,
        *uavs: int,
        radio: RadioSettings | None = None,
        speedup: float = 1.0,
        options: NodeOptions = OPTIONS,
        say: Callable[[int, str], None] = lambda _uav, _text: None,
    ) -> None:
        self.transport = transport
        clock = RunClock(1_800_000_000.0, speedup)
        model = None if radio is None else Radio(radio, 7)
        self.network = Network(transport, "test", uavs, options, clock=clock, radio=model, say=say)
        self.received: dict[int, asyncio.Queue[BeliefItem]] = {uav: asyncio.Queue() for uav in uavs}
        self.incarnations = {uav: self.network.join(uav, self._inbox(uav)) for uav in uavs}

    def _inbox(self, uav: int) -> Callable[[tuple[BeliefItem, ...]], None]:
        def put(items: tuple[BeliefItem, ...]) -> None:
            for item in items:
                self.received[uav].put_nowait(item)

        return put

    def publishes(self, uav: int, seq: int) -> Observation:
        message = Observation(uav, seq, 2.5, ((seq % 20, 4, True),), self.incarnations[uav])
        self.network.publish(uav, message)
        return message

    async def next_of(self, uav: int) -> BeliefItem:
        async with asyncio.timeout(5.0):
            return await self.received[uav].get()


@contextmanager
def swarm_of(*uavs: int, bus: Open = BUSES["memory"], **more: Any) -> Iterator[Swarm]:
    with bus() as transport:
        swarm = Swarm(transport, *uavs, **more)
        with closing(swarm.network):
            yield swarm


def test_a_message_reaches_all_others_and_not_its_sender(bus: Open) -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3, bus=bus) as swarm:
            sent = swarm.publishes(1, 1)
            assert [await swarm.next_of(2), await swarm.next_of(3)] == [sent, sent]
            assert swarm.received[1].empty()
            assert swarm.network.counters[1].sent["inform/observation"] == 2
            assert swarm.network.counters[2].received >= 1

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("key", "why"),
    [
        ("swarmctl/test/uav/3/inform/observation/2", RefusalReason.SOURCE),
        ("swarmctl/test/uav/3/inform/state/1", RefusalReason.SOURCE),
        ("swarmctl/test/uav/3/inform/observation/x", RefusalReason.SOURCE),
        ("swarmctl/test/uav/3/observation", RefusalReason.SOURCE),
    ],
)
def test_a_message_under_another_key_is_refused_and_counted(key: str, why: RefusalReason, bus: Open) -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3, bus=bus) as swarm:
            observation = Observation(1, 1, 2.5, ((3, 4, True), (3, 5, False)))
            data = FrameCodec("test").encode(Frame(1, 0, 1, 1_800_000_000.0, observation))
            swarm.transport.put(key, data)
            sent = swarm.publishes(2, 1)
            assert await swarm.next_of(3) == sent
            assert swarm.network.counters[3].refused == {why: 1}

    asyncio.run(scene())


def test_a_put_on_a_wildcard_key_is_refused() -> None:
    assert keys.sender_of("swarmctl/test/uav/3/inform/observation/1") == (1, "inform/observation")
    for key in (
        "swarmctl/test/uav/*/inform/observation/1",
        "swarmctl/test/**",
        "swarmctl/$*/uav/3/inform/state/1",
    ):
        assert keys.sender_of(key) is None


def test_an_overlong_key_is_refused_without_cost() -> None:
    for sender in ("9" * 5000, "1234", "0001"):
        assert keys.sender_of(f"swarmctl/test/uav/3/inform/state/{sender}") is None
    assert keys.sender_of(f"swarmctl/{'x' * 50_000}/uav/3/inform/state/1") is None
    longest = keys.uav_message("s" * 64, 254, "inform/observation", 253)
    assert keys.sender_of(longest) == (253, "inform/observation")


def test_a_flood_of_invalid_messages_is_reported_in_ten_lines() -> None:
    async def scene() -> None:
        lines: list[int] = []
        with swarm_of(1, 2, say=lambda uav, _: lines.append(uav)) as swarm:
            for _ in range(15):
                swarm.transport.put("swarmctl/test/uav/2/inform/state/1", b"junk")
                await asyncio.sleep(3600.0)
            assert lines == [2] * 10
            assert sum(swarm.network.counters[2].refused.values()) == 15

    run_virtual(scene())


def test_an_exception_in_an_agent_does_not_end_the_network(bus: Open) -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3, bus=bus) as swarm:

            def broken(_items: tuple[BeliefItem, ...]) -> None:
                raise RuntimeError("a bug")

            swarm.network.join(2, broken)
            sent = [swarm.publishes(1, 1), swarm.publishes(1, 2)]
            assert [await swarm.next_of(3), await swarm.next_of(3)] == sent

    asyncio.run(scene())


def test_waiting_observations_reach_an_agent_in_one_call() -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3) as swarm:
            items: list[tuple[BeliefItem, ...]] = []
            swarm.network.join(3, items.append)
            sent = [swarm.publishes(1, 1), swarm.publishes(2, 1), swarm.publishes(1, 2)]
            await asyncio.sleep(0.0)
            assert items == [tuple(sent)]

    run_virtual(scene())


def test_a_uav_that_joins_again_learns_earlier_observations() -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3) as swarm:
            for seq in range(1, 6):
                await in_turn(swarm, seq)
            items: list[BeliefItem] = []
            swarm.incarnations[3] = swarm.network.join(3, items.extend)
            for uav in (1, 2):
                swarm.publishes(uav, 6)
                swarm.network.publish(uav, state(46.0 + uav * 1e-4))
            swarm.publishes(3, 1)
            await asyncio.sleep(60.0)
            assert {(seen.observer, seen.seq) for seen in items if isinstance(seen, Observation)} >= {
                (uav, seq) for uav in (1, 2) for seq in range(1, 7)
            }
            assert all(not swarm.network.counters[uav].refused for uav in (1, 2, 3))

    run_virtual(scene())


def test_agents_receive_observations_under_overload(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count(0.0, 0.001)  # each reading of the clock is 1 ms later

    async def scene() -> int:
        monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: next(clock))
        with swarm_of(1, 2) as swarm:
            for turn in range(20):
                for i in range(30):
                    swarm.publishes(1, 30 * turn + i + 1)
                await asyncio.sleep(0.0)
            return swarm.received[2].qsize()

    # Messages of the last moments may be missing.
    assert run_virtual(scene()) >= 300


def test_a_slow_machine_does_not_change_the_sequence_on_the_virtual_clock() -> None:
    async def scene() -> None:
        with swarm_of(1, 2, 3) as swarm:
            calls: list[tuple[int, int]] = []

            def slow(uav: int) -> Callable[[tuple[BeliefItem, ...]], None]:
                def on_news(news: tuple[BeliefItem, ...]) -> None:
                    end_s = time.perf_counter() + TURN_S
                    while time.perf_counter() <= end_s:
                        pass
                    calls.append((uav, len(news)))

                return on_news

            for uav in (2, 3):
                swarm.network.join(uav, slow(uav))
            swarm.publishes(1, 1)
            await asyncio.sleep(0.0)
            assert calls == [(2, 1), (3, 1)]

    run_virtual(scene())


# --- the model, in simulated time


def reception_delay_s(settings: RadioSettings, speedup: float) -> float:
    """Return the delay of a message from UAV 1 to UAV 2 [simulated s]."""

    async def scene() -> float:
        loop = asyncio.get_running_loop()
        with swarm_of(1, 2, radio=settings, speedup=speedup, options=WITHOUT_SYNC) as swarm:
            began_s = loop.time()
            swarm.publishes(1, 1)
            await swarm.next_of(2)
            return (loop.time() - began_s) * speedup

    return run_virtual(scene())


@pytest.mark.parametrize("speedup", [1.0, 10.0])
def test_delay_is_in_simulated_seconds(speedup: float) -> None:
    assert reception_delay_s(RadioSettings(delay_s=2.0), speedup) == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("speedup", [1.0, 10.0])
def test_the_age_of_an_intent_is_in_simulated_seconds(speedup: float) -> None:
    async def scene() -> None:
        with swarm_of(1, 2, speedup=speedup) as swarm:
            swarm.network.publish(1, IntentShared(1, (IntentPoint(0.0, 46.0, 14.4, 340.0),)))
            await asyncio.sleep(2.0 / speedup)
            ((_, age_s, _),) = swarm.network.take_new(2, IntentShared)
            assert age_s == pytest.approx(2.0, abs=1e-3)

    run_virtual(scene())


@pytest.mark.parametrize(
    ("metres", "lost"),
    [(5.0, LossReason.TOO_NEAR), (50.0, None), (500.0, LossReason.TOO_FAR)],
)
def test_a_uav_out_of_range_is_not_received(metres: float, lost: LossReason | None) -> None:
    async def scene() -> None:
        radio = RadioSettings(min_distance_m=10.0, max_distance_m=300.0)
        with swarm_of(1, 2, radio=radio) as swarm:
            swarm.network.moved(1, 46.0, 14.0)
            swarm.network.moved(2, 46.0 + metres / 111_194.9, 14.0)
            swarm.publishes(1, 1)
            await asyncio.sleep(1.0)
            assert swarm.received[2].empty() is (lost is not None)
            assert swarm.network.counters[2].lost == ({} if lost is None else {lost: 1})

    run_virtual(scene())


def test_losses_are_counted_by_cause() -> None:
    async def scene() -> None:
        with swarm_of(1, 2, radio=RadioSettings(loss=0.5), options=WITHOUT_SYNC) as swarm:
            for seq in range(1, 201):
                swarm.publishes(1, seq)
                await asyncio.sleep(0.1)
            counters = swarm.network.counters[1]
            assert counters.sent["inform/observation"] == 200
            assert swarm.network.counters[2].received + counters.lost[LossReason.LOSS] == 200
            assert 60 < counters.lost[LossReason.LOSS] < 140

    run_virtual(scene())


def test_a_uav_without_losses_sends_no_requests() -> None:
    """All UAVs send all the time, and their beliefs always differ slightly."""

    async def scene() -> None:
        with swarm_of(*range(1, 6)) as swarm:
            for seq in range(1, 200):
                await in_turn(swarm, seq)
            asked = {uav: counters.snapshots_asked for uav, counters in swarm.network.counters.items()}
            # One request for each other UAV, after its first message.
            assert asked == dict.fromkeys(range(1, 6), 4)

    run_virtual(scene())


def test_simultaneous_arrivals_keep_their_order() -> None:
    async def scene() -> None:
        with swarm_of(1, 2, radio=RadioSettings(delay_s=0.3), options=WITHOUT_SYNC) as swarm:
            sent = [swarm.publishes(1, seq) for seq in range(1, 51)]
            assert [await swarm.next_of(2) for _ in sent] == sent

    run_virtual(scene())


async def in_turn(swarm: Swarm, seq: int) -> None:
    """Let each UAV publish an observation and its state."""
    for uav in swarm.received:
        swarm.publishes(uav, seq)
        swarm.network.publish(uav, state(46.0 + uav * 1e-4))
        await asyncio.sleep(0.11)


# --- the receivers of a UAV

HERE = (46.0, 14.0)
Places = dict[int, tuple[float, float] | None]


def reached(places: Places, silent: set[int], k: int | None) -> tuple[int, ...]:
    peers = {uav: peer_at(places[uav], 0.0 if uav in silent else 100.0) for uav in sorted(places)}
    return nearest_uavs(HERE, peers, k, 100.0 + RANKED_LAST_AFTER_S)


def peer_at(place: tuple[float, float] | None, heard_s: float) -> PeerRecord:
    if place is None:
        return PeerRecord()
    return PeerRecord(state=state(*place), state_s=heard_s)


@pytest.mark.parametrize(
    ("k", "expected"),
    [(0, ()), (1, (3,)), (2, (3, 2)), (3, (3, 2, 4)), (4, (2, 3, 4, 5)), (None, (2, 3, 4, 5))],
)
def test_the_nearest_k_are_reached_and_silent_uavs_rank_last(
    k: int | None, expected: tuple[int, ...]
) -> None:
    places = {2: (46.3, 14.0), 3: (46.1, 14.0), 4: None, 5: (46.0001, 14.0)}
    assert reached(places, {5}, k) == expected


@given(
    st.dictionaries(st.integers(2, 20), st.tuples(st.floats(45, 47), st.floats(13, 15))), st.integers(0, 25)
)
def test_the_k_receivers_are_the_nearest_uavs(alive: dict[int, tuple[float, float]], k: int) -> None:
    chosen = reached(alive, set(), k)
    assert len(chosen) == min(k, len(alive))
    left = set(alive) - set(chosen)
    if chosen and left:
        assert max(distance_m(HERE, alive[u]) for u in chosen) <= min(
            distance_m(HERE, alive[u]) for u in left
        )
