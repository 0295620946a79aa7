"""MAVLink 2 signing of one front end: https://mavlink.io/en/guide/message_signing.html

What goes out is stamped with times that never repeat, also not after a restart; what comes in unsigned,
wrongly signed or with an old time is refused and counted.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from swarmctl.mavlink.protocol.codec import Signature
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID

KEY_BYTES = 32
"""https://mavlink.io/en/guide/message_signing.html#secret_key"""

TICKS_PER_S = 100_000
"""a time stamp counts 10 µs"""
EPOCH_UNIX_S = 1_420_070_400
"""from 2015-01-01 00:00 UTC on"""
LAST_TIMESTAMP = 2**48 - 1
NEW_STREAM_AGE = 60 * TICKS_PER_S
"""how far behind our time a stream may be that was not heard before"""
RESERVED = 60 * TICKS_PER_S
"""how far ahead of what was used the store is when it is written"""
RENEWED = 30 * TICKS_PER_S
"""how much of that is left when it is written anew: so long may a disk take, and nobody waits for it"""
DISK_WAIT_S = 1.0
"""for a disk, once, where nothing is left: at the start, and after a stamp from a clock that is ahead"""
MAX_AHEAD = 24 * 3600 * TICKS_PER_S
"""how far ahead of our time a stamp may be. MAVLink sets no limit, so one frame that is stamped with the end
of time would leave everybody who follows it nothing to sign with."""
UNSIGNED = "unsigned"
OTHER_KEY = "signed with another key"
REPEATED = "repeated or out of order"
LATE = "older than a minute"
AHEAD = "more than a day ahead of this machine's clock"
UNSIGNED_ALLOWED = frozenset({109, 166})
"""RADIO_STATUS and RADIO: a telemetry radio makes them itself, and has no key"""

_MAVLINK_2 = 0xFD
_SIGNED = 0x01
_SIGNATURE_BYTES = 13


class TimestampStore(Protocol):
    """What outlives the process."""

    def load(self) -> int:
        """A time stamp above all that were used; 0 where there is none. Raises OSError, ValueError."""

    def keep(self, timestamp: int) -> None:
        """Never lower than what is there. Raises OSError."""


class Pool(Protocol):
    """Where the store is waited for; a `concurrent.futures.Executor` is one."""

    def submit(self, keep: Callable[[int], None], timestamp: int, /) -> Future[None]: ...


class SameThreadPool:
    """No thread: done, or failed, at once."""

    def submit(self, keep: Callable[[int], None], timestamp: int, /) -> Future[None]:
        done: Future[None] = Future()
        try:
            keep(timestamp)
            done.set_result(None)
        except (OSError, ValueError) as error:
            done.set_exception(error)
        return done


def ticks(unix_us: int) -> int:
    """A wall time [µs since 1970] as a time stamp."""
    return max(unix_us - EPOCH_UNIX_S * 1_000_000, 0) // 10


class Signing:
    """One key, the time stamps under it, and what it refused.

    No stamp is used before the store has one above it, so that none is used again after a restart; where that
    cannot be, `trouble` says why.
    """

    def __init__(
        self, key: bytes, store: TimestampStore, first_link_id: int = 0, pool: Pool | None = None
    ) -> None:
        """Raises OSError and ValueError where the store cannot be used.

        `pool` writes the store while nobody waits; without one it is written at once.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, found {len(key)}")
        self.refused: Counter[str] = Counter()
        """incoming frames, by reason"""
        self.trouble = ""
        """why the time stamps are not kept any more"""
        self._key = key
        self._store = store
        self._pool: Pool = pool or SameThreadPool()
        self._writing: tuple[Future[None], int] | None = None
        """the store's next stamp, under way"""
        self._is_late = False
        """it was waited for in vain"""
        self._first_link_id = first_link_id
        self._last = self._began = store.load()
        if self._last > LAST_TIMESTAMP - MAX_AHEAD:
            raise ValueError(
                "the time stamps under this key are used up: make a new one, for the vehicles too"
            )
        self._reserved = self._last
        store.keep(self._last)
        self._streams: dict[tuple[int, int, int], int] = {}

    def sign(self, line: int, clock: int) -> Signature:
        """For the next frame on the line of this number; `clock` is the wall time as a time stamp."""
        self._last = min(max(self._last + 1, clock), LAST_TIMESTAMP)
        if self._last >= self._reserved - RENEWED:
            self._reserve()
        return Signature(self._key, (self._first_link_id + line) % 256, self._last)

    def accepts(self, frame: bytes, clock: int) -> bool:
        """Whether a whole frame, its checksum right, is from who has the key, and new."""
        return not self.why_not(frame, clock)

    def why_not(self, frame: bytes, clock: int) -> str:
        """Why a frame is refused; empty where it is accepted."""
        why = self._fault(frame, clock)
        if why:
            self.refused[why] += 1
        return why

    def _fault(self, frame: bytes, clock: int) -> str:
        if frame[0] != _MAVLINK_2 or not frame[2] & _SIGNED:
            return "" if _message_id(frame) in UNSIGNED_ALLOWED else UNSIGNED
        if not hmac.compare_digest(hashlib.sha256(self._key + frame[:-6]).digest()[:6], frame[-6:]):
            return OTHER_KEY
        stream = (frame[-_SIGNATURE_BYTES], frame[5], frame[6])
        timestamp = int.from_bytes(frame[-12:-6], "little")
        last = self._streams.get(stream)
        # What was used before this run counts as our time: a clock may have been ahead, and gone back.
        if timestamp > max(clock, self._began) + MAX_AHEAD:
            return AHEAD
        if last is None and timestamp + NEW_STREAM_AGE < max(self._last, clock):
            return LATE
        if last is not None and timestamp <= last:
            return REPEATED
        self._streams[stream] = timestamp
        self._last = max(self._last, timestamp)
        return ""

    def _reserve(self) -> None:
        self._write(0.0)
        # What is under way may be of before the clock jumped: then it is not enough.
        for _ in range(2):
            if self._last >= self._reserved and not self._is_late:
                self._write(DISK_WAIT_S)

    def _write(self, wait_s: float) -> None:
        """Begin to, if nothing is under way, and see for so long [s] what became of it."""
        if self._writing is None:
            until = self._last + RESERVED
            self._writing = (self._pool.submit(self._store.keep, until), until)
        written, until = self._writing
        try:
            error = written.exception(wait_s)
        except TimeoutError:
            if wait_s > 0.0:
                self._is_late = True
                self.trouble = "the time stamps of signing are not kept: the disk does not answer"
            return
        self._writing, self._is_late, self._reserved = None, False, until
        if isinstance(error, OSError | ValueError):
            # A vehicle that is not commanded any more is worse than a time stamp that may repeat one day.
            reason = getattr(error, "strerror", None) or error
            self.trouble = f"the time stamps of signing are not kept: {reason}"
        elif error is not None:
            raise error


