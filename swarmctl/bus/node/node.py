"""One UAV's part in the swarm's network, as a state machine: frames and time in, frames out. No I/O.

The node sends and stores its agent's observations, checks the messages of other UAVs, and replicates all
observations to all UAVs. The node requests missing observations from a peer:

- at the peer's first message, and at the first message after a silence
- when the peer has an observation that is missing here
- every few seconds, from one neighbour whose observations seem to differ
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from swarmctl.bus.node.contradictions import Contradictions
from swarmctl.bus.node.decoding import DecodedFrame, DecodeFrame, frame_decoder
from swarmctl.bus.node.exchange import NetworkCounters, NodeOptions, NodeOutput
from swarmctl.bus.node.peer import (
    MIN_REQUEST_PAUSE_S,
    REQUESTS_PER_S,
    WORK_PER_OBSERVATION,
    WORK_PER_OTHER_FRAME,
    PeerRecord,
    check_age,
    check_source,
    check_time,
    is_stale,
    states_since,
)
from swarmctl.bus.node.reception import ReceptionColumn, ReceptionTable
from swarmctl.bus.node.replica import COMPACT_AFTER, Replica, SourceRecord
from swarmctl.bus.node.request_schedule import RequestSchedule
from swarmctl.bus.node.sender import Sender, split_frames
from swarmctl.core.frames import (
    AgentMessage,
    Content,
    FrameCodec,
    IntentShared,
    MessageRefused,
    RefusalReason,
    Relayed,
    Snapshot,
    SnapshotAsked,
    StateShared,
)
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell
from swarmctl.core.observation import BeliefItem, Checkpoint, Observation, Source, checkpoint

CHECKPOINT_EVERY = 64
"""number of own observations between two checkpoints"""
MAX_DEFERRED_PER_TICK = 8
"""largest number of checkpoints without new observations that the agent receives at a tick"""
MAX_REFUSED_FRAMES = 8
"""number of refused frames inside a message after which the rest of the message is skipped"""


DistanceLoss = Callable[[LatLon | None, LatLon | None], str | None]
"""(own position, sender's position) -> cause of loss; None if the message is received"""


class Node:
    """The node of one UAV. `now_s` is the run's clock in simulated seconds, `unix_s` the wall clock."""

    def __init__(
        self,
        uav: int,
        others: Iterable[int],
        options: NodeOptions,
        codec: FrameCodec,
        incarnation: int,
        rng: np.random.Generator,
        distance_loss: DistanceLoss | None = None,
        decode: DecodeFrame | None = None,
        table: ReceptionTable | None = None,
    ) -> None:
        self.uav = uav
        self.incarnation = incarnation
        self._counters = NetworkCounters()
        self._sender = Sender(uav, incarnation, codec, self._counters)
        self._options = options
        self._decode = decode or frame_decoder(codec, options.rows, options.cols)
        self._own_source = (uav, incarnation)
        others = set(others) - {uav}
        table = table or ReceptionTable((uav, *others), options)
        self._column = column = ReceptionColumn(table, uav)
        self._peers = {other: PeerRecord(column, table.index_of(other)) for other in sorted(others)}
        self._replica = Replica(column)
        self._contradictions = Contradictions(
            uav,
            column,
            options.rows,
            options.cols,
            perfect=options.perfect_sensors,
            flagged=self._counters.flagged,
        )
        self._last_sent_upto = 0
        """number of the last observation in the newest sent checkpoint"""
        self._sent_since_bytes = 0
        """bytes of observations sent after the newest sent checkpoint"""
        self._deferred: dict[Source, Checkpoint] = {}
        """checkpoints without new observations; these only save memory, so the agent gets a few at a tick"""
        self._requests = RequestSchedule(options, rng)
        self._rng = rng
        self._distance_loss = distance_loss

    @property
    def counters(self) -> NetworkCounters:
        self._counters.received += self._column.pop_n_delivered()
        return self._counters

    def states(self) -> dict[int, StateShared]:
        """Return the newest known state of each other UAV."""
        return {uav: peer.state for uav, peer in self._peers.items() if peer.state is not None}

    def intents(self) -> dict[int, tuple[IntentShared, float]]:
        """Return the newest intent of each other UAV, and its unix time [s]."""
        peers = self._peers.items()
        return {uav: (peer.intent, peer.intent_unix_s) for uav, peer in peers if peer.intent is not None}

    def moved(self, position: LatLon) -> None:
        """Update the UAV's position between two state messages."""
        self._sender.position = position

    # --- messages of the agent

    def publish(
        self, message: AgentMessage, now_s: float, unix_s: float, against: frozenset[Cell] = frozenset()
    ) -> NodeOutput:
        """Send a message of the agent.

        `against`: cells in which the agent's observation contradicts earlier reports of other UAVs.
        """
        output = NodeOutput()
        if isinstance(message, Observation):
            to = self._receivers(now_s)
            data = self._send(output, message, to, unix_s)
            self._sent_since_bytes += len(data)
            self._store_own(message, data)
            self._contradictions.record_own(message)
            if against:
                output.notices += self._contradictions.find_earlier(self._replica.frames(), against)
            if (message.seq + self.uav) % CHECKPOINT_EVERY == 0:  # UAVs make checkpoints at different times
                self._make_checkpoint(output, to, unix_s)
        elif isinstance(message, IntentShared):
            self._send(output, message, self._receivers(now_s), unix_s)
        else:
            self._sender.position = message.lat_deg, message.lon_deg
            state = msgspec.structs.replace(
                message,
                last_seq=self._replica.of(self._own_source).latest,
                knows=self._column.fingerprint,
                refused=self._counters.refused.total(),
                flagged=tuple(sorted(self._counters.flagged)),
            )
            receivers = self._receivers(now_s)
            self._send(output, state, (*receivers, *self._random_silent_uav(receivers, now_s)), unix_s)
        return output

    def restore(self, observations: Iterable[tuple[float, Observation]]) -> None:
        """Store own observations of earlier incarnations, each with its unix time, to answer requests."""
        for unix_s, seen in observations:
            decoded = self._decode(self._sender.earlier_frame(seen, unix_s))
            # After more restarts than peers accept, the oldest observations are only in the agent's belief.
            with contextlib.suppress(MessageRefused):
                self._replica.add(self._replica.of(seen.source), seen, decoded)
            self._contradictions.record_own(seen)

    def _random_silent_uav(self, receivers: tuple[int, ...], now_s: float) -> tuple[int, ...]:
        """Return a random UAV outside of the communication range and without recent news; () if none.

        Without these messages two groups would stay separate if every UAV has `k` neighbours in its group.
        """
        if not receivers or self._options.sync_every_s == 0.0 or len(receivers) == len(self._peers):
            return ()
        is_ranked_last = self._column.is_ranked_last(now_s)
        silent = [
            u
            for u, p in self._peers.items()
            if u not in receivers and (p.state_frame is None or is_ranked_last[p.row])
        ]
        return (silent[int(self._rng.integers(len(silent)))],) if silent else ()

    def _store_own(self, own: BeliefItem, data: bytes) -> None:
        self._replica.add(self._replica.of(self._own_source), own, self._decode(data))

    def _make_checkpoint(self, output: NodeOutput, to: tuple[int, ...], unix_s: float) -> None:
        """Make a checkpoint; send a checkpoint that is short enough or replaces many frames."""
        record, options = self._replica.of(self._own_source), self._options
        contents = (decoded.frame.content for decoded in record.after(0))
        seen = [content for content in contents if isinstance(content, Observation)]
        made = checkpoint(record.checkpoint, seen, options.cols, options.rows * options.cols)
        if made is None:
            return
        data = self._sender.frame(made, unix_s)
        self._store_own(made, data)
        # With requests disabled, no checkpoint is sent: a checkpoint would deliver missed observations.
        is_long_due = made.upto >= self._last_sent_upto + COMPACT_AFTER
        if (len(data) <= self._sent_since_bytes or is_long_due) and self._requests.is_enabled:
            self._last_sent_upto, self._sent_since_bytes = made.upto, 0
            self._deferred[made.source] = made
            self._send(output, Relayed((data,)), to, unix_s)

    # --- messages of other UAVs

    def receive(self, sender: int, act: str, data: bytes, now_s: float, unix_s: float) -> NodeOutput:
        """Handle a message under the key of `sender`."""
        try:
            self._peer(sender).add_bytes(len(data), now_s)
            decoded = self._decode(data)
        except MessageRefused as refused:
            output = NodeOutput()
            self._note_refusal(output, refused, sender)
            return output
        return self.receive_decoded(sender, act, decoded, now_s, unix_s)

    def receive_decoded(
        self, sender: int, act: str, decoded: DecodedFrame, now_s: float, unix_s: float
    ) -> NodeOutput:
        """Handle a decoded message. Only `receive` counts bytes, for messages of other processes."""
        output = NodeOutput()
        try:
            if self._distance_loss is not None and (
                cause := self._distance_loss(self._sender.position, decoded.frame.at)
            ):
                self._counters.lost[cause] += 1
                return output
            peer = self._peer(sender)
            self._admit(peer, sender, act, decoded, now_s, unix_s)
            self._handle(output, peer, decoded, now_s, unix_s)
            self._send_requests(output, now_s, unix_s)
        except MessageRefused as refused:
            self._note_refusal(output, refused, sender)
        else:
            self._counters.received += 1
        return output

    def _note_refusal(self, output: NodeOutput, refused: MessageRefused, sender: int) -> None:
        self.count_refusal(refused.why, sender)
        output.notices.append((refused.why, f"a message of vehicle {sender} was refused: {refused}"))

    def _peer(self, uav: int) -> PeerRecord:
        """Return the record of another UAV. Raises MessageRefused for an unknown UAV."""
        peer = self._peers.get(uav)
        if peer is None:
            raise MessageRefused(RefusalReason.STRANGER, f"vehicle {uav} does not belong to this swarm")
        return peer

    def count_refusal(self, why: RefusalReason, sender: int | None) -> None:
        self._counters.refused[why] += 1
        if sender in self._peers:
            self._counters.refused_from[sender] += 1

    def _admit(
        self, peer: PeerRecord, sender: int, act: str, decoded: DecodedFrame, now_s: float, unix_s: float
    ) -> None:
        """Admit a message, or raise MessageRefused; after a silence of the peer, schedule a request."""
        frame = decoded.frame
        check_source(decoded, sender, act)
        check_time(frame, unix_s, self._options)
        check_age(frame, unix_s, self._options)
        if peer.admit(frame, now_s):
            self._schedule_request(sender, now_s)

    def _handle(
        self, output: NodeOutput, peer: PeerRecord, decoded: DecodedFrame, now_s: float, unix_s: float
    ) -> None:
        sender = decoded.frame.sender
        match decoded.frame.content:
            case Observation() as seen:
                record = peer.attach(self._replica.of(decoded.source))
                if self._store(output, record, seen, decoded):
                    self._relay(output, [decoded.data], sender, now_s, unix_s)
                if record.upto < seen.seq:
                    self._request_missing(sender, now_s)
            case StateShared() as state:
                self._handle_state(peer, decoded, state, now_s)
            case IntentShared() as intent:
                peer.update_intent(decoded.frame, intent, decoded.data)
            case SnapshotAsked() as asked:
                self._answer(output, sender, asked, now_s, unix_s)
            case Snapshot(frames=frames, last=last):
                self._handle_all_relayed(output, frames, sender, now_s, unix_s)
                if output.news:
                    peer.request_pause_s = MIN_REQUEST_PAUSE_S
                if last:
                    self._requests.record_answer(sender)
            case Relayed(frames=frames):
                fresh = self._handle_all_relayed(output, frames, sender, now_s, unix_s)
                self._relay(output, fresh, sender, now_s, unix_s)
            case _:
                raise MessageRefused(
                    RefusalReason.MALFORMED, f"{decoded.act} is valid only inside another message"
                )

    def _handle_state(
        self, peer: PeerRecord, decoded: DecodedFrame, state: StateShared, now_s: float
    ) -> None:
        peer.update_state(decoded, now_s)
        if peer.record is None:
            peer.attach(self._replica.of(decoded.source))
        if peer.update_knowledge(state, now_s):
            self._schedule_request(decoded.frame.sender, now_s)

    def _store(
        self, output: NodeOutput, record: SourceRecord, item: BeliefItem, decoded: DecodedFrame
    ) -> bool:
        """Store an observation or checkpoint; return whether it is new. Raises MessageRefused."""
        if decoded.source == self._own_source:
            if isinstance(item, Observation) and item.seq > record.latest:
                raise MessageRefused(
                    RefusalReason.TWO_CONTENTS,
                    f"another process flies vehicle {self.uav}: {item.two_contents}",
                )
            return False
        was_upto = record.upto
        try:
            if not self._replica.add(record, item, decoded):
                return False
        except MessageRefused:
            self._counters.flagged[item.observer] = max(self._counters.flagged[item.observer], 1)
            raise
        if isinstance(item, Checkpoint) and item.upto <= was_upto and self._requests.is_enabled:
            self._deferred[item.source] = item
            return True
        output.notices += self._contradictions.find(decoded)
        output.news.append(item)
        return True

    def _handle_all_relayed(
        self, output: NodeOutput, frames: Iterable[bytes], sender: int, now_s: float, unix_s: float
    ) -> list[bytes]:
        """Handle relayed frames, and return the new frames; skip the rest after too many refused frames."""
        fresh, n_refused, peer = [], 0, self._peers[sender]
        for data in frames:
            try:
                decoded = self._decode(data)
                peer.add_work(WORK_PER_OBSERVATION if decoded.seq else WORK_PER_OTHER_FRAME, now_s)
                if self._handle_relayed(output, decoded, now_s, unix_s):
                    fresh.append(data)
            except MessageRefused as refused:
                n_refused += 1
                self.count_refusal(refused.why, sender)
                text = f"a message relayed by vehicle {sender} was refused: {refused}"
                output.notices.append((refused.why, text))
                if n_refused == MAX_REFUSED_FRAMES or refused.why is RefusalReason.TOO_FAST:
                    break
        return fresh

    def _handle_relayed(self, output: NodeOutput, decoded: DecodedFrame, now_s: float, unix_s: float) -> bool:
        """Handle a relayed frame; return whether it is a new observation or checkpoint."""
        frame = decoded.frame
        check_time(frame, unix_s, self._options)
        peer = None if frame.sender == self.uav else self._peer(frame.sender)
        seen = frame.content
        agrees = self._contradictions.agrees_with_own
        if isinstance(seen, Observation) and peer is not None and agrees(decoded):
            record = self._replica.of(decoded.source)
            if record.is_next(decoded):  # nearly always
                self._replica.append(record, decoded)
                output.news.append(seen)
                return True
        match seen:
            case StateShared():
                if peer is not None and not is_stale(frame, unix_s, self._options):
                    peer.update_state(decoded, now_s)
                return False
            case IntentShared() as intent:
                if peer is not None and not is_stale(frame, unix_s, self._options):
                    peer.update_intent(frame, intent, decoded.data)
                return False
            case Observation() | Checkpoint() as item:
                return self._store(output, self._replica.of(decoded.source), item, decoded)
        raise MessageRefused(RefusalReason.MALFORMED, f"{decoded.act} is not valid inside another message")

    def _relay(
        self, output: NodeOutput, frames: list[bytes], received_from: int, now_s: float, unix_s: float
    ) -> None:
        if not self._options.relay or not frames:
            return
        observers = {self._decode(data).frame.sender for data in frames}
        to = tuple(u for u in self._receivers(now_s) if u != received_from and observers != {u})
        if to:
            self._counters.relayed += len(frames)
            for part in split_frames(frames):
                self._send(output, Relayed(part), to, unix_s)

    # --- requests for missed observations

    def _schedule_request(self, peer: int, now_s: float) -> None:
        self._requests.schedule(peer, now_s, self._peers[peer].ask_after_s)

    def _request_missing(self, peer: int, now_s: float) -> None:
        """Schedule a request for observations that the peer holds and this UAV lacks."""
        self._peers[peer].record_missing()
        self._schedule_request(peer, now_s)

    def tick(self, now_s: float, unix_s: float) -> NodeOutput:
        output = NodeOutput()
        if self._requests.tick(now_s):
            for source in [*self._deferred][:MAX_DEFERRED_PER_TICK]:
                output.news.append(self._deferred.pop(source))
            receivers = self._receivers(now_s)
            known = [u for u in receivers if self._peers[u].state is not None]
            neighbours = [u for u in known if not self._agrees(u, now_s)] if known else list(receivers)
            if neighbours:
                self._schedule_request(neighbours[int(self._rng.integers(len(neighbours)))], now_s)
        self._send_requests(output, now_s, unix_s)
        return output

    @property
    def next_deadline_s(self) -> float:
        """Time at which the node must tick again [s]."""
        return self._requests.next_deadline_s

    def _agrees(self, peer: int, now_s: float) -> bool:
        return self._peers[peer].agrees(now_s)

    def _send_requests(self, output: NodeOutput, now_s: float, unix_s: float) -> None:
        for peer in self._requests.due(now_s):
            if not self._agrees(peer, now_s):
                frames = ((u, p.state_frame) for u, p in self._peers.items())
                states = tuple((u, decoded.frame.unix_s) for u, decoded in frames if decoded is not None)
                self._send(output, SnapshotAsked(self._replica.digest(), states), (peer,), unix_s)
                self._counters.snapshots_asked += 1
                self._requests.record_request(peer, now_s)
                self._peers[peer].record_request(now_s)

    def _answer(
        self, output: NodeOutput, asker: int, asked: SnapshotAsked, now_s: float, unix_s: float
    ) -> None:
        if not self._peers[asker].may_ask(now_s):
            raise MessageRefused(
                RefusalReason.TOO_FAST,
                f"vehicle {asker} sends more than {REQUESTS_PER_S:g} requests a second",
            )
        frames = list(self._replica.missing(asked.have))
        frames += states_since(
            (p for uav, p in self._peers.items() if uav != asker), dict(asked.states), unix_s
        )
        parts = list(split_frames(frames))
        for i, part in enumerate(parts):
            self._send(output, Snapshot(part, i == len(parts) - 1), (asker,), unix_s)
        self._counters.snapshots_served += 1
        if self._replica.lacks(asked.have):
            self._request_missing(asker, now_s)

    # --- output

    def _receivers(self, now_s: float) -> tuple[int, ...]:
        """Return the UAVs in communication range."""
        return self._column.nearest(self._sender.position, self._options.k, now_s)

    def _send(self, output: NodeOutput, content: Content, to: tuple[int, ...], unix_s: float) -> bytes:
        out = self._sender.message(content, to, unix_s)
        output.messages.append(out)
        return out.data
