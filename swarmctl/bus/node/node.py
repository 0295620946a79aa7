"""One UAV's part in the swarm's network, as a state machine: frames and time in, frames out. No I/O.

The node sends and stores its agent's observations, checks the messages of other UAVs, and replicates all
observations to all UAVs. The node requests missing observations from a peer:

- at the peer's first message, and at the first message after a silence
- when the peer has an observation that is missing here
- every few seconds, from one neighbour whose observations seem to differ
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable

import numpy as np

from swarmctl.bus.node.contradictions import Contradictions
from swarmctl.bus.node.decoding import DecodedFrame, DecodeFrame
from swarmctl.bus.node.exchange import (
    Instant,
    NetworkCounters,
    NewestT,
    NodeOptions,
    NodeOutput,
    OutgoingMessage,
)
from swarmctl.bus.node.peer import (
    WORK_PER_OBSERVATION,
    WORK_PER_OTHER_FRAME,
    PeerRecord,
    check_message,
    check_time,
    nearest_uavs,
    states_since,
    too_fast,
)
from swarmctl.bus.node.replica import COMPACT_AFTER, Replica, SourceRecord
from swarmctl.bus.node.request_schedule import RequestSchedule
from swarmctl.bus.node.sender import Sender, split_frames
from swarmctl.core.frames import (
    AgentMessage,
    Content,
    FrameCodec,
    IntentShared,
    MemberShared,
    MessageRefused,
    RefusalReason,
    Relayed,
    Snapshot,
    SnapshotAsked,
    StateShared,
    act_of,
)
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.observation import BeliefItem, Checkpoint, Observation, Source
from swarmctl.core.records import replace

CHECKPOINT_EVERY = 64
"""number of own observations between two checkpoints"""
MAX_DEFERRED_PER_TICK = 8
"""largest number of checkpoints without new observations that the agent receives at a tick"""
MAX_REFUSED_FRAMES = 8
"""number of refused frames inside a message after which the rest of the message is skipped"""

DistanceLoss = Callable[[LatLon | None, LatLon | None], str | None]
"""(own position, sender's position) -> cause of loss; None if the message is received"""


class Node:
    """The node of one UAV."""

    def __init__(
        self,
        uav: int,
        others: Iterable[int],
        options: NodeOptions,
        codec: FrameCodec,
        decode: DecodeFrame,
        incarnation: int,
        rng: np.random.Generator,
        distance_loss: DistanceLoss | None = None,
    ) -> None:
        self.uav = uav
        self.incarnation = incarnation
        self.counters = NetworkCounters()
        self._sender = Sender(uav, incarnation, codec)
        self._options = options
        self.k = options.k
        """number of nearest UAVs that each message goes to; None: all"""
        self._decode = decode
        self._peers = {other: PeerRecord() for other in sorted(set(others) - {uav})}
        self._replica = Replica()
        self._own = self._replica.of((uav, incarnation))
        self._contradictions = Contradictions(uav, options, self.counters.flagged)
        self._deferred: dict[Source, Checkpoint] = {}
        """checkpoints without new observations; these only save memory, so the agent gets a few at a tick"""
        self._requests = RequestSchedule(options, rng)
        self._rng = rng
        self._distance_loss = distance_loss
        self._output = NodeOutput()
        """output of the current call"""

    def take_new(self, kind: type[NewestT]) -> list[tuple[int, tuple[float, NewestT]]]:
        """Return (UAV, (unix time [s], newest message of this kind)) of each UAV with a new message.

        A message is new until it is taken. A member's route is the last one that the member sent.
        """
        return [(uav, peer.take(kind)) for uav, peer in self._peers.items() if kind in peer.untaken]

    def moved(self, position: LatLon) -> None:
        """Update the UAV's position between two state messages."""
        self._sender.position = position

    # --- messages of the agent

    def publish(
        self,
        message: AgentMessage,
        now: Instant,
        against: frozenset[Cell] = frozenset(),
        group: tuple[int, ...] = (),
    ) -> NodeOutput:
        """Send a message of the agent.

        `group`: the receivers of a member's message, as far as they are in range.
        `against`: cells in which the agent's observation contradicts earlier reports of other UAVs.
        """
        output = self._output = NodeOutput()
        if isinstance(message, StateShared):
            self._sender.position = message.lat_deg, message.lon_deg
        to = self._receivers(now)
        match message:
            case Observation():
                self._replica.add(self._own, self._decode(self._send(message, to, now)))
                self._contradictions.record_own(message)
                for decoded in self._replica.frames() if against else ():
                    output.notices += self._contradictions.find(decoded, against)
                # UAVs make checkpoints at different times.
                if (message.seq + self.uav) % CHECKPOINT_EVERY == 0:
                    self._make_checkpoint(to, now)
            case IntentShared():
                self._send(message, to, now)
            case MemberShared():
                self._send(message, tuple(u for u in to if u in group), now)
            case StateShared():
                state = replace(
                    message,
                    last_seq=self._own.latest,
                    knows=self._replica.fingerprint,
                    refused=self.counters.refused.total(),
                    flagged=tuple(sorted(self.counters.flagged)),
                )
                self._send(state, (*to, *self._random_silent_uav(to, now)), now)
        return output

    def restore(self, observations: Iterable[tuple[float, Observation]]) -> None:
        """Store own observations of earlier incarnations, each with its unix time, to answer requests."""
        for unix_s, seen in observations:
            decoded = self._decode(self._sender.earlier_frame(seen, unix_s))
            # After more restarts than peers accept, further observations are only in the agent's belief.
            with contextlib.suppress(MessageRefused):
                self._replica.add(self._replica.of(seen.source), decoded)
            self._contradictions.record_own(seen)

    def _random_silent_uav(self, receivers: tuple[int, ...], now: Instant) -> tuple[int, ...]:
        """Return a random UAV outside of the communication range and without recent news; () if none.

        Without these messages two groups would stay separate if every UAV has `k` neighbours in its group.
        """
        if not receivers or not self._requests.is_enabled or len(receivers) == len(self._peers):
            return ()
        silent = [
            u
            for u, p in self._peers.items()
            if u not in receivers and (p.state is None or p.is_ranked_last(now.run_s))
        ]
        return (silent[int(self._rng.integers(len(silent)))],) if silent else ()

    def _make_checkpoint(self, to: tuple[int, ...], now: Instant) -> None:
        """Replace own observations by a checkpoint and send it, if it is shorter or replaces many."""
        replaced = self._own.in_order
        made = self._own.summary(self._options.rows, self._options.cols)
        if made is None:
            return
        data = self._sender.frame(made, now.unix_s)
        if len(replaced) < COMPACT_AFTER and len(data) > sum(len(decoded.data) for decoded in replaced):
            return
        self._replica.add(self._own, self._decode(data))
        # With requests disabled, no checkpoint is sent: a checkpoint would deliver missed observations.
        if self._requests.is_enabled:
            self._deferred[made.source] = made
            self._send(Relayed((data,)), to, now)

    # --- messages of other UAVs

    def receive_bytes(self, sender: int, act: str, data: bytes, now: Instant) -> NodeOutput:
        """Check and handle a message of another process; sender and act are those of its key."""
        try:
            limit = self._peer(sender).bytes_limit
            if not limit.try_take(now.run_s, len(data)):
                raise too_fast(limit, "bytes")
            decoded = self._decode(data)
            check_message(sender, act, decoded.frame, now.unix_s, self._options)
        except MessageRefused as refused:
            self._output = NodeOutput()
            self._refuse(refused, f"of vehicle {sender}", sender)
            return self._output
        return self.receive(decoded, now)

    def receive(self, decoded: DecodedFrame, now: Instant) -> NodeOutput:
        """Handle a message of another UAV."""
        output = self._output = NodeOutput()
        frame, sender = decoded.frame, decoded.frame.sender
        try:
            peer, loss = self._peer(sender), self._distance_loss
            if loss is not None and (cause := loss(self._sender.position, frame.at)):
                self.counters.lost[cause] += 1
                return output
            if peer.admit(frame, now.run_s):  # nothing was heard from the peer for a while
                self._requests.schedule(sender, now.run_s)
            self._handle(peer, decoded, now)
            self._send_requests(now)
        except MessageRefused as refused:
            self._refuse(refused, f"of vehicle {sender}", sender)
        else:
            self.counters.received += 1
        return output

    def _peer(self, uav: int) -> PeerRecord:
        """Return the record of another UAV. Raises MessageRefused for an unknown UAV."""
        if (peer := self._peers.get(uav)) is None:
            raise MessageRefused(RefusalReason.STRANGER, f"vehicle {uav} does not belong to this swarm")
        return peer

    def _refuse(self, refused: MessageRefused, origin: str, sender: int) -> None:
        self.count_refusal(refused.why, sender)
        self._output.notices.append((refused.why, f"a message {origin} was refused: {refused}"))

    def count_refusal(self, why: RefusalReason, sender: int | None) -> None:
        self.counters.refused[why] += 1
        if sender in self._peers:
            self.counters.refused_from[sender] += 1

    def _handle(self, peer: PeerRecord, decoded: DecodedFrame, now: Instant) -> None:
        sender = decoded.frame.sender
        match decoded.frame.content:
            case Observation() as seen:
                record = self._replica.of(decoded.source)
                if self._store(record, seen, decoded) and self._options.relay:
                    self._relay([decoded], sender, now)
                if record.upto < seen.seq:
                    peer.record_missing()
                    self._requests.schedule(sender, now.run_s)
            case StateShared() as state:
                peer.update(decoded, now.run_s)
                record = self._replica.of(decoded.source)
                peer.direct_state_s = now.run_s
                if record.upto < state.last_seq:
                    peer.agreed_s = -math.inf
                    self._requests.schedule(sender, now.run_s)
                elif self._replica.has_held(state.knows):
                    peer.agreed_s = now.run_s
            case IntentShared() | MemberShared():
                peer.update(decoded, now.run_s)
            case SnapshotAsked() as asked:
                self._answer(peer, sender, asked, now)
            case Snapshot(frames=frames, last=last):
                self._handle_all_relayed(frames, sender, now)
                self._requests.record_answer(sender, has_news=bool(self._output.news), is_last=last)
            case Relayed(frames=frames):
                fresh = self._handle_all_relayed(frames, sender, now)
                if fresh and self._options.relay:
                    self._relay(fresh, sender, now)
            case _:
                raise MessageRefused(
                    RefusalReason.MALFORMED, f"{decoded.frame.act} is valid only inside another message"
                )

    def _store(self, record: SourceRecord, item: BeliefItem, decoded: DecodedFrame) -> bool:
        """Store an observation or checkpoint; return whether it is new. Raises MessageRefused."""
        was_upto = record.upto
        try:
            if not self._replica.add(record, decoded):
                return False
        except MessageRefused:
            self.counters.flagged[item.observer] = max(self.counters.flagged[item.observer], 1)
            raise
        if isinstance(item, Checkpoint) and item.upto <= was_upto:
            self._deferred[item.source] = item
            return True
        self._output.notices += self._contradictions.find(decoded)
        self._output.news.append(item)
        return True

    def _handle_all_relayed(self, frames: Iterable[bytes], sender: int, now: Instant) -> list[DecodedFrame]:
        """Handle relayed frames, and return the new frames; skip the rest after too many refused frames."""
        fresh, n_refused, peer = [], 0, self._peers[sender]
        for data in frames:
            try:
                decoded = self._decode(data)
                steps = WORK_PER_OBSERVATION if decoded.seq else WORK_PER_OTHER_FRAME
                if not peer.work_limit.try_take(now.run_s, steps):
                    raise too_fast(peer.work_limit, "steps of work")
                if self._handle_relayed(decoded, now):
                    fresh.append(decoded)
            except MessageRefused as refused:
                n_refused += 1
                self._refuse(refused, f"relayed by vehicle {sender}", sender)
                if n_refused == MAX_REFUSED_FRAMES or refused.why is RefusalReason.TOO_FAST:
                    break
        return fresh

    def _handle_relayed(self, decoded: DecodedFrame, now: Instant) -> bool:
        """Handle a relayed frame; return whether it is a new observation or checkpoint."""
        frame = decoded.frame
        check_time(frame, now.unix_s, self._options)
        peer = None if frame.sender == self.uav else self._peer(frame.sender)
        content = frame.content
        if isinstance(content, Observation | Checkpoint):
            record = self._replica.of(decoded.source)
            if record is not self._own:
                return self._store(record, content, decoded)
            if decoded.seq > record.latest:
                raise MessageRefused(
                    RefusalReason.TWO_CONTENTS,
                    f"another process flies vehicle {self.uav}: {content.two_contents}",
                )
            return False
        if not isinstance(content, StateShared | IntentShared):
            raise MessageRefused(RefusalReason.MALFORMED, f"{frame.act} is not valid inside another message")
        if peer is not None and now.unix_s - frame.unix_s <= self._options.max_age_s:
            peer.update(decoded, now.run_s)
        return False

    def _relay(self, frames: list[DecodedFrame], received_from: int, now: Instant) -> None:
        observers = {decoded.frame.sender for decoded in frames}
        to = tuple(u for u in self._receivers(now) if u != received_from and observers != {u})
        if to:
            self.counters.relayed += len(frames)
            for part in split_frames([decoded.data for decoded in frames]):
                self._send(Relayed(part), to, now)

    # --- requests for missed observations

    def tick(self, now: Instant) -> NodeOutput:
        output = self._output = NodeOutput()
        if self._requests.tick(now.run_s):
            for source in [*self._deferred][:MAX_DEFERRED_PER_TICK]:
                output.news.append(self._deferred.pop(source))
            receivers = self._receivers(now)
            known = [u for u in receivers if self._peers[u].state is not None]
            differing = [u for u in known if not self._peers[u].agrees(self._replica, now.run_s)]
            neighbours = differing if known else receivers
            if neighbours:
                self._requests.schedule(neighbours[int(self._rng.integers(len(neighbours)))], now.run_s)
        self._send_requests(now)
        return output

    @property
    def next_deadline_s(self) -> float:
        """Time at which the node must tick again [s]."""
        return self._requests.next_deadline_s

    def _send_requests(self, now: Instant) -> None:
        while (uav := self._requests.pop_due(now.run_s)) is not None:
            if not self._peers[uav].agrees(self._replica, now.run_s):
                newest = ((u, p.newest.get(StateShared)) for u, p in self._peers.items())
                states = tuple((u, decoded.frame.unix_s) for u, decoded in newest if decoded is not None)
                self._send(SnapshotAsked(self._replica.digest(), states), (uav,), now)
                self.counters.snapshots_asked += 1
                self._requests.record_request(uav, now.run_s)

    def _answer(self, peer: PeerRecord, asker: int, asked: SnapshotAsked, now: Instant) -> None:
        if not peer.request_limit.try_take(now.run_s):
            raise too_fast(peer.request_limit, "requests")
        frames = list(self._replica.missing(asked.have))
        frames += states_since(
            (p for uav, p in self._peers.items() if uav != asker), dict(asked.states), now.unix_s
        )
        parts = list(split_frames(frames))
        for i, part in enumerate(parts):
            self._send(Snapshot(part, i == len(parts) - 1), (asker,), now)
        self.counters.snapshots_served += 1
        if self._replica.lacks(asked.have):
            peer.record_missing()
            self._requests.schedule(asker, now.run_s)

    # --- output

    def _receivers(self, now: Instant) -> tuple[int, ...]:
        """Return the UAVs in communication range."""
        return nearest_uavs(self._sender.position, self._peers, self.k, now.run_s)

    def _send(self, content: Content, to: tuple[int, ...], now: Instant) -> bytes:
        """Send a message, counted for each receiver; return its frame."""
        data, act = self._sender.frame(content, now.unix_s), act_of(content)
        self.counters.sent[act] += len(to)
        self.counters.sent_bytes += len(data) * len(to)
        self._output.messages.append(OutgoingMessage(to, act, data))
        return data