class SigningGuard:
    """The signing of one front end, at the time of its clock; without any all passes as it is."""

    def __init__(self, signing: Signing | None, wall_time_us: Callable[[], int]) -> None:
        self.signing = signing
        self._wall_time_us = wall_time_us

    def sign(self, line: int) -> Signature | None:
        return None if self.signing is None else self.signing.sign(line, ticks(self._wall_time_us()))

    def why_not(self, frame: bytes) -> str:
        """Why a frame is refused; empty where it is accepted."""
        return "" if self.signing is None else self.signing.why_not(frame, ticks(self._wall_time_us()))

    @property
    def trouble(self) -> str:
        """What was refused, for people; empty where nothing was."""
        if self.signing is None:
            return ""
        refused = ", ".join(f"{n} {why}" for why, n in sorted(self.signing.refused.items()))
        told = f"frames refused by links.signing_key: {refused}" if refused else ""
        return "; ".join(text for text in (told, self.signing.trouble) if text)


def _message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little") if frame[0] == _MAVLINK_2 else frame[5]


REPEAT_S = 60.0
MEANS = {
    UNSIGNED: "somebody without the key speaks in its name, or it has lost its key",
    OTHER_KEY: "somebody with another key speaks in its name, or it was given another",
    LATE: "its clock is behind; it learns the time from what it is sent",
    AHEAD: "its clock is wrong, or this machine's",
    REPEATED: "something on the way repeats frames, or somebody who has recorded them",
}
"""what it means that frames in a vehicle's name are refused for this"""


@dataclass(slots=True)
class _Kind:
    n: int
    said_s: float


class Refusals:
    """Of one place where frames come in. Each returns what is to be said now; empty where nothing is."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[int, str], _Kind] = {}
        """by a vehicle of ours and the reason. Of strangers, 0, all together: a name is easily claimed, and
        many would fill the memory"""

    def of_vehicle(self, sysid: int, component: int, why: str, address: str, now_s: float) -> str:
        """Of a frame in the name of one that is flown here."""
        n = self._note(sysid, why, now_s)
        of = "" if component == AUTOPILOT_COMPID else f" of component {component}"
        so_far = f"{n} so far, the last{of} from {address}"
        return f"frames in its name are refused, {why} ({so_far}): {MEANS[why]}" if n else ""

    def of_stranger(self, sysid: int, why: str, address: str, now_s: float) -> str:
        n = self._note(0, why, now_s)
        return f"frames are refused, {why} ({n} so far, the last of system {sysid} at {address})" if n else ""

    def _note(self, whose: int, why: str, now_s: float) -> int:
        """One more; how many there have been of its kind, where that is to be said now, else 0."""
        kind = self._kinds.get((whose, why))
        if kind is None:
            self._kinds[whose, why] = _Kind(1, now_s)
            return 1
        kind.n += 1
        if now_s - kind.said_s < REPEAT_S:
            return 0
        kind.said_s = now_s
        return kind.n
