"""What a UAV knows of another, and what of it it takes. Pure."""

from __future__ import annotations

import math

import msgspec

from swarmctl.bus.pace import Pace
from swarmctl.bus.replica import Kept, Replica
from swarmctl.core.frames import Frame, IntentShared, Refused, StateShared, Why
from swarmctl.core.geo import LatLon

SILENT_AFTER_S = 5.0
"""who is heard again after so long is asked what was missed"""
ALIVE_S = 20.0
"""of whom nothing was heard for longer, directly or by others, is spoken to last"""
MAX_WORK, WITHIN_S = 10_000, 10.0
"""what is done for one UAV in so long; faster ones are refused"""
MAX_BYTES = 8_000_000
"""of it in so long"""
A_MESSAGE, A_FRAME, A_CHECKPOINT = 5, 1, 20
"""the work of each, frames inside of messages counted apart"""
ASK_AGAIN_S = 1.0
MAX_ASK_AGAIN_S = 8.0
"""after answers that brought nothing"""
QUESTIONS_PER_S, QUESTIONS_BURST = 4.0, 16
WINDOW = 1024
"""a message that comes later than so many of its sender's is taken for a replay"""
IN_WINDOW = (1 << WINDOW) - 1


class Peer(msgspec.Struct, gc=False):
    """What is known of another UAV. Of what holds no cycles the garbage collector need not know."""

    state: StateShared | None = None
    state_unix_s: float = -math.inf
    state_frame: bytes = b""
    intent: IntentShared | None = None
    intent_unix_s: float = -math.inf
    intent_frame: bytes = b""
    incarnation: int = -1
    heard_s: float = -math.inf
    """directly"""
    told_s: float = -math.inf
    """when its state was last told, by itself or by others"""
    newest: int = 0
    """message number"""
    missing: int = 0
    """bit i: message `newest` - i has not come; of a hundred peers a hundred times, sets took a gigabyte"""
    worked: int = 0
    """for its messages"""
    worked_until_s: float = -math.inf
    """when that is counted anew"""
    weighed: int = 0
    """bytes"""
    weighed_until_s: float = -math.inf
    ask_after_s: float = -math.inf
    """when it may be asked again"""
    ask_again_s: float = ASK_AGAIN_S
    said_s: float = -math.inf
    """when it last told its state itself, unless it has more since then"""
    agreed_s: float = -math.inf
    """when it last told that it knew nothing that was not known here"""
    questions: Pace | None = None
    kept: Kept | None = None
    """what is held of what it observes, as it was started last; None until it is first needed"""

    def admit(self, frame: Frame, now_s: float) -> bool:
        """Whether it is heard for the first time, or again after long.

        Raises Refused for a message that has come before, or that comes faster than any UAV speaks.
        """
        n, incarnation = frame.n, frame.incarnation
        if incarnation != self.incarnation:
            if incarnation < self.incarnation:
                raise Refused(Why.REPLAY, f"of before vehicle {frame.sender} was started again")
            self.incarnation, self.newest, self.missing, self.heard_s = incarnation, 0, 0, -math.inf
            self.kept = None
        ahead = n - self.newest
        if ahead <= 0 and (ahead <= -WINDOW or not self.missing >> -ahead & 1):
            raise Refused(Why.REPLAY, f"message {n} of vehicle {frame.sender} has come before")
        # After all else: what somebody repeats must not use up what its sender may say.
        self.work(A_MESSAGE, now_s)
        if ahead > 0:
            self.newest = n
            # Those between are missing, and of far beyond all of before.
            between = (1 << min(ahead, WINDOW)) - 2
            self.missing = (self.missing << min(ahead, WINDOW) | between) & IN_WINDOW
        else:
            self.missing ^= 1 << -ahead
        was_silent = now_s - self.heard_s > SILENT_AFTER_S
        self.heard_s = now_s
        return was_silent

    def admits_next(self, frame: Frame, now_s: float) -> bool:
        """The same for the message after the last, in few steps; False, and nothing done, for all others."""
        if (
            frame.n != self.newest + 1
            or frame.incarnation != self.incarnation
            or now_s - self.heard_s > SILENT_AFTER_S
            or now_s >= self.worked_until_s
            or self.worked + A_MESSAGE > MAX_WORK
        ):
            return False
        self.worked += A_MESSAGE
        self.newest += 1
        if self.missing:
            self.missing = self.missing << 1 & IN_WINDOW
        self.heard_s = now_s
        return True

    def work(self, units: int, now_s: float) -> None:
        """Raises Refused where it makes more than any UAV should."""
        if now_s >= self.worked_until_s:
            self.worked_until_s, self.worked = now_s + WITHIN_S, 0
        self.worked += units
        if self.worked > MAX_WORK:
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

    def told(self, frame: Frame, state: StateShared, data: bytes, now_s: float) -> None:
        """Its state, by itself or by others; an older one than is known is passed over."""
        if frame.incarnation >= self.incarnation and frame.unix_s > self.state_unix_s:
            self.state, self.state_unix_s, self.state_frame, self.told_s = state, frame.unix_s, data, now_s

    def intends(self, frame: Frame, intent: IntentShared, data: bytes) -> None:
        """The same of where it will be."""
        if frame.incarnation >= self.incarnation and frame.unix_s > self.intent_unix_s:
            self.intent, self.intent_unix_s, self.intent_frame = intent, frame.unix_s, data

    @property
    def at(self) -> LatLon | None:
        return None if self.state is None else (self.state.lat_deg, self.state.lon_deg)

    def agrees(self, replica: Replica, now_s: float) -> bool:
        """Whether it knows nothing that is not known here, by what it said itself of late.

        Who is spoken to need not speak to who does: what it said long ago tells nothing.
        """
        if now_s - self.agreed_s <= SILENT_AFTER_S:
            return True
        if self.state is None or now_s - self.said_s > SILENT_AFTER_S:
            return False
        return replica.has_held(self.state.knows)

    def is_silent(self, now_s: float) -> bool:
        return self.state is not None and now_s - max(self.heard_s, self.told_s) > ALIVE_S
