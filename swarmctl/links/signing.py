"""MAVLink 2 signing of one front end: https://mavlink.io/en/guide/message_signing.html

Incoming frames without a signature, with another key or with an implausible timestamp are refused and
counted.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from swarmctl.mavlink.protocol.codec import SIGNATURE_BYTES, Frame, Signature
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID

KEY_BYTES = 32
"""https://mavlink.io/en/guide/message_signing.html#secret_key"""

TICKS_PER_S = 100_000
"""a timestamp counts units of 10 µs"""
EPOCH_UNIX_S = 1_420_070_400
"""2015-01-01 00:00 UTC, the zero of timestamps"""
LAST_TIMESTAMP = 2**48 - 1
MAX_NEW_STREAM_TICKS = 60 * TICKS_PER_S
"""largest age of a new stream's first timestamp"""
RESERVE_TICKS = 60 * TICKS_PER_S
"""lead of the stored timestamp over the last used timestamp after a write"""
RENEW_TICKS = 30 * TICKS_PER_S
"""lead below which a new timestamp is stored; a write may take this long without delaying a frame"""
DISK_WAIT_S = 1.0
"""longest wait for the disk when no lead is left, as at the start or after a received timestamp far ahead"""
MAX_AHEAD_TICKS = 24 * 3600 * TICKS_PER_S
"""Largest lead of a received timestamp. MAVLink sets no limit: one frame with the highest timestamp would use
up all timestamps of every station that accepts this frame."""
# Reasons for refusing a frame.
UNSIGNED = "unsigned"
OTHER_KEY = "signed with another key"
REPEATED = "repeated or out of order"
LATE = "older than a minute"
AHEAD = "more than a day ahead of this machine's clock"
UNSIGNED_ALLOWED = frozenset({109, 166})
"""RADIO_STATUS and RADIO: messages of a telemetry radio, which has no key"""


class TimestampStore(Protocol):
    """Store of a timestamp that outlives the process."""

    def load(self) -> int:
        """Return a timestamp above all used timestamps; 0 if none is stored. Raises OSError, ValueError."""

    def save(self, timestamp: int) -> None:
        """Store a timestamp, unless the stored timestamp is higher. Raises OSError."""


class Pool(Protocol):
    """Pool that writes the store, such as a `concurrent.futures.Executor`."""

    def submit(self, save: Callable[[int], None], timestamp: int, /) -> Future[None]: ...


class SameThreadPool:
    """Pool without a thread: it writes at once."""

    def submit(self, save: Callable[[int], None], timestamp: int, /) -> Future[None]:
        done: Future[None] = Future()
        try:
            save(timestamp)
            done.set_result(None)
        except (OSError, ValueError) as error:
            done.set_exception(error)
        return done


def ticks(unix_us: int) -> int:
    """Return a wall time [µs since 1970] as a timestamp."""
    return max(unix_us - EPOCH_UNIX_S * 1_000_000, 0) // 10


