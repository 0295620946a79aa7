"""The short way that most observations go comes to the same as the general one."""

from __future__ import annotations

from collections import Counter

import numpy as np
from ether import COLS, ROWS, UNIX_S, state
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.bus.exchange import NodeOptions
from swarmctl.bus.node import Node
from swarmctl.core.frames import Content, Frame, Relayed, Seal, SnapshotAsked, StateShared
from swarmctl.core.observation import Observation

SEAL = Seal("test")
PAUSES_S = st.sampled_from((0.1, 0.1, 0.1, 4.0, 11.0))
ON = st.sampled_from((1, 1, 1, 1, 1, 0, 2, -2))
"""by how much a number goes on from the last"""


def node(hears: bool) -> Node:
    """Who asks of every message whether it is heard goes the general way."""
    rng = np.random.default_rng(1)
    made = Node(9, (1, 2, 9), NodeOptions(ROWS, COLS), SEAL, 1, rng, (lambda _a, _b: None) if hears else None)
    made.say(Observation(9, 1, 0.0, ((0, 0, False), (0, 1, True)), 1), 0.0, UNIX_S)
    return made


class Senders:
    """Numbers what UAVs say, mostly in a row."""

    def __init__(self) -> None:
        self.now_s = 0.0
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


@given(st.data())
def test_both_ways_come_to_the_same(data: st.DataObject) -> None:
    nodes, senders = (node(hears=False), node(hears=True)), Senders()
    for i in range(data.draw(st.integers(1, 25))):
        senders.now_s += data.draw(PAUSES_S)
        message = said(data, senders) if i > 2 else plain(senders)
        took = [
            each.receive(
                message.sender, message.act, SEAL.close(message), senders.now_s, UNIX_S + senders.now_s
            )
            for each in nodes
        ]
        assert took[0].news == took[1].news
        assert took[0].said == took[1].said
        assert [out.to for out in took[0].out] == [out.to for out in took[1].out]
        assert nodes[0].tally == nodes[1].tally
        assert nodes[0].next_deadline_s == nodes[1].next_deadline_s
    now_s, unix_s = senders.now_s, UNIX_S + senders.now_s
    told = [SEAL.open(each.say(state(), now_s, unix_s).out[0].data).content for each in nodes]
    assert isinstance(told[0], StateShared)
    assert told[0] == told[1]
    question = Frame(1, 3, 1, unix_s, SnapshotAsked((), ()))
    answers = [each.receive(1, question.act, SEAL.close(question), now_s, unix_s) for each in nodes]
    assert [out.data for out in answers[0].out] == [out.data for out in answers[1].out]


def plain(senders: Senders) -> Frame:
    return senders.frame(1, 1, senders.seen(1, 1, 1, contradicts=False), 1)


def said(data: st.DataObject, senders: Senders) -> Frame:
    uav, incarnation = data.draw(st.sampled_from(((1, 1), (1, 1), (1, 1), (2, 1), (1, 2), (3, 1))))
    on, on_seq = data.draw(ON), data.draw(ON)
    match data.draw(st.sampled_from(("seen", "seen", "seen", "contrary", "clock", "state", "passed on"))):
        case "contrary":
            return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, True), on)
        case "clock":
            ahead_s = data.draw(st.sampled_from((8.0, -70.0)))
            return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, False), on, ahead_s)
        case "state":
            told = StateShared(0.0, 46.0, 14.0, 30.0, "flying", 0, 0, data.draw(st.integers(0, 6)))
            return senders.frame(uav, incarnation, told, on)
        case "passed on":
            inner = SEAL.close(Frame(1, 1, 1, UNIX_S, senders.seen(1, 1, on_seq, False)))
            return senders.frame(2, 1, Relayed((inner,)), on)
    return senders.frame(uav, incarnation, senders.seen(uav, incarnation, on_seq, False), on)
