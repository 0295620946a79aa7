"""A UAV's replica of all observations, by source. No I/O.

The replica keeps each frame's bytes with the observer's signature, so the UAV can pass the frame on. A
checkpoint replaces the frames that it summarises.
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
"""a checkpoint with this many observations more than the receiver's checkpoint is sent in any case"""
MAX_BEYOND = 600
"""largest number of observations beyond gaps in a digest; observations left out may arrive twice"""
MAX_AHEAD = 1024
"""largest lead of a stored observation over `upto`; farther observations are requested later"""
MAX_INCARNATIONS = 8
"""largest number of incarnations of one observer"""


class DetachedColumn:
    """The values of one source record outside the reception tables."""

    __slots__ = ("in_order", "log_number", "upto")

    def __init__(self) -> None:
        self.upto: IndexedValues[int] = [0]
        self.in_order: IndexedValues[bool] = [False]
        self.log_number: IndexedValues[int] = [0]


class SourceRecord(msgspec.Struct, gc=False):
    """Held frames of one source, without reference cycles, so the garbage collector can skip the record."""

    source: Source
    log: ObservationLog
    """shared log of the observations after `checkpoint`; this UAV holds those up to `upto`"""
    checkpoint: Checkpoint | None = None
    checkpoint_frame: DecodedFrame | None = None
    ahead: dict[int, DecodedFrame] = {}
    """observations beyond a gap, by sequence number"""
    column: DetachedColumn | ReceptionColumn = msgspec.field(default_factory=DetachedColumn)
    row: int = 0
    """index in `column`"""
    _mark: int = 0
    """combined mark of all observations held up to `_marked_upto`, and of `ahead`"""
    _marked_upto: int = 0

    @property
    def upto(self) -> int:
        """Sequence number up to which every observation is held."""
        return self.column.upto[self.row]

    @property
    def mark(self) -> int:
        """Exclusive or of the marks of all held observations."""
        if self._marked_upto < self.upto:
            for decoded in self.log.between(self._marked_upto, self.upto):
                self._mark ^= decoded.mark
            self._marked_upto = self.upto
        return self._mark

    def attach(self, column: DetachedColumn | ReceptionColumn, row: int = 0) -> None:
        """Move this record's values to another column."""
        column.upto[row], self.column.in_order[self.row] = self.upto, False
        self.column, self.row = column, row
        self._update_column()

    def _update_column(self) -> None:
        """Update the values with which the reception table appends to the log."""
        self.column.log_number[self.row] = self.log.number
        self.column.in_order[self.row] = not self.ahead

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
        if seq <= self.checkpoint_upto or seq > upto + MAX_AHEAD:
            return False
        held = self.ahead.get(seq) if seq > upto else self.log.between(seq - 1, seq)[0]
        if held is not None:
            content = decoded.frame.content
            if held.frame.content != content and isinstance(content, Observation):
                raise MessageRefused(RefusalReason.TWO_CONTENTS, content.two_contents)
            return False
        self._mark = self.mark ^ decoded.mark
        self.ahead[seq] = decoded
        if seq == upto + 1:
            self._append_following()
        else:
            self.column.in_order[self.row] = False
        return True

    def is_next(self, decoded: DecodedFrame) -> bool:
        """Return whether this observation directly follows all held observations."""
        return decoded.seq == self.upto + 1 and not self.ahead

    def append(self, decoded: DecodedFrame) -> None:
        """Append the observation with number `upto` + 1."""
        if not self.log.try_append(decoded):
            self.log = self.log.fork(decoded)
            self._update_column()
        self.column.upto[self.row] += 1

    def adopt(self, checkpoint: Checkpoint, decoded: DecodedFrame, logs: ObservationLogs) -> bool:
        """Adopt a checkpoint that summarises more than the current checkpoint; return True if adopted.

        Raises MessageRefused if this UAV holds all summarised observations and their contents differ.
        """
        upto = checkpoint.upto
        if upto <= self.checkpoint_upto:
            return False
        later = self.log.between(upto, self.upto)
        mark = checkpoint.mark
        for held in (*later, *(held for seq, held in self.ahead.items() if seq > upto)):
            mark ^= held.mark
        if upto <= self.upto and mark != self.mark:
            raise MessageRefused(RefusalReason.TWO_CONTENTS, checkpoint.two_contents)
        self._mark = mark
        self.checkpoint, self.checkpoint_frame = checkpoint, decoded
        self.log, self.column.upto[self.row] = logs.at(self.source, upto), upto
        self.ahead |= {held.seq: held for held in later}
        for seq in [seq for seq in self.ahead if seq <= upto]:
            del self.ahead[seq]
        self._append_following()
        return True

    def _append_following(self) -> None:
        while (following := self.ahead.pop(self.upto + 1, None)) is not None:
            self.append(following)
        self._marked_upto = self.upto
        self._update_column()

    def after(self, seq: int) -> Sequence[DecodedFrame]:
        """Return the observations after `seq` and after the checkpoint, in order."""
        in_log = self.log.between(max(seq, self.checkpoint_upto), self.upto)
        if not self.ahead:
            return in_log
        return [*in_log, *(self.ahead[later] for later in sorted(self.ahead) if later > seq)]

    def is_contradicted(self, other: HeldObservations) -> bool:
        """Return whether another UAV holds other contents under exactly the same observation numbers."""
        has_same_numbers = other.upto == self.upto and other.beyond == tuple(sorted(self.ahead))
        return has_same_numbers and other.mark != self.mark

    def digest_entry(self, max_beyond: int) -> HeldObservations:
        beyond = tuple(sorted(self.ahead)[:max_beyond])
        return HeldObservations(*self.source, self.checkpoint_upto, self.upto, beyond, self.mark)


class Replica:
    """All observations that one UAV holds; the set only grows."""

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
                    f"the agent of vehicle {source[0]} was restarted {MAX_INCARNATIONS} times in this "
                    "flight; observations after the last restart are ignored",
                )
            self._incarnations[source[0]] += 1
            record = self._records[source] = SourceRecord(source, self._logs.at(source, 0))
        return record

    def add(self, record: SourceRecord, item: BeliefItem, decoded: DecodedFrame) -> bool:
        """Add an observation or checkpoint to the record of its source; return whether it was added.

        Raises MessageRefused if it contradicts held observations.
        """
        before = record.mark
        if isinstance(item, Observation):
            is_added = record.add(decoded)
        else:
            is_added = record.adopt(item, decoded, self._logs)
        if record.mark != before:
            self._column.toggle_mark(before ^ record.mark)
        return is_added

    def append(self, record: SourceRecord, decoded: DecodedFrame) -> None:
        """Add an observation that `is_next`; the fast path of `add`."""
        record.append(decoded)
        self._column.toggle_mark(decoded.mark)

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
