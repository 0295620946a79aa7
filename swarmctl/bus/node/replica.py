"""The observations that a UAV holds, by source: the signed frames themselves, and the gaps. Pure.

Frames are kept byte for byte with their observers' signatures. So a UAV gets from any neighbour what only
that neighbour received. A checkpoint replaces the frames that it summarises.
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
"""Longest run of single observations in an answer, before a checkpoint is sent in their place."""
MAX_BEYOND = 600
"""observations beyond gaps that a digest lists, over all sources; others may be sent twice"""
MAX_AHEAD = 1024
"""Observations farther beyond a gap are not kept; they, or a checkpoint, can be requested later."""
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
    """All frames of one source. It holds no cycles, so the garbage collector can skip it."""

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
    """combined mark of all that is held up to `_marked`, and of `ahead`"""
    _marked: int = 0

    @property
    def upto(self) -> int:
        """Sequence number up to which every observation is held."""
        return self.numbers.upto[self.place]

    @property
    def mark(self) -> int:
        """Exclusive or of the marks of all observations held."""
        if self._marked < self.upto:
            for decoded in self.log.between(self._marked, self.upto):
                self._mark ^= decoded.mark
            self._marked = self.upto
        return self._mark

    def attach(self, numbers: DetachedColumn | ReceptionColumn, place: int = 0) -> None:
        """Move the numbers to another column; its other users see and make changes too."""
        numbers.upto[place], self.numbers.in_order[self.place] = self.upto, False
        self.numbers, self.place = numbers, place
        self._update_column()

    def _update_column(self) -> None:
        """Update the numbers that the reception table needs to append to the log itself."""
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

        Raises Refused if its name is known with another content.
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
        """Return whether this observation directly follows all that is held."""
        return decoded.seq == self.upto + 1 and not self.ahead

    def append(self, decoded: DecodedFrame) -> None:
        """Append the observation with number `upto` + 1."""
        if not self.log.accepts(decoded):
            self.log = self.log.fork(decoded)
            self._update_column()
        self.numbers.upto[self.place] += 1

    def advance(self, to: Checkpoint, decoded: DecodedFrame, logs: ObservationLogs) -> bool:
        """Adopt a checkpoint that summarises more than the present one; return whether it was adopted.

        Raises Refused if it summarises other observations than those held.
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
        self._marked = self.upto
        self._update_column()

    def after(self, seq: int) -> Sequence[DecodedFrame]:
        """Return the observations after `seq` that the checkpoint does not summarise, in order."""
        in_log = self.log.between(max(seq, self.covered), self.upto)
        if not self.ahead:
            return in_log
        return [*in_log, *(self.ahead[later] for later in sorted(self.ahead) if later > seq)]

    def is_contradicted(self, theirs: HeldObservations) -> bool:
        """Return whether another UAV holds other contents under the same names: one of both was forged."""
        is_same = theirs.upto == self.upto and theirs.beyond == tuple(sorted(self.ahead))
        return is_same and theirs.mark != self.mark

    def have(self, n_beyond: int) -> HeldObservations:
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
        """Return the record of a source, a new one if there is none.

        Raises Refused for more than `MAX_INCARNATIONS` of one observer.
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

    def take(self, record: SourceRecord, told: BeliefItem, decoded: DecodedFrame) -> bool:
        """Add a frame to the record of its source; return whether it is new.

        Raises Refused if its name is known with another content.
        """
        before = record.mark
        if isinstance(told, Observation):
            is_new = record.add(decoded)
        else:
            is_new = record.advance(told, decoded, self._logs)
        if record.mark != before:
            self._column.toggle_mark(before ^ record.mark)
        return is_new

    def append(self, record: SourceRecord, decoded: DecodedFrame) -> None:
        """Add an observation that `is_next`; the fast path of `take`."""
        record.append(decoded)
        self._column.toggle_mark(decoded.mark)

    def frames(self) -> Iterator[DecodedFrame]:
        """Yield every frame held."""
        for record in self._records.values():
            if record.checkpoint_frame is not None:
                yield record.checkpoint_frame
            yield from record.after(0)

    def lacks(self, have: Iterable[HeldObservations]) -> bool:
        """Return whether a digest lists an observation that is missing here."""
        for theirs in have:
            mine = self._records.get((theirs.observer, theirs.incarnation))
            upto, ahead = (0, {}) if mine is None else (mine.upto, mine.ahead)
            if theirs.upto > upto or any(seq > upto and seq not in ahead for seq in theirs.beyond):
                return True
        return False

    def digest(self) -> tuple[HeldObservations, ...]:
        """Return a digest of all that is held; it fits into a message, however much is missing."""
        held = [(source, record) for source, record in sorted(self._records.items()) if record.latest]
        gaps = sum(bool(record.ahead) for _, record in held)
        return tuple(record.have(MAX_BEYOND // max(gaps, 1)) for _, record in held)

    def missing(self, have: Iterable[HeldObservations]) -> Iterator[bytes]:
        """Yield the frames that are missing in a digest; checkpoints first where they save frames."""
        theirs: Mapping[Source, HeldObservations] = {(h.observer, h.incarnation): h for h in have}
        for source in sorted(self._records):
            record = self._records[source]
            told = theirs.get(source) or HeldObservations(*source, 0, 0)
            upto = told.upto
            if record.is_contradicted(told):
                upto = told.checkpoint
            is_better = record.covered > upto or record.covered >= told.checkpoint + COMPACT_AFTER
            if record.checkpoint_frame is not None and is_better:
                yield record.checkpoint_frame.data
                upto = max(upto, record.covered)
            if told.beyond and upto == told.upto:
                beyond = set(told.beyond)
                yield from (decoded.data for decoded in record.after(upto) if decoded.seq not in beyond)
            else:
                yield from [decoded.data for decoded in record.after(upto)]