class Signing:
    """One key with its timestamps, and the numbers of refused frames.

    Before a timestamp is used, a higher timestamp is stored, so no timestamp repeats after a restart. If the
    store fails, signing continues, and `trouble` has the reason.
    """

    def __init__(
        self, key: bytes, store: TimestampStore, first_link_id: int = 0, pool: Pool | None = None
    ) -> None:
        """Load the store. Raises OSError, and ValueError for a bad key or store, or used-up timestamps.

        `pool` writes the store in the background; without a pool each write is immediate.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, found {len(key)}")
        self.refused: Counter[str] = Counter()
        """number of refused frames by reason"""
        self.trouble = ""
        """message about the last failure to store timestamps; empty if none has failed"""
        self._key = key
        self._store = store
        self._pool: Pool = pool or SameThreadPool()
        self._writing: tuple[Future[None], int] | None = None
        """pending write of the next timestamp"""
        self._disk_timed_out = False
        """True after a wait for the disk that timed out"""
        self._first_link_id = first_link_id
        # Highest timestamp used or accepted, and its value at the start.
        self._last = self._last_at_start = store.load()
        if self._last > LAST_TIMESTAMP - MAX_AHEAD_TICKS:
            raise ValueError(
                "the timestamps of this signing key are used up; make a new key, for the vehicles too "
                "[timestamps-used-up]"
            )
        self._reserved = self._last  # stored timestamp
        store.save(self._last)
        self._streams: dict[tuple[int, int, int], int] = {}
        """last accepted timestamp by link id, system id and component id"""

    def sign(self, line: int, clock: int) -> Signature:
        """Return the signature of the next frame on a line; `clock`: wall time as a timestamp."""
        self._last = min(max(self._last + 1, clock), LAST_TIMESTAMP)
        if self._last >= self._reserved - RENEW_TICKS:
            self._reserve()
        return Signature(self._key, (self._first_link_id + line) % 256, self._last)

    def why_not(self, frame: Frame, clock: int) -> str:
        """Return the reason for refusing a frame with a right checksum; empty if the frame is accepted."""
        why = self._fault(frame, clock)
        if why:
            self.refused[why] += 1
        return why

    def _fault(self, frame: Frame, clock: int) -> str:
        if not frame.signed:
            return "" if frame.msgid in UNSIGNED_ALLOWED else UNSIGNED
        data = frame.data
        if not hmac.compare_digest(hashlib.sha256(self._key + data[:-6]).digest()[:6], data[-6:]):
            return OTHER_KEY
        stream = (data[-SIGNATURE_BYTES], frame.sysid, frame.compid)
        timestamp = int.from_bytes(data[-12:-6], "little")
        last = self._streams.get(stream)
        # Timestamps of earlier runs raise the limit: the clock may have been ahead in those runs.
        if timestamp > max(clock, self._last_at_start) + MAX_AHEAD_TICKS:
            return AHEAD
        if last is None and timestamp + MAX_NEW_STREAM_TICKS < max(self._last, clock):
            return LATE
        if last is not None and timestamp <= last:
            return REPEATED
        self._streams[stream] = timestamp
        self._last = max(self._last, timestamp)
        return ""

    def _reserve(self) -> None:
        self._write(0.0)
        # After a jump of the clock the pending write may store too low a timestamp, so a second one follows.
        for _ in range(2):
            if self._last >= self._reserved and not self._disk_timed_out:
                self._write(DISK_WAIT_S)

    def _write(self, wait_s: float) -> None:
        """Begin a write unless a write is pending; wait up to `wait_s` for the end of the write."""
        if self._writing is None:
            until = self._last + RESERVE_TICKS
            self._writing = (self._pool.submit(self._store.save, until), until)
        written, until = self._writing
        try:
            error = written.exception(wait_s)
        except TimeoutError:
            if wait_s > 0.0:
                self._disk_timed_out = True
                self.trouble = self._not_stored("the disk does not answer")
            return
        self._writing, self._disk_timed_out, self._reserved = None, False, until
        if isinstance(error, OSError | ValueError):
            # Signing continues: a vehicle without commands is worse than a repeated timestamp.
            reason = getattr(error, "strerror", None) or error
            self.trouble = self._not_stored(reason)
        elif error is not None:
            raise error

    @staticmethod
    def _not_stored(reason: object) -> str:
        return f"the timestamps of signing are not stored: {reason} [timestamps-not-stored]"


class SigningGuard:
    """Signing of one front end by its clock; if `signing` is None, frames are neither signed nor checked."""

    def __init__(self, signing: Signing | None, wall_time_us: Callable[[], int]) -> None:
        self.signing = signing
        self._wall_time_us = wall_time_us

    def sign(self, line: int) -> Signature | None:
        return None if self.signing is None else self.signing.sign(line, ticks(self._wall_time_us()))

    def why_not(self, frame: Frame) -> str:
        """Return the reason for refusing a frame; empty if the frame is accepted."""
        return "" if self.signing is None else self.signing.why_not(frame, ticks(self._wall_time_us()))

    @property
    def trouble(self) -> str:
        """Return the numbers of refused frames, and a failure of the store; empty if there is neither."""
        if self.signing is None:
            return ""
        refused = ", ".join(f"{n} {why}" for why, n in sorted(self.signing.refused.items()))
        counts = f"frames refused by links.signing_key: {refused} [frames-refused]" if refused else ""
        return "; ".join(text for text in (counts, self.signing.trouble) if text)


REPORT_PERIOD_S = 60.0
MEANINGS = {
    UNSIGNED: "a sender without the key uses this system id, or the vehicle has lost its key",
    OTHER_KEY: "a sender with another key uses this system id, or the vehicle has a new key",
    LATE: "the vehicle's clock is late; signed frames will set it",
    AHEAD: "the clock of the vehicle or of this machine is wrong",
    REPEATED: "a relay repeats frames, or a sender replays recorded frames",
}
"""meaning of a refusal, by reason"""
REMEDIES = {
    UNSIGNED: "the vehicle has no key: give it the key of links.signing_key, or leave out links.signing_key",
    OTHER_KEY: "give the vehicle the key of links.signing_key, or set links.signing_key to the vehicle's key",
}
"""advice by reason, for a vehicle whose frames are all refused"""


@dataclass(slots=True)
class _RefusalCount:
    n: int
    reported_s: float


class Refusals:
    """Refused frames at one input. The methods return a message to report now, or ""."""

    def __init__(self) -> None:
        self._counts: dict[tuple[int, str], _RefusalCount] = {}
        """counts by system id and reason; id 0: all unknown systems, to limit the memory"""

    def of_vehicle(self, sysid: int, component: int, why: str, address: str, now_s: float) -> str:
        """Count a refused frame with the system id of an own vehicle."""
        n = self._count_refusal(sysid, why, now_s)
        origin = "" if component == AUTOPILOT_COMPID else f" of component {component}"
        so_far = f"{n} so far, the last{origin} from {address}"
        text = f"frames with this system id are refused, {why} ({so_far}): {MEANINGS[why]} [frames-refused]"
        return text if n else ""

    def of_stranger(self, sysid: int, why: str, address: str, now_s: float) -> str:
        """Count a refused frame of another system."""
        n = self._count_refusal(0, why, now_s)
        so_far = f"{n} so far, the last of system {sysid} at {address}"
        return f"frames are refused, {why} ({so_far}) [frames-refused]" if n else ""

    def _count_refusal(self, sysid: int, why: str, now_s: float) -> int:
        """Count a refused frame; return the number so far if a report is due, else 0."""
        count = self._counts.get((sysid, why))
        if count is None:
            self._counts[sysid, why] = _RefusalCount(1, now_s)
            return 1
        count.n += 1
        if now_s - count.reported_s < REPORT_PERIOD_S:
            return 0
        count.reported_s = now_s
        return count.n
