"""What a UAV knows of another, and what of it it takes. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec

from swarmctl.bus.node.decoding import Reading
from swarmctl.bus.node.ledger import A_MESSAGE, MAX_WORK, SILENT_AFTER_S, STALE_S, WITHIN_S, Column
from swarmctl.bus.node.replica import Apart, Kept
from swarmctl.bus.rate import Pace
from swarmctl.core.frames import Frame, IntentShared, Refused, StateShared, Why

MAX_BYTES = 8_000_000
"""of it in `WITHIN_S`"""
A_FRAME, A_CHECKPOINT = 1, 20
"""the work of each, frames inside of messages counted apart"""
ASK_AGAIN_S = 1.0
MAX_ASK_AGAIN_S = 8.0
"""after answers that brought nothing"""
QUESTIONS_PER_S, QUESTIONS_BURST = 4.0, 16
WINDOW = 1024
"""a message that comes later than so many of its sender's is taken for a replay"""
IN_WINDOW = (1 << WINDOW) - 1
MAX_CLOCK_S = 1.0
"""newer by less, a state is not passed on"""


class Peer(msgspec.Struct, gc=False):
    """What is known of another UAV. Of what holds no cycles the garbage collector need not know."""

    column: Column
    row: int
    """where in `column`"""
    intent: IntentShared | None = None
    intent_unix_s: float = -math.inf
    intent_frame: bytes = b""
    missing: int = 0
    """bit i: message `missing_at` - i has not come. A hundred times a hundred sets took a gigabyte."""
    missing_at: int = 0
    weighed: int = 0
    """bytes"""
    weighed_until_s: float = -math.inf
    ask_after_s: float = -math.inf
    """when it may be asked again"""
    ask_again_s: float = ASK_AGAIN_S
    questions: Pace | None = None
    kept: Kept | None = None
    """what is held of what it observes, as it was started last; None until it is first needed"""

    def admit(self, frame: Frame, now_s: float) -> bool:
        """Whether it is heard for the first time, or again after long.

        Raises Refused for a message that has come before, or that comes faster than any UAV speaks.
        """
        n, column, row = frame.n, self.column, self.row
        if frame.incarnation != column.incarnation[row]:
            if frame.incarnation < column.incarnation[row]:
                raise Refused(Why.REPLAY, f"of before vehicle {frame.sender} was started again")
            self._begin(frame.incarnation)
        ahead = n - column.newest[row]
        if ahead <= 0 and (ahead <= -WINDOW or not self._missing() >> -ahead & 1):
            raise Refused(Why.REPLAY, f"message {n} of vehicle {frame.sender} has come before")
        # After all else: what somebody repeats must not use up what its sender may say.
        self.work(A_MESSAGE, now_s)
        if ahead > 1:
            # Those between are missing, and of far beyond all of before.
            between = (1 << min(ahead, WINDOW)) - 2
            self.missing = (self._missing() << min(ahead, WINDOW) | between) & IN_WINDOW
            self.missing_at = n
        elif ahead <= 0:
            self.missing = self._missing() ^ 1 << -ahead
        column.newest[row] += max(ahead, 0)
        was_silent = now_s - column.heard_s[row] > SILENT_AFTER_S
        column.heard_s[row] = now_s
        return was_silent

    def _begin(self, incarnation: int) -> None:
        """It was started, or started again."""
        column, row = self.column, self.row
        column.incarnation[row], column.newest[row], column.heard_s[row] = incarnation, 0, -math.inf
        self.missing = self.missing_at = 0
        if self.kept is not None:
            self.kept.stand_at(Apart())
            self.kept = None

    def _missing(self) -> int:
        """Brought up to the newest message: nothing is missing between."""
        ahead = self.column.newest[self.row] - self.missing_at
        self.missing_at += ahead
        self.missing = self.missing << min(ahead, WINDOW) & IN_WINDOW if self.missing else 0
        return self.missing

    def keeps(self, kept: Kept) -> Kept:
        """What is held of what it observes, as it was started last."""
        if self.kept is not kept:
            kept.stand_at(self.column, self.row)
            self.kept = kept
        return kept

    def work(self, units: int, now_s: float) -> None:
        """Raises Refused where it makes more than any UAV should."""
        column, row = self.column, self.row
        if now_s >= column.worked_until_s[row]:
            column.worked_until_s[row], column.worked[row] = now_s + WITHIN_S, 0
        column.worked[row] += units
        if column.worked[row] > MAX_WORK:
            raise Refused(Why.TOO_FAST, f"more than {MAX_WORK} steps of work in {WITHIN_S:g} s")

    def weigh(self, n_bytes: int, now_s: float) -> None:
        """Before anything is read. Raises Refused where it is more than any UAV says."""
        if now_s >= self.weighed_until_s:
            self.weighed_until_s, self.weighed = now_s + WITHIN_S, 0
        self.weighed += n_bytes
        if self.weighed > MAX_BYTES:
            raise Refused(Why.TOO_FAST, f"more than {MAX_BYTES} bytes in {WITHIN_S:g} s")

    def asked(self, now_s: float) -> None:
        """It is not asked again at once, and the later the less its answers bring."""
        self.ask_after_s = now_s + self.ask_again_s
        self.ask_again_s = min(2.0 * self.ask_again_s, MAX_ASK_AGAIN_S)

    def may_ask(self, now_s: float) -> bool:
        """Whether one more question of its is answered."""
        if self.questions is None:
            self.questions = Pace(QUESTIONS_PER_S, QUESTIONS_BURST)
        return self.questions.takes(now_s)

    def told(self, reading: Reading, now_s: float) -> None:
        """Its state, by itself or by others; an older one than is known is passed over."""
        frame, column, row = reading.frame, self.column, self.row
        known = column.state[row]
        is_newer = frame.incarnation >= column.incarnation[row] and (
            known is None or frame.unix_s > known.frame.unix_s
        )
        if is_newer and isinstance(frame.content, StateShared):
            column.told(reading, frame.content, row, now_s)

    def said(self, state: StateShared, now_s: float) -> bool:
        """The same by itself, with how much it knows; whether it has seen more than is held here."""
        column, row = self.column, self.row
        column.said_s[row] = now_s
        if column.has_held(state.knows):
            column.agreed_s[row] = now_s
        has_more = column.upto[row] < state.last_seq
        if has_more:
            column.agreed_s[row] = -math.inf
        return has_more

    def has_more(self) -> None:
        """Than is known here, whatever it said last."""
        self.column.said_s[self.row] = self.column.agreed_s[self.row] = -math.inf

    @property
    def told_state(self) -> Reading | None:
        """How it told the newest state that is known, itself or by others."""
        return self.column.state[self.row]

    @property
    def state(self) -> StateShared | None:
        """The newest that is known."""
        told = self.told_state
        return None if told is None else told.frame.content  # type: ignore[return-value]

    def intends(self, frame: Frame, intent: IntentShared, data: bytes) -> None:
        """The same of where it will be."""
        if frame.incarnation >= self.column.incarnation[self.row] and frame.unix_s > self.intent_unix_s:
            self.intent, self.intent_unix_s, self.intent_frame = intent, frame.unix_s, data

    def agrees(self, now_s: float) -> bool:
        """Whether it knows nothing that is not known here, by what it said itself of late.

        Who is spoken to need not speak to who does: what it said long ago tells nothing.
        """
        column, row, state = self.column, self.row, self.state
        if now_s - column.agreed_s[row] <= SILENT_AFTER_S:
            return True
        if state is None or now_s - column.said_s[row] > SILENT_AFTER_S:
            return False
        return column.has_held(state.knows)


def told_since(peers: Iterable[Peer], known: Mapping[int, float], unix_s: float) -> list[bytes]:
    """The frames of the states that are newer than those `known`, told at those times (unix) [s], and of the
    intents that their senders have told of late."""
    newer = [
        (peer, told)
        for peer in peers
        if (told := peer.told_state) is not None
        and told.frame.unix_s > known.get(told.frame.sender, -math.inf) + MAX_CLOCK_S
    ]
    frames = [told.data for _, told in newer]
    return frames + [p.intent_frame for p, _ in newer if unix_s - p.intent_unix_s <= STALE_S]
