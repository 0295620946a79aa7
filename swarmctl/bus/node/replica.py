"""A UAV's replica of all observations, by source. No I/O.

The replica keeps each frame's bytes with the observer's signature, so the UAV can pass the frame on. A
checkpoint replaces the frames that it summarises.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.core.frames import HeldObservations, MessageRefused, RefusalReason
from swarmctl.core.observation import Checkpoint, Observation, Source, checkpoint

COMPACT_AFTER = 256
"""a checkpoint with this many observations more than the receiver's checkpoint is sent in any case"""
MAX_BEYOND = 600
"""largest number of observations beyond gaps in a digest; observations left out may arrive twice"""
MAX_AHEAD = 1024
"""largest lead of a stored observation over `upto`; farther observations are requested later"""
MAX_INCARNATIONS = 8
"""largest number of incarnations of one observer"""
N_FINGERPRINTS = 2048
"""number of stored fingerprints of a UAV: the observations of a sender are often a little older"""
EMPTY_FINGERPRINT = 0
"""fingerprint of an empty set of observations"""


class SourceRecord(msgspec.Struct, gc=False):
    """Held frames of one source, without reference cycles, so the garbage collector can skip the record."""

    source: Source
    checkpoint: Checkpoint | None = None
    checkpoint_frame: DecodedFrame | None = None
    in_order: list[DecodedFrame] = []
    """all observations after the checkpoint, up to `upto`"""
    ahead: dict[int, DecodedFrame] = {}
    """observations beyond a gap, by sequence number"""
    upto: int = 0
    """sequence number up to which every observation is held"""
    mark: int = 0
    """exclusive or of the marks of all held observations"""

    @property
    def checkpoint_upto(self) -> int:
        return 0 if self.checkpoint is None else self.checkpoint.upto

    @property
    def latest(self) -> int:
        return max(self.ahead) if self.ahead else self.upto

    def add(self, decoded: DecodedFrame) -> bool:
        """Add an observation; return False if it is held, or more than `MAX_AHEAD` after `upto`.

        Raises MessageRefused if a different observation with the same number is held.
        """
        seq, upto = decoded.seq, self.upto
        if seq == upto + 1:
            self.in_order.append(decoded)
            self.upto = seq
            if self.ahead:
                self._append_following()
        elif seq <= self.checkpoint_upto or seq > upto + MAX_AHEAD:
            return False
        else:
            held = self.ahead.get(seq) if seq > upto else self.in_order[seq - self.checkpoint_upto - 1]
            if held is not None:
                content = decoded.frame.content
                if held.frame.content != content and isinstance(content, Observation):
                    raise MessageRefused(RefusalReason.TWO_CONTENTS, content.two_contents)
                return False
            self.ahead[seq] = decoded
        self.mark ^= decoded.mark
        return True

    def adopt(self, decoded: DecodedFrame) -> bool:
        """Adopt a checkpoint that summarises more than the current checkpoint; return True if adopted.

        Raises MessageRefused if this UAV holds all summarised observations and their contents differ.
        """
        adopted = decoded.frame.content
        assert isinstance(adopted, Checkpoint)
        upto = adopted.upto
        if upto <= self.checkpoint_upto:
            return False
        later = self.in_order[upto - self.checkpoint_upto :]
        ahead = {seq: held for seq, held in self.ahead.items() if seq > upto}
        mark = adopted.mark
        for held in (*later, *ahead.values()):
            mark ^= held.mark
        if upto <= self.upto and mark != self.mark:
            raise MessageRefused(RefusalReason.TWO_CONTENTS, adopted.two_contents)
        self.checkpoint, self.checkpoint_frame, self.mark = adopted, decoded, mark
        self.in_order, self.ahead, self.upto = later, ahead, max(upto, self.upto)
        self._append_following()
        return True

    def _append_following(self) -> None:
        while (following := self.ahead.pop(self.upto + 1, None)) is not None:
            self.in_order.append(following)
            self.upto += 1

    def after(self, seq: int) -> Sequence[DecodedFrame]:
        """Return the observations after `seq` and after the checkpoint, in order."""
        in_order = self.in_order[max(seq - self.checkpoint_upto, 0) :]
        if not self.ahead:
            return in_order
        return [*in_order, *(self.ahead[later] for later in sorted(self.ahead) if later > seq)]

    def summary(self, rows: int, cols: int) -> Checkpoint | None:
        """Return a checkpoint of all observations in order; None if it is too long for a message."""
        contents = (decoded.frame.content for decoded in self.in_order)
        seen = [content for content in contents if isinstance(content, Observation)]
        return checkpoint(self.checkpoint, seen, cols, rows * cols)

    def is_contradicted(self, other: HeldObservations) -> bool:
        """Return whether another UAV holds other contents under exactly the same observation numbers."""
        has_same_numbers = other.upto == self.upto and other.beyond == tuple(sorted(self.ahead))
        return has_same_numbers and other.mark != self.mark

    def digest_entry(self, max_beyond: int) -> HeldObservations:
        beyond = tuple(sorted(self.ahead)[:max_beyond])
        return HeldObservations(*self.source, self.checkpoint_upto, self.upto, beyond, self.mark)


