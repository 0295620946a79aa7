"""Replica of all observations at one UAV, by source: the signed frames themselves, and the gaps. No I/O.

The replica keeps the bytes of each frame with the observer's signature, so any neighbour can pass the frame
on. A checkpoint replaces the frames that it summarises.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.observation_log import ObservationLog, ObservationLogs
from swarmctl.bus.node.reception import IndexedValues, ReceptionColumn
from swarmctl.core.frames import HeldObservations, MessageRefused, RefusalReason
from swarmctl.core.observation import BeliefItem, Checkpoint, Observation, Source

COMPACT_AFTER = 256
"""longest run of single observations in an answer; a checkpoint replaces a longer run"""
MAX_BEYOND = 600
"""largest number of observations beyond gaps in a digest, over all sources; others may be sent twice"""
MAX_AHEAD = 1024
"""largest distance of a kept observation beyond a gap; farther observations are requested later"""
MAX_INCARNATIONS = 8
"""greatest number of incarnations kept for one observer"""


class DetachedColumn:
    """The numbers of a source record that is not in the reception tables."""

    __slots__ = ("in_order", "log_number", "upto")

    def __init__(self) -> None:
        self.upto: IndexedValues[int] = [0]
        self.in_order: IndexedValues[bool] = [False]
        self.log_number: IndexedValues[int] = [0]


class SourceRecord(msgspec.Struct, gc=False):
    """All frames of one source, without reference cycles, so the garbage collector can skip the record."""

    source: Source
    log: ObservationLog
    """the observations after `checkpoint`, up to `upto`"""
    checkpoint: Checkpoint | None = None
    checkpoint_frame: DecodedFrame | None = None
    ahead: dict[int, DecodedFrame] = {}
    """observations beyond a gap, by sequence number"""
    numbers: DetachedColumn | ReceptionColumn = msgspec.field(default_factory=DetachedColumn)
    place: int = 0
    """index in `numbers`"""
    _mark: int = 0
    """combined mark of all observations held up to `_marked_upto`, and of `ahead`"""
    _marked_upto: int = 0

    @property
    def upto(self) -> int:
        """Sequence number up to which every observation is held."""
        return self.numbers.upto[self.place]

    @property
    def mark(self) -> int:
        """Exclusive or of the marks of all held observations."""
        if self._marked_upto < self.upto:
            for decoded in self.log.between(self._marked_upto, self.upto):
                self._mark ^= decoded.mark
            self._marked_upto = self.upto
        return self._mark

    def attach(self, numbers: DetachedColumn | ReceptionColumn, place: int = 0) -> None:
        """Move the numbers to another column, shared with other objects."""
        numbers.upto[place], self.numbers.in_order[self.place] = self.upto, False
        self.numbers, self.place = numbers, place
        self._update_column()

    def _update_column(self) -> None:
        """Update the numbers with which the reception table appends to the log."""
        self.numbers.log_number[self.place] = self.log.number
        self.numbers.in_order[self.place] = not self.ahead

    @property
    def covered(self) -> int:
        return 0 if self.checkpoint is None else self.checkpoint.upto

    @property
    def latest(self) -> int:
        return max(self.ahead) if self.ahead else self.upto

    def add(self, decoded: DecodedFrame) -> bool:
        """Add an observation; return whether it is new.

        Raises MessageRefused if another observation with the same name is held.
        """
        seq, upto = decoded.seq, self.upto
        if seq <= self.covered or seq > upto + MAX_AHEAD:
            return False
        known = self.ahead.get(seq) if seq > upto else self.log.between(seq - 1, seq)[0]
        if known is not None:
            seen = decoded.frame.content
            if known.frame.content != seen and isinstance(seen, Observation):
                raise MessageRefused(RefusalReason.TWO_CONTENTS, seen.two_contents)
            return False
        self._mark = self.mark ^ decoded.mark
        self.ahead[seq] = decoded
        if seq == upto + 1:
            self._settle()
        else:
            self.numbers.in_order[self.place] = False
        return True

    def is_next(self, decoded: DecodedFrame) -> bool:
        """Return whether this observation directly follows all held observations."""
        return decoded.seq == self.upto + 1 and not self.ahead

    def append(self, decoded: DecodedFrame) -> None:
        """Append the observation with number `upto` + 1."""
        if not self.log.accepts(decoded):
            self.log = self.log.fork(decoded)
            self._update_column()
        self.numbers.upto[self.place] += 1

    def advance(self, to: Checkpoint, decoded: DecodedFrame, logs: ObservationLogs) -> bool:
        """Adopt a checkpoint that summarises more than the current checkpoint; return True if adopted.

        Raises MessageRefused if the checkpoint contradicts held observations.
        """
        if to.upto <= self.covered:
            return False
        later = self.log.between(to.upto, self.upto)
        mark = to.mark
        for held in (*later, *(held for seq, held in self.ahead.items() if seq > to.upto)):
            mark ^= held.mark
        if to.upto <= self.upto and mark != self.mark:
            raise MessageRefused(RefusalReason.TWO_CONTENTS, to.two_contents)
        self._mark = mark
        self.checkpoint, self.checkpoint_frame = to, decoded
        self.log, self.numbers.upto[self.place] = logs.at(self.source, to.upto), to.upto
        self.ahead |= {held.seq: held for held in later}
        for seq in [seq for seq in self.ahead if seq <= to.upto]:
            del self.ahead[seq]
        self._settle()
        return True

    def _settle(self) -> None:
        while (following := self.ahead.pop(self.upto + 1, None)) is not None:
            self.append(following)
        self._marked_upto = self.upto
        self._update_column()

    def after(self, seq: int) -> Sequence[DecodedFrame]:
        """Return the observations after `seq` and after the checkpoint, in order."""
        in_log = self.log.between(max(seq, self.covered), self.upto)
        if not self.ahead:
            return in_log
        return [*in_log, *(self.ahead[later] for later in sorted(self.ahead) if later > seq)]

    def is_contradicted(self, other: HeldObservations) -> bool:
        """Return whether another UAV holds other contents under the same names: a forged observation."""
        is_same = other.upto == self.upto and other.beyond == tuple(sorted(self.ahead))
        return is_same and other.mark != self.mark

    def digest_entry(self, n_beyond: int) -> HeldObservations:
        ahead = tuple(sorted(self.ahead)[:n_beyond])
        return HeldObservations(*self.source, self.covered, self.upto, ahead, self.mark)


class Replica:
    """The set of all known observations, which only grows."""

    def __init__(self, column: ReceptionColumn) -> None:
        self._column = column
        self._logs = column.table.logs
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
                    f"vehicle {source[0]} was restarted {MAX_INCARNATIONS} times in this flight",
                )
            self._incarnations[source[0]] += 1
            record = self._records[source] = SourceRecord(source, self._logs.at(source, 0))
        return record

    def take(self, record: SourceRecord, item: BeliefItem, decoded: DecodedFrame) -> bool:
        """Add a frame to the record of its source; return whether it is new.

        Raises MessageRefused if another item with the same name is held.
        """
        before = record.mark
        if isinstance(item, Observation):
            is_new = record.add(decoded)
        else:
            is_new = record.advance(item, decoded, self._logs)
        if record.mark != before:
            self._column.toggle_mark(before ^ record.mark)
        return is_new

    def append(self, record: SourceRecord, decoded: DecodedFrame) -> None:
        """Add an observation that `is_next`; the fast path of `take`."""
        record.append(decoded)
        self._column.toggle_mark(decoded.mark)

    def frames(self) -> Iterator[DecodedFrame]:
        """Yield every held frame."""
        for record in self._records.values():
            if record.checkpoint_frame is not None:
                yield record.checkpoint_frame
            yield from record.after(0)

    def lacks(self, have: Iterable[HeldObservations]) -> bool:
        """Return whether a digest lists an observation that is missing here."""
        for other in have:
            own = self._records.get((other.observer, other.incarnation))
            upto, ahead = (0, {}) if own is None else (own.upto, own.ahead)
            if other.upto > upto or any(seq > upto and seq not in ahead for seq in other.beyond):
                return True
        return False

    def digest(self) -> tuple[HeldObservations, ...]:
        """Return a digest of all held observations, limited to the size of a message."""
        held = [(source, record) for source, record in sorted(self._records.items()) if record.latest]
        gaps = sum(bool(record.ahead) for _, record in held)
        return tuple(record.digest_entry(MAX_BEYOND // max(gaps, 1)) for _, record in held)

    def missing(self, have: Iterable[HeldObservations]) -> Iterator[bytes]:
        """Yield the frames missing in a digest; first a checkpoint, if the checkpoint saves frames."""
        digest: Mapping[Source, HeldObservations] = {(h.observer, h.incarnation): h for h in have}
        for source in sorted(self._records):
            record = self._records[source]
            other = digest.get(source) or HeldObservations(*source, 0, 0)
            upto = other.upto
            if record.is_contradicted(other):
                upto = other.checkpoint
            is_better = record.covered > upto or record.covered >= other.checkpoint + COMPACT_AFTER
            if record.checkpoint_frame is not None and is_better:
                yield record.checkpoint_frame.data
                upto = max(upto, record.covered)
            if other.beyond and upto == other.upto:
                beyond = set(other.beyond)
                yield from (decoded.data for decoded in record.after(upto) if decoded.seq not in beyond)
            else:
                yield from [decoded.data for decoded in record.after(upto)]
