"""Reception by all UAVs of a process at once: the same result as reception by each UAV alone."""

from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from node_swarm import COLS, ROWS, UNIX_S, state
from profiles import examples

from swarmctl.bus.node.decoding import frame_decoder
from swarmctl.bus.node.exchange import NodeOptions, NodeOutput
from swarmctl.bus.node.node import Node
from swarmctl.bus.node.reception import ReceptionTable
from swarmctl.core.frames import Content, Frame, FrameCodec, Relayed, SnapshotAsked, StateShared
from swarmctl.core.observation import Observation

SEAL = FrameCodec("test")
READ = frame_decoder(SEAL, ROWS, COLS)
PAUSES_S = st.sampled_from((0.1, 0.1, 0.1, 3.0, 6.0, 11.0))
ON = st.sampled_from((1, 1, 1, 1, 1, 0, 2, -1))
"""Step from the last number to the next."""
UAVS = (1, 2, 7, 8, 9)
RECEIVERS = (7, 8, 9)


class Process:
    """UAVs 7, 8 and 9; with `at_once` they share a reception table that delivers first."""

    def __init__(self, *, at_once: bool) -> None:
        options = NodeOptions(ROWS, COLS)
        self.table = ReceptionTable(UAVS, options) if at_once else None
        self.nodes = {
            uav: Node(uav, UAVS, options, SEAL, 1, np.random.default_rng(uav), table=self.table)
            for uav in RECEIVERS
        }
        for uav in (8, 9):
            seen = Observation(uav, 1, 0.0, ((0, 0, False), (0, 1, uav == 9)), 1)
            self.nodes[uav].publish(seen, 0.0, UNIX_S)
        self.n_delivered = 0

    def receive(self, sender: int, frame: Frame, to: tuple[int, ...], now_s: float) -> dict[int, NodeOutput]:
        """Return the output of each receiver of a frame under the key of `sender`."""
        decoded, unix_s, outputs = READ(SEAL.encode(frame)), UNIX_S + now_s, {}
        if self.table is not None and sender in UAVS:
            receivers = self.table.mask(to)
            delivered = self.table.deliver(sender, frame.act, decoded, receivers, now_s, unix_s)
            seen = frame.content
            news = [seen] if isinstance(seen, Observation) else []
            outputs = {uav: NodeOutput(news=news) for uav in self.table.uavs(delivered)}
            self.n_delivered += len(outputs)
        for uav in to:
            if uav not in outputs:
                outputs[uav] = self.nodes[uav].receive_decoded(sender, frame.act, decoded, now_s, unix_s)
        return outputs