class Replica:
    """All observations that one UAV holds; the set only grows."""

    def __init__(self) -> None:
        self.fingerprint = EMPTY_FINGERPRINT
        """hash of the set of all held observations, 63 bits; the order of arrival has no effect"""
        self._earlier: dict[int, None] = {}
        """the last N_FINGERPRINTS fingerprints, in order"""
        self._records: dict[Source, SourceRecord] = {}
        self._incarnations: Counter[int] = Counter()

    def of(self, source: Source) -> SourceRecord:
        """Return the record of a source; create a missing record.

        Raises MessageRefused for more than `MAX_INCARNATIONS` incarnations of one observer.
        """
        record = self._records.get(source)
        if record is None:
            if self._incarnations[source[0]] == MAX_INCARNATIONS:
                raise MessageRefused(
                    RefusalReason.TOO_FAST,
                    f"the agent of vehicle {source[0]} was restarted {MAX_INCARNATIONS} times in this "
                    "flight; observations after the last restart are ignored",
                )
            self._incarnations[source[0]] += 1
            record = self._records[source] = SourceRecord(source)
        return record

    def add(self, record: SourceRecord, decoded: DecodedFrame) -> bool:
        """Add an observation or checkpoint to the record of its source; return whether it was added.

        Raises MessageRefused if it contradicts held observations.
        """
        before = record.mark
        is_added = record.add(decoded) if decoded.seq else record.adopt(decoded)
        if record.mark != before:
            self.fingerprint ^= before ^ record.mark
            self._earlier[self.fingerprint] = None
            if len(self._earlier) > N_FINGERPRINTS:
                del self._earlier[next(iter(self._earlier))]
        return is_added

    def has_held(self, fingerprint: int) -> bool:
        """Return whether this UAV has, or once had, exactly the observations of this fingerprint."""
        return fingerprint in (EMPTY_FINGERPRINT, self.fingerprint) or fingerprint in self._earlier

    def frames(self) -> Iterator[DecodedFrame]:
        """Yield every held frame."""
        for record in self._records.values():
            if record.checkpoint_frame is not None:
                yield record.checkpoint_frame
            yield from record.after(0)

    def lacks(self, digest: Iterable[HeldObservations]) -> bool:
        """Return whether a digest lists an observation that is missing here."""
        for other in digest:
            record = self._records.get((other.observer, other.incarnation))
            upto, ahead = (0, {}) if record is None else (record.upto, record.ahead)
            if other.upto > upto or any(seq > upto and seq not in ahead for seq in other.beyond):
                return True
        return False

    def digest(self) -> tuple[HeldObservations, ...]:
        """Return a digest of all held observations, with at most `MAX_BEYOND` numbers beyond gaps."""
        records = [record for _, record in sorted(self._records.items()) if record.latest]
        n_with_gap = sum(bool(record.ahead) for record in records)
        return tuple(record.digest_entry(MAX_BEYOND // max(n_with_gap, 1)) for record in records)

    def missing(self, digest: Iterable[HeldObservations]) -> Iterator[bytes]:
        """Yield the frames that a digest lacks, after each source's checkpoint if that is worth sending."""
        entries: Mapping[Source, HeldObservations] = {(h.observer, h.incarnation): h for h in digest}
        for source in sorted(self._records):
            record = self._records[source]
            other = entries.get(source) or HeldObservations(*source, 0, 0)
            upto, checkpoint_upto = other.upto, record.checkpoint_upto
            if record.is_contradicted(other):
                upto = other.checkpoint
            is_worth_sending = checkpoint_upto > upto or checkpoint_upto >= other.checkpoint + COMPACT_AFTER
            if record.checkpoint_frame is not None and is_worth_sending:
                yield record.checkpoint_frame.data
                upto = max(upto, checkpoint_upto)
            if other.beyond and upto == other.upto:
                beyond = set(other.beyond)
                yield from (decoded.data for decoded in record.after(upto) if decoded.seq not in beyond)
            else:
                yield from [decoded.data for decoded in record.after(upto)]
