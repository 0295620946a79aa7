"""One UAV's part in the swarm's network, as a machine: frames and time in, frames out. Pure.

It numbers and keeps what its agent sees, takes from others what is theirs to tell, and sees to it that what
is known to one ends up known to all: it asks a peer for what it lacks when that peer is first heard or heard
again, when a number is missing, and every few seconds one neighbour whose knowledge differs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from swarmctl.bus.node.admission import check_age, check_source, check_time, is_stale
from swarmctl.bus.node.contradictions import Doubts
from swarmctl.bus.node.counters import Tally
from swarmctl.bus.node.decoding import Read, Reading, reader
from swarmctl.bus.node.exchange import NodeOptions, Took
from swarmctl.bus.node.ledger import Column, Ledger
from swarmctl.bus.node.peer import A_CHECKPOINT, A_FRAME, ASK_AGAIN_S, QUESTIONS_PER_S, Peer, told_since
from swarmctl.bus.node.questions import Questions
from swarmctl.bus.node.replica import COMPACT_AFTER, Kept, Replica
from swarmctl.bus.node.sender import Voice, in_parts
from swarmctl.core.frames import (
    Content,
    IntentShared,
    Refused,
    Relayed,
    Seal,
    Snapshot,
    SnapshotAsked,
    Spoken,
    StateShared,
    Why,
)
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Checkpoint, Observation, Source, Told, checkpoint

CHECKPOINT_EVERY = 64
"""own observations"""
UNHURRIED = 8
"""checkpoints of what it knows already that an agent is told at once"""
MAX_WRONG = 8
"""frames inside of a message; the rest of it is not looked at"""


Hears = Callable[[LatLon | None, LatLon | None], str | None]
"""(here, where the sender is) -> why it is not heard; None where it is"""


class Node:
    """One UAV's. `now_s` is the run's clock in simulated seconds, `unix_s` the wall clock's stamp."""

    def __init__(
        self,
        uav: int,
        others: Iterable[int],
        options: NodeOptions,
        seal: Seal,
        incarnation: int,
        rng: np.random.Generator,
        hears: Hears | None = None,
        read: Read | None = None,
        ledger: Ledger | None = None,
    ) -> None:
        self.uav = uav
        self.incarnation = incarnation
        self._tally = Tally()
        self._voice = Voice(uav, incarnation, seal, self._tally)
        self._options = options
        self._read = read or reader(seal, options.rows, options.cols)
        self._self = (uav, incarnation)
        others = set(others) - {uav}
        ledger = ledger or Ledger((uav, *others), options)
        self._column = column = Column(ledger, uav)
        self._peers = {other: Peer(column, ledger.place(other)) for other in sorted(others)}
        self._replica = Replica(column)
        self._doubts = Doubts(
            uav,
            column,
            options.rows,
            options.cols,
            perfect=options.perfect_sensors,
            flagged=self._tally.flagged,
        )
        self._spread = 0
        """what the last of its checkpoints that was sent to others stands for"""
        self._said_since_bytes = 0
        """in observations"""
        self._unhurried: dict[Source, Checkpoint] = {}
        """of what the agent knows: they only save room, and are told it a few at a time"""
        self._questions = Questions(options, rng)
        self._rng = rng
        self._hears = hears

    @property
    def tally(self) -> Tally:
        self._tally.received += self._column.taken()
        return self._tally

    def states(self) -> dict[int, StateShared]:
        """The newest that each of the others has told of itself."""
        return {uav: peer.state for uav, peer in self._peers.items() if peer.state is not None}

    def intents(self) -> dict[int, tuple[IntentShared, float]]:
        """The newest that each of the others has told of where it will be, and when it said so (unix) [s]."""
        peers = self._peers.items()
        return {uav: (peer.intent, peer.intent_unix_s) for uav, peer in peers if peer.intent is not None}

    def moved(self, at: LatLon) -> None:
        """Where it is, oftener than it tells others."""
        self._voice.at = at

    # --- what the agent says

    def say(
        self, message: Spoken, now_s: float, unix_s: float, against: frozenset[Cell] = frozenset()
    ) -> Took:
        """`against` are the cells that were seen otherwise than others had told."""
        took = Took()
        if isinstance(message, Observation):
            to = self._reach(now_s)
            data = self._send(took, message, to, unix_s)
            self._said_since_bytes += len(data)
            self._keep(message, data)
            self._doubts.saw(message)
            if against:
                took.said += self._doubts.of_earlier(self._replica.readings(), against)
            if (message.seq + self.uav) % CHECKPOINT_EVERY == 0:  # not all of a swarm at once
                self._make_checkpoint(took, to, unix_s)
        elif isinstance(message, IntentShared):
            self._send(took, message, self._reach(now_s), unix_s)
        else:
            self._voice.at = message.lat_deg, message.lon_deg
            state = msgspec.structs.replace(
                message,
                last_seq=self._replica.of(self._self).latest,
                knows=self._column.fingerprint,
                refused=self._tally.refused.total(),
                flagged=tuple(sorted(self._tally.flagged)),
            )
            reach = self._reach(now_s)
            self._send(took, state, (*reach, *self._lost_one(reach, now_s)), unix_s)
        return took

    def _lost_one(self, reach: tuple[int, ...], now_s: float) -> tuple[int, ...]:
        """One of those of whom nothing is heard, beyond its range.

        Groups that were apart for long would stay so for ever if each had enough others to speak to.
        """
        if not reach or self._options.sync_every_s == 0.0 or len(reach) == len(self._peers):
            return ()
        silent = self._column.silent(now_s)
        lost = [
            u for u, p in self._peers.items() if u not in reach and (p.told_state is None or silent[p.row])
        ]
        return (lost[int(self._rng.integers(len(lost)))],) if lost else ()

    def _keep(self, own: Told, data: bytes) -> None:
        self._replica.take(self._replica.of(self._self), own, self._read(data))

    def _make_checkpoint(self, took: Took, to: tuple[int, ...], unix_s: float) -> None:
        """For who asks; now and then for all, who would keep every observation for ever else."""
        kept, o = self._replica.of(self._self), self._options
        contents = (reading.frame.content for reading in kept.after(0))
        seen = [content for content in contents if isinstance(content, Observation)]
        made = checkpoint(kept.checkpoint, seen, o.cols, o.rows * o.cols)
        if made is None:
            return
        data = self._voice.frame(made, unix_s)
        self._keep(made, data)
        # Where nobody asks for what was missed, nobody is to get it this way either.
        is_worth_it = len(data) <= self._said_since_bytes or made.upto >= self._spread + COMPACT_AFTER
        if is_worth_it and self._questions.are_asked:
            self._spread, self._said_since_bytes = made.upto, 0
            self._unhurried[made.source] = made
            self._send(took, Relayed((data,)), to, unix_s)

    # --- what others say

    def receive(self, sender: int, act: str, data: bytes, now_s: float, unix_s: float) -> Took:
        """A message from `sender`, by the key it came under."""
        try:
            self._peer(sender).weigh(len(data), now_s)
            reading = self._read(data)
        except Refused as refused:
            took = Took()
            self._refused(took, refused, sender)
            return took
        return self.hear(sender, act, reading, now_s, unix_s)

    def hear(self, sender: int, act: str, reading: Reading, now_s: float, unix_s: float) -> Took:
        """The same once it has been read, and weighed where anybody could have sent it."""
        took = Took()
        try:
            if self._hears is not None and (lost := self._hears(self._voice.at, reading.frame.at)):
                self._tally.lost[lost] += 1
                return took
            peer = self._peer(sender)
            self._admit(peer, sender, act, reading, now_s, unix_s)
            self._handle(took, peer, reading, now_s, unix_s)
            self._ask(took, now_s, unix_s)
        except Refused as refused:
            self._refused(took, refused, sender)
        else:
            self._tally.received += 1
        return took

    def _refused(self, took: Took, refused: Refused, sender: int) -> None:
        self.refuse(refused.why, sender)
        took.said.append((refused.why, f"from vehicle {sender}: {refused}"))

    def _peer(self, uav: int) -> Peer:
        """Raises Refused where there is none."""
        peer = self._peers.get(uav)
        if peer is None:
            raise Refused(Why.STRANGER, f"vehicle {uav} is not of this swarm")
        return peer

    def refuse(self, why: Why, sender: int | None) -> None:
        self._tally.refused[why] += 1
        if sender in self._peers:
            self._tally.refused_from[sender] += 1

    def _admit(
        self, peer: Peer, sender: int, act: str, reading: Reading, now_s: float, unix_s: float
    ) -> None:
        """Raises Refused unless this is `sender`'s, and a message that has not come before."""
        frame = reading.frame
        check_source(reading, sender, act)
        check_time(frame, unix_s, self._options)
        check_age(frame, unix_s, self._options)
        if peer.admit(frame, now_s):
            self._ask_soon(sender, now_s)

    def _handle(self, took: Took, peer: Peer, reading: Reading, now_s: float, unix_s: float) -> None:
        sender = reading.frame.sender
        match reading.frame.content:
            case Observation() as seen:
                kept = peer.keeps(self._replica.of(reading.source))
                if self._take(took, kept, seen, reading):
                    self._relay(took, [reading.data], sender, now_s, unix_s)
                if kept.upto < seen.seq:
                    self._lacks(sender, now_s)
            case StateShared() as state:
                self._told(peer, reading, state, now_s)
            case IntentShared() as intent:
                peer.intends(reading.frame, intent, reading.data)
            case SnapshotAsked() as asked:
                self._answer(took, sender, asked, now_s, unix_s)
            case Snapshot(frames=frames, last=last):
                self._forwarded(took, frames, sender, now_s, unix_s)
                if took.news:
                    peer.ask_again_s = ASK_AGAIN_S
                if last:
                    self._questions.answered(sender)
            case Relayed(frames=frames):
                fresh = self._forwarded(took, frames, sender, now_s, unix_s)
                self._relay(took, fresh, sender, now_s, unix_s)
            case _:
                raise Refused(Why.MALFORMED, f"{reading.act} comes inside of other messages only")

    def _told(self, peer: Peer, reading: Reading, state: StateShared, now_s: float) -> None:
        """By itself, where it is and how much it knows."""
        peer.told(reading, now_s)
        if peer.kept is None:
            peer.keeps(self._replica.of(reading.source))
        if peer.said(state, now_s):
            self._ask_soon(reading.frame.sender, now_s)

    def _take(self, took: Took, kept: Kept, told: Told, reading: Reading) -> bool:
        """Whether it was new."""
        if reading.source == self._self:
            if isinstance(told, Observation) and told.seq > kept.latest:
                raise Refused(
                    Why.TWO_CONTENTS, f"another process flies vehicle {self.uav}: {told.two_contents}"
                )
            return False
        was_upto = kept.upto
        try:
            if not self._replica.take(kept, told, reading):
                return False
        except Refused:
            self._tally.flagged[told.observer] = max(self._tally.flagged[told.observer], 1)
            raise
        if isinstance(told, Checkpoint) and told.upto <= was_upto and self._questions.are_asked:
            self._unhurried[told.source] = told
            return True
        took.said += self._doubts.of(reading)
        took.news.append(told)
        return True

    def _forwarded(
        self, took: Took, frames: Iterable[bytes], sender: int, now_s: float, unix_s: float
    ) -> list[bytes]:
        """Frames of others; returns those that were new. A few that are wrong do not spoil the others."""
        fresh, wrong, peer = [], 0, self._peers[sender]
        for data in frames:
            try:
                reading = self._read(data)
                peer.work(A_FRAME if reading.seq else A_CHECKPOINT, now_s)
                if self._forwarded_one(took, reading, now_s, unix_s):
                    fresh.append(data)
            except Refused as refused:
                wrong += 1
                self.refuse(refused.why, sender)
                took.said.append((refused.why, f"passed on by vehicle {sender}: {refused}"))
                if wrong == MAX_WRONG or refused.why is Why.TOO_FAST:
                    break
        return fresh

    def _forwarded_one(self, took: Took, reading: Reading, now_s: float, unix_s: float) -> bool:
        """Whether it was something new that was seen."""
        frame = reading.frame
        check_time(frame, unix_s, self._options)
        peer = None if frame.sender == self.uav else self._peer(frame.sender)
        seen = frame.content
        if isinstance(seen, Observation) and peer is not None and self._doubts.has_none_of(reading):
            kept = self._replica.of(reading.source)
            if kept.is_next(reading):  # as nearly all are, of thousands
                self._replica.append(kept, reading)
                took.news.append(seen)
                return True
        match seen:
            case StateShared():
                if peer is not None and not is_stale(frame, unix_s, self._options):
                    peer.told(reading, now_s)
                return False
            case IntentShared() as intent:
                if peer is not None and not is_stale(frame, unix_s, self._options):
                    peer.intends(frame, intent, reading.data)
                return False
            case Observation() | Checkpoint() as told:
                return self._take(took, self._replica.of(reading.source), told, reading)
        raise Refused(Why.MALFORMED, f"{reading.act} is not passed on")

    def _relay(self, took: Took, frames: list[bytes], heard_from: int, now_s: float, unix_s: float) -> None:
        if not self._options.relay or not frames:
            return
        observers = {self._read(data).frame.sender for data in frames}
        to = tuple(u for u in self._reach(now_s) if u != heard_from and observers != {u})
        if to:
            self._tally.relayed += len(frames)
            for part in in_parts(frames):
                self._send(took, Relayed(part), to, unix_s)

    # --- what was missed

    def _ask_soon(self, peer: int, now_s: float) -> None:
        self._questions.soon(peer, now_s, self._peers[peer].ask_after_s)

    def _lacks(self, peer: int, now_s: float) -> None:
        """Something that this peer has."""
        self._peers[peer].has_more()
        self._ask_soon(peer, now_s)

    def tick(self, now_s: float, unix_s: float) -> Took:
        took = Took()
        if self._questions.tick(now_s):
            for source in [*self._unhurried][:UNHURRIED]:
                took.news.append(self._unhurried.pop(source))
            reach = self._reach(now_s)
            heard = [u for u in reach if self._peers[u].state is not None]
            neighbours = [u for u in heard if not self._agrees(u, now_s)] if heard else list(reach)
            if neighbours:
                self._ask_soon(neighbours[int(self._rng.integers(len(neighbours)))], now_s)
        self._ask(took, now_s, unix_s)
        return took

    @property
    def next_deadline_s(self) -> float:
        """When to `tick` at the latest."""
        return self._questions.next_deadline_s

    def _agrees(self, peer: int, now_s: float) -> bool:
        return self._peers[peer].agrees(now_s)

    def _ask(self, took: Took, now_s: float, unix_s: float) -> None:
        for peer in self._questions.due(now_s):
            if not self._agrees(peer, now_s):
                told = ((u, p.told_state) for u, p in self._peers.items())
                states = tuple((u, state.frame.unix_s) for u, state in told if state is not None)
                self._send(took, SnapshotAsked(self._replica.digest(), states), (peer,), unix_s)
                self._tally.snapshots_asked += 1
                self._questions.asked(peer, now_s)
                self._peers[peer].asked(now_s)

    def _answer(self, took: Took, asker: int, asked: SnapshotAsked, now_s: float, unix_s: float) -> None:
        if not self._peers[asker].may_ask(now_s):
            raise Refused(Why.TOO_FAST, f"vehicle {asker} asks more than {QUESTIONS_PER_S:g} times a second")
        frames = list(self._replica.missing(asked.have))
        frames += told_since(
            (p for uav, p in self._peers.items() if uav != asker), dict(asked.states), unix_s
        )
        parts = list(in_parts(frames))
        for i, part in enumerate(parts):
            self._send(took, Snapshot(part, i == len(parts) - 1), (asker,), unix_s)
        self._tally.snapshots_served += 1
        if self._replica.lacks(asked.have):
            self._lacks(asker, now_s)

    # --- out

    def _reach(self, now_s: float) -> tuple[int, ...]:
        """Whom it speaks to."""
        return self._column.nearest(self._voice.at, self._options.k, now_s)

    def _send(self, took: Took, content: Content, to: tuple[int, ...], unix_s: float) -> bytes:
        out = self._voice.says(content, to, unix_s)
        took.out.append(out)
        return out.data
