"""State that a UAV keeps about another UAV, and checks of that UAV's messages. No I/O."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.reception import (
    MAX_WORK_PER_PERIOD,
    RATE_PERIOD_S,
    SILENT_AFTER_S,
    STALE_S,
    WORK_PER_MESSAGE,
    ReceptionColumn,
)
from swarmctl.bus.node.replica import DetachedColumn, SourceRecord
from swarmctl.bus.rate import TokenBucket
from swarmctl.core.frames import Frame, IntentShared, MessageRefused, RefusalReason, StateShared

MAX_BYTES = 8_000_000
"""greatest number of bytes from one sender in `RATE_PERIOD_S`"""
WORK_PER_OBSERVATION, WORK_PER_OTHER_FRAME = 1, 20
"""steps of work for a frame inside a message, in addition to the steps for the message"""
MIN_REQUEST_PAUSE_S = 1.0
MAX_REQUEST_PAUSE_S = 8.0
"""first and longest pause between requests to a peer; each request doubles the pause, news resets it"""
REQUESTS_PER_S, REQUESTS_BURST = 4.0, 16
"""limit on the requests of one peer: in the long run [1/s], and at once"""
REPLAY_WINDOW = 1024
"""number of later messages of the same sender after which a late message counts as a replay"""
REPLAY_WINDOW_MASK = (1 << REPLAY_WINDOW) - 1
MIN_STATE_LEAD_S = 1.0
"""smallest lead of a state over the requester's state for which the state is sent"""


def check_source(decoded: DecodedFrame, sender: int, act: str) -> None:
    """Raise MessageRefused if the frame's sender or act differs from its key."""
    frame = decoded.frame
    if frame.sender != sender or decoded.act != act:
        raise MessageRefused(
            RefusalReason.SOURCE,
            f"the frame is {decoded.act} of vehicle {frame.sender}, but the key is {act} of vehicle {sender}",
        )


