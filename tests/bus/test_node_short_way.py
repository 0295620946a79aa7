"""The short way that most observations go comes to the same as the general one."""

from __future__ import annotations

import numpy as np
from ether import COLS, ROWS, UNIX_S, state
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.bus.exchange import NodeOptions
from swarmctl.bus.node import Node
from swarmctl.core.frames import Frame, Relayed, Seal, SnapshotAsked, StateShared
from swarmctl.core.observation import Observation

SEAL = Seal("test")
SEQS = st.integers(1, 8)


def node(hears: bool) -> Node:
    """Who asks of every message whether it is heard goes the general way."""
    rng = np.random.default_rng(1)
    made = Node(9, (1, 2, 9), NodeOptions(ROWS, COLS), SEAL, 1, rng, (lambda _a, _b: None) if hears else None)
    made.say(Observation(9, 1, 0.0, ((0, 0, False), (0, 1, True)), 1), 0.0, UNIX_S)
    return made


def observation(uav: int, incarnation: int, seq: int, n: int, occupied: bool, ahead_s: float) -> Frame:
    seen = Observation(uav, seq, 1.0, ((0, seq % 3, occupied), (1, seq, False)), incarnation)
    return Frame(uav, incarnation, n, UNIX_S + ahead_s, seen, 46.0, 14.0)


OBSERVATIONS = st.builds(
    observation,
    st.sampled_from((1, 2, 3)),
    st.integers(1, 2),
    SEQS,
    st.integers(1, 12),
    st.booleans(),
    st.sampled_from((0.0, 0.0, 0.0, 8.0, -70.0)),
)
STATES = st.builds(
    lambda uav, n, seq: Frame(uav, 1, n, UNIX_S, StateShared(0.0, 46.0, 14.0, 30.0, "flying", 0, 0, seq)),
    st.sampled_from((1, 2)),
    st.integers(1, 12),
    SEQS,
)
PASSED_ON = st.builds(
    lambda frames, n: Frame(2, 1, n, UNIX_S, Relayed(tuple(SEAL.close(frame) for frame in frames))),
    st.lists(OBSERVATIONS, min_size=1, max_size=4),
    st.integers(1, 12),
)
IN_A_ROW = st.integers(1, 8).map(
    lambda last: [observation(1, 1, seq, seq, False, 0.0) for seq in range(1, last + 1)]
)
HISTORIES = st.tuples(IN_A_ROW, st.lists(OBSERVATIONS | STATES | PASSED_ON, max_size=20))


@given(HISTORIES, st.lists(st.floats(0.0, 4.0), min_size=28, max_size=28))
def test_both_ways_come_to_the_same(history: tuple[list[Frame], list[Frame]], pauses_s: list[float]) -> None:
    nodes, now_s = (node(hears=False), node(hears=True)), 0.0
    for frame, pause_s in zip((*history[0], *history[1]), pauses_s, strict=False):
        now_s += pause_s
        took = [
            each.receive(frame.sender, frame.act, SEAL.close(frame), now_s, UNIX_S + now_s) for each in nodes
        ]
        assert took[0].news == took[1].news
        assert took[0].said == took[1].said
        assert [out.to for out in took[0].out] == [out.to for out in took[1].out]
        assert nodes[0].tally == nodes[1].tally
        assert nodes[0].next_deadline_s == nodes[1].next_deadline_s
    asks = [each.say(state(), now_s, UNIX_S + now_s).out[0].data for each in nodes]
    told = [SEAL.open(data).content for data in asks]
    assert isinstance(told[0], StateShared)
    assert told[0] == told[1]
    question = Frame(1, 3, 1, UNIX_S + now_s, SnapshotAsked((), ()))
    answers = [each.receive(1, question.act, SEAL.close(question), now_s, UNIX_S + now_s) for each in nodes]
    frames = [[SEAL.open(out.data).content for out in answer.out] for answer in answers]
    assert frames[0] == frames[1]
