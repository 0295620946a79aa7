"""Backlog of messages in one process: bounded, and the newest state of a vehicle is never dropped."""

from __future__ import annotations

import asyncio
from contextlib import closing
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from node_swarm import state
from profiles import examples

from swarmctl.bus import network
from swarmctl.bus.backlog import Backlog, QueuedMessage
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.radio import LossReason
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core.frames import AgentMessage, Frame, IntentShared, StateShared
from swarmctl.core.observation import BeliefItem, Observation
from swarmctl.flight.virtual_clock import run_virtual

ROOM_BYTES = 20_000


def observation(uav: int, seq: int, incarnation: int = 1) -> Observation:
    return Observation(uav, seq, 2.5, ((seq % 20, 4, True),), incarnation)


def message_from(sender: int, n: int, kind: type, to: tuple[int, ...]) -> QueuedMessage:
    contents: dict[type, AgentMessage] = {
        Observation: observation(sender, n),
        StateShared: state(),
        IntentShared: IntentShared(1),
    }
    frame = Frame(sender, 1, n, 0.0, contents[kind])
    return QueuedMessage(DecodedFrame(frame, bytes(100), (sender, 1)), to)


ANY = st.tuples(
    st.integers(1, 3),
    st.sampled_from([Observation, Observation, Observation, StateShared, IntentShared]),
    st.sampled_from([(7,), (8,), (7, 8)]),
    st.sampled_from([0, 0, 0, 1]),
)
"""Sender, type, receivers and the number of messages received before the next one is sent."""


@settings(derandomize=True, deadline=None, max_examples=examples(200))
@given(st.lists(ANY, min_size=40, max_size=150))
def test_the_oldest_messages_are_dropped_but_never_the_newest_state(
    story: list[tuple[int, type, tuple[int, ...], int]],
) -> None:
    backlog, waiting = Backlog(ROOM_BYTES), list[QueuedMessage]()
    for n, (sender, kind, to, received) in enumerate(story):
        waiting.append(message_from(sender, n, kind, to))
        gone = backlog.append(waiting[-1])
        stays = [one for one in waiting if one not in gone]
        for one in gone:
            assert any(other.decoded.frame.n > one.decoded.frame.n for other in stays)
            if kind_of(one) is not Observation:
                newer = [s for s in waiting if sender_of(s) == sender_of(one) and kind_of(s) is kind_of(one)]
                to_whom = [s.to for s in newer if s.decoded.frame.n > one.decoded.frame.n]
                assert set(one.to) <= {uav for uavs in to_whom for uav in uavs}
        waiting = stays
        for _ in range(min(received, len(waiting))):
            assert backlog.popleft() is waiting.pop(0)
        # The newest of two types from three senders to two receivers are 12 messages; the room is for 18.
        assert sum(one.n_bytes for one in waiting) <= max(ROOM_BYTES, 4 * 12 * 1_100)
    assert [backlog.popleft() for _ in range(len(backlog))] == waiting


def known(items: list[BeliefItem]) -> set[int]:
    """Return the observations of vehicle 1, single or in a checkpoint."""
    return {
        seq
        for one in items
        for seq in ([one.seq] if isinstance(one, Observation) else range(1, one.upto + 1))
    }


def sender_of(one: QueuedMessage) -> int:
    return one.decoded.frame.sender


def kind_of(one: QueuedMessage) -> type:
    return type(one.decoded.frame.content)


def test_dropped_messages_are_counted_reported_and_requested_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(network, "Backlog", partial(Backlog, 100_000))
    lines: list[tuple[int, str]] = []

    async def scene() -> None:
        uavs, received = (1, 2, 3), dict[int, list[BeliefItem]]()
        with closing(MemoryBus()) as transport:
            options = NodeOptions(20, 20)
            swarm = Network(
                transport, "test", uavs, options, clock=RunClock(1.8e9), say=lambda *line: lines.append(line)
            )
            incarnations = {}
            for uav in uavs:
                received[uav] = []
                incarnations[uav] = swarm.join(uav, received[uav].extend)
            with closing(swarm):
                # The messages arrive before the loop delivers any, as on a slow machine.
                swarm.publish(3, state(46.5))
                for seq in range(1, 501):
                    swarm.publish(1, observation(1, seq, incarnations[1]))
                await asyncio.sleep(0.1)
                assert 300 < swarm.counters[2].lost[LossReason.OVERLOAD] < 500
                assert swarm.counters[1].lost == {}
                assert ["[bus-overload]" in text for uav, text in lines if uav == 2] == [True]
                for uav in (1, 2):
                    newest = {other: state for other, _, state in swarm.take_new(uav, StateShared)}
                    assert newest[3].lat_deg == 46.5
                for _ in range(30):
                    for uav in uavs:
                        swarm.publish(uav, state(46.0 + uav * 1e-4))
                    await asyncio.sleep(1.0)
                for uav in (2, 3):
                    assert known(received[uav]) == {*range(1, 501)}

    run_virtual(scene())