def check_time(frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raise MessageRefused if the frame's time is in the future by more than the clocks' tolerance."""
    ahead_s = frame.unix_s - unix_s
    if ahead_s > options.clock_tolerance_s:
        raise MessageRefused(
            RefusalReason.FUTURE,
            f"the clock of vehicle {frame.sender} is {ahead_s:.1f} s ahead of this machine's "
            f"(limit {options.clock_tolerance_s:g} s)",
        )


def check_age(frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raise MessageRefused if the frame is stale."""
    if is_stale(frame, unix_s, options):
        age_s = unix_s - frame.unix_s
        raise MessageRefused(
            RefusalReason.REPLAY, f"the message is {age_s:.0f} s old by the clock of vehicle {frame.sender}"
        )


def is_stale(frame: Frame, unix_s: float, options: NodeOptions) -> bool:
    return unix_s - frame.unix_s > STALE_S + options.round_trip_s


class PeerRecord(msgspec.Struct, gc=False):
    """The known state of another UAV, without reference cycles, so the garbage collector can skip it."""

    column: ReceptionColumn
    row: int
    """index in `column`"""
    intent: IntentShared | None = None
    intent_unix_s: float = -math.inf
    intent_frame: bytes = b""
    missing: int = 0
    """bit i: message `missing_at` - i has not arrived; sets instead of bits took 1 GB for a hundred UAVs"""
    missing_at: int = 0
    n_bytes: int = 0
    """bytes received in the current period"""
    bytes_period_end_s: float = -math.inf
    ask_after_s: float = -math.inf
    """earliest time of the next request to the peer"""
    request_pause_s: float = MIN_REQUEST_PAUSE_S
    request_bucket: TokenBucket | None = None
    """limit on the peer's requests; None before the first request"""
    record: SourceRecord | None = None
    """observations of the peer's current incarnation; None until first needed"""

    def admit(self, frame: Frame, now_s: float) -> bool:
        """Accept a message; return whether it is the first of its incarnation, or the first after a silence.

        Raises MessageRefused for a repeated message, for an earlier incarnation, and above the rate limit.
        """
        n, column, row = frame.n, self.column, self.row
        if frame.incarnation != column.incarnation[row]:
            if frame.incarnation < column.incarnation[row]:
                raise MessageRefused(
                    RefusalReason.REPLAY, f"message {n} is older than the restart of vehicle {frame.sender}"
                )
            self._begin(frame.incarnation)
        ahead = n - column.newest[row]
        if ahead <= 0 and (ahead <= -REPLAY_WINDOW or not self._missing() >> -ahead & 1):
            raise MessageRefused(
                RefusalReason.REPLAY, f"message {n} of vehicle {frame.sender} arrived before, or is too late"
            )
        # The rate limit comes last: replayed messages must not use up the sender's rate.
        self.add_work(WORK_PER_MESSAGE, now_s)
        if ahead > 1:
            # All messages of the gap are missing, up to the size of the window.
            gap = (1 << min(ahead, REPLAY_WINDOW)) - 2
            self.missing = (self._missing() << min(ahead, REPLAY_WINDOW) | gap) & REPLAY_WINDOW_MASK
            self.missing_at = n
        elif ahead <= 0:
            self.missing = self._missing() ^ 1 << -ahead
        column.newest[row] += max(ahead, 0)
        was_silent = now_s - column.received_s[row] > SILENT_AFTER_S
        column.received_s[row] = now_s
        return was_silent

    def _begin(self, incarnation: int) -> None:
        """Reset the record for a new incarnation."""
        column, row = self.column, self.row
        column.incarnation[row], column.newest[row], column.received_s[row] = incarnation, 0, -math.inf
        self.missing = self.missing_at = 0
        if self.record is not None:
            self.record.attach(DetachedColumn())
            self.record = None

    def _missing(self) -> int:
        """Shift `missing` to the newest message and return it; all messages since `missing_at` arrived."""
        ahead = self.column.newest[self.row] - self.missing_at
        self.missing_at += ahead
        self.missing = self.missing << min(ahead, REPLAY_WINDOW) & REPLAY_WINDOW_MASK if self.missing else 0
        return self.missing

    def attach(self, record: SourceRecord) -> SourceRecord:
        """Set and return the record of the peer's current incarnation."""
        if self.record is not record:
            record.attach(self.column, self.row)
            self.record = record
        return record

    def add_work(self, units: int, now_s: float) -> None:
        """Count work caused by the peer's messages. Raises MessageRefused above the limit."""
        column, row = self.column, self.row
        if now_s >= column.work_period_end_s[row]:
            column.work_period_end_s[row], column.work[row] = now_s + RATE_PERIOD_S, 0
        column.work[row] += units
        if column.work[row] > MAX_WORK_PER_PERIOD:
            raise MessageRefused(
                RefusalReason.TOO_FAST,
                f"the messages cause more than {MAX_WORK_PER_PERIOD} steps of work in {RATE_PERIOD_S:g} s",
            )

    def add_bytes(self, n_bytes: int, now_s: float) -> None:
        """Count received bytes before decoding. Raises MessageRefused above the limit."""
        if now_s >= self.bytes_period_end_s:
            self.bytes_period_end_s, self.n_bytes = now_s + RATE_PERIOD_S, 0
        self.n_bytes += n_bytes
        if self.n_bytes > MAX_BYTES:
            raise MessageRefused(
                RefusalReason.TOO_FAST, f"more than {MAX_BYTES} bytes in {RATE_PERIOD_S:g} s"
            )

    def record_request(self, now_s: float) -> None:
        """Record a request to the peer, and double the pause after the next request."""
        self.ask_after_s = now_s + self.request_pause_s
        self.request_pause_s = min(2.0 * self.request_pause_s, MAX_REQUEST_PAUSE_S)

    def may_ask(self, now_s: float) -> bool:
        """Count a request of the peer; return whether the request is within the rate limit."""
        if self.request_bucket is None:
            self.request_bucket = TokenBucket(REQUESTS_PER_S, REQUESTS_BURST)
        return self.request_bucket.try_take(now_s)

    def update_state(self, decoded: DecodedFrame, now_s: float) -> None:
        """Store the peer's state, received directly or relayed, unless a newer state is known."""
        frame, column, row = decoded.frame, self.column, self.row
        known = column.state[row]
        is_newer = frame.incarnation >= column.incarnation[row] and (
            known is None or frame.unix_s > known.frame.unix_s
        )
        if is_newer and isinstance(frame.content, StateShared):
            column.set_state(decoded, frame.content, row, now_s)

    def update_knowledge(self, state: StateShared, now_s: float) -> bool:
        """Compare a peer's state with the replica; return whether observations by the peer are missing."""
        column, row = self.column, self.row
        column.direct_state_s[row] = now_s
        if column.has_held(state.knows):
            column.agreed_s[row] = now_s
        has_more = column.upto[row] < state.last_seq
        if has_more:
            column.agreed_s[row] = -math.inf
        return has_more

    def record_missing(self) -> None:
        """Record that the peer has observations that are missing here, and ignore the peer's last state."""
        self.column.direct_state_s[self.row] = self.column.agreed_s[self.row] = -math.inf

    @property
    def state_frame(self) -> DecodedFrame | None:
        """Frame of the peer's newest known state, received directly or relayed."""
        return self.column.state[self.row]

    @property
    def state(self) -> StateShared | None:
        decoded = self.state_frame
        return None if decoded is None else decoded.frame.content  # type: ignore[return-value]

    def update_intent(self, frame: Frame, intent: IntentShared, data: bytes) -> None:
        """Store the peer's intended trajectory, unless a newer trajectory is known."""
        if frame.incarnation >= self.column.incarnation[self.row] and frame.unix_s > self.intent_unix_s:
            self.intent, self.intent_unix_s, self.intent_frame = intent, frame.unix_s, data

    def agrees(self, now_s: float) -> bool:
        """Return whether the peer's recent states show no observation that is missing here."""
        column, row, state = self.column, self.row, self.state
        if now_s - column.agreed_s[row] <= SILENT_AFTER_S:
            return True
        if state is None or now_s - column.direct_state_s[row] > SILENT_AFTER_S:
            return False
        return column.has_held(state.knows)


def states_since(peers: Iterable[PeerRecord], known: Mapping[int, float], unix_s: float) -> list[bytes]:
    """Return the frames of states newer than `known` (UAV -> unix [s]), and these UAVs' recent intents."""
    newer = [
        (peer, decoded)
        for peer in peers
        if (decoded := peer.state_frame) is not None
        and decoded.frame.unix_s > known.get(decoded.frame.sender, -math.inf) + MIN_STATE_LEAD_S
    ]
    frames = [decoded.data for _, decoded in newer]
    return frames + [p.intent_frame for p, _ in newer if unix_s - p.intent_unix_s <= STALE_S]