class Senders:
    """Frames of UAVs with mostly consecutive numbers."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.known = [0, 5]
        """Fingerprints: of an empty belief, of another belief, and earlier ones."""
        self._n = Counter[int]()
        self._seq = Counter[tuple[int, int]]()

    def frame(self, uav: int, incarnation: int, content: Content, on: int, ahead_s: float = 0.0) -> Frame:
        self._n[uav] = max(1, self._n[uav] + on)
        unix_s = UNIX_S + self.now_s + ahead_s
        return Frame(uav, incarnation, self._n[uav], unix_s, content, 46.0, 14.0)

    def seen(self, uav: int, incarnation: int, on: int, contradicts: bool) -> Observation:
        seq = self._seq[uav, incarnation] = max(1, self._seq[uav, incarnation] + on)
        cells = ((0, 1, False), (1, 1, False)) if contradicts else ((1, seq % COLS, False), (2, 2, True))
        return Observation(uav, seq, 1.0, cells, incarnation)


@settings(max_examples=examples(200), deadline=None)
@given(st.data())
def test_the_reception_table_gives_the_same_result_as_single_nodes(data: st.DataObject) -> None:
    both, senders = (Process(at_once=True), Process(at_once=False)), Senders()
    for i in range(data.draw(st.integers(5, 40))):
        senders.now_s += data.draw(PAUSES_S)
        for uav in RECEIVERS:
            nodes = [process.nodes[uav] for process in both]
            if nodes[0].next_deadline_s <= senders.now_s:
                ticks = [node.tick(senders.now_s, UNIX_S + senders.now_s) for node in nodes]
                assert ticks[0] == ticks[1]
        message = drawn_message(data, senders) if i > 2 else plain(senders)
        sender = data.draw(st.sampled_from((message.sender,) * 9 + (2,)))
        to = data.draw(st.sampled_from((RECEIVERS, RECEIVERS, RECEIVERS, (7, 9), (8,))))
        outputs = [process.receive(sender, message, to, senders.now_s) for process in both]
        for uav in RECEIVERS:
            nodes = [process.nodes[uav] for process in both]
            if uav in to:
                assert outputs[0][uav] == outputs[1][uav]
            assert nodes[0].counters == nodes[1].counters
            assert nodes[0].states() == nodes[1].states()
            assert nodes[0].next_deadline_s == nodes[1].next_deadline_s
        if data.draw(st.booleans()):
            senders.known.append(fingerprint_of(both, data.draw(st.sampled_from(RECEIVERS)), senders.now_s))
    for uav in RECEIVERS:
        now_s, unix_s = senders.now_s, UNIX_S + senders.now_s
        fingerprint_of(both, uav, now_s)
        question = Frame(1, 3, 1, unix_s, SnapshotAsked((), ()))
        answers = [
            process.nodes[uav].receive(1, question.act, SEAL.encode(question), now_s, unix_s)
            for process in both
        ]
        assert [out.data for out in answers[0].messages] == [out.data for out in answers[1].messages]


def fingerprint_of(both: tuple[Process, Process], uav: int, now_s: float) -> int:
    """Return the fingerprint of this UAV's belief from its state, equal in both processes."""
    shared = [process.nodes[uav].publish(state(), now_s, UNIX_S + now_s).messages[0] for process in both]
    contents = [SEAL.decode(out.data).content for out in shared]
    assert shared[0].to == shared[1].to
    assert contents[0] == contents[1]
    assert isinstance(contents[0], StateShared)
    return contents[0].knows


def test_the_reception_table_delivers_observations_and_states() -> None:
    process, senders = Process(at_once=True), Senders()
    for _ in range(3):
        process.receive(1, plain(senders), RECEIVERS, senders.now_s)
    shared = StateShared(0.0, 46.0, 14.0, 30.0, "flying", 0, 0, 3)
    process.receive(1, senders.frame(1, 1, shared, 1), RECEIVERS, senders.now_s)
    # The table delivers all messages but the first, which makes the sender known to each receiver.
    assert process.n_delivered == 3 * len(RECEIVERS)


def plain(senders: Senders) -> Frame:
    return senders.frame(1, 1, senders.seen(1, 1, 1, contradicts=False), 1)


def drawn_message(data: st.DataObject, senders: Senders) -> Frame:
    uav, incarnation = data.draw(st.sampled_from(((1, 1), (1, 1), (1, 1), (2, 1), (1, 2), (3, 1))))
    on, on_seq = data.draw(ON), data.draw(ON)
    match data.draw(st.sampled_from(("seen", "seen", "seen", "contrary", "clock", "state", "passed on"))):
        case "contrary":
            return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, True), on)
        case "clock":
            ahead_s = data.draw(st.sampled_from((8.0, -70.0)))
            return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, False), on, ahead_s)
        case "state":
            phase, last_seq = data.draw(st.sampled_from(("flying", "failed"))), data.draw(st.integers(0, 6))
            shared = StateShared(
                0.0, 46.0, 14.0, 30.0, phase, 0, 0, last_seq, data.draw(st.sampled_from(senders.known))
            )
            return senders.frame(uav, incarnation, shared, on)
        case "passed on":
            inner = SEAL.encode(Frame(1, 1, 1, UNIX_S, senders.seen(1, 1, on_seq, False)))
            return senders.frame(2, 1, Relayed((inner,)), on)
    return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, False), on)
