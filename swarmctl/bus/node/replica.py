"""What a UAV holds for others: the frames of all observations it knows, by source, and what it lacks. Pure.

Frames are kept word for word, with their observers' signatures, so that whoever asks gets from any neighbour
what only one of them heard. A checkpoint takes the place of the frames it stands for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from swarmctl.bus.node.decoding import Reading
from swarmctl.bus.node.ledger import Column, Numbers
from swarmctl.bus.node.observation_log import Shelf, Shelves
from swarmctl.core.frames import Have, Refused, Why
from swarmctl.core.observation import Checkpoint, Observation, Source, Told

COMPACT_AFTER = 256
"""Observations that are told one by one at most, before a checkpoint is passed on that stands for them."""
MAX_BEYOND = 600
"""observations beyond gaps that are named in a digest, of all sources together; others may be told twice"""
MAX_AHEAD = 1024
"""Observations farther beyond a gap are not kept: they, or what stands for them, can be asked for."""
MAX_INCARNATIONS = 8
"""of one observer"""


class Apart:
    """The numbers of what is kept of a source, where they do not stand in the ledger."""

    __slots__ = ("in_order", "shelf", "upto")

    def __init__(self) -> None:
        self.upto: Numbers[int] = [0]
        self.in_order: Numbers[bool] = [False]
        self.shelf: Numbers[int] = [0]


class Kept(msgspec.Struct, gc=False):
    """All frames of one source. Of what holds no cycles the garbage collector need not know."""

    source: Source
    shelf: Shelf
    """the observations that `checkpoint` does not stand for, up to `upto`"""
    checkpoint: Checkpoint | None = None
    checkpoint_reading: Reading | None = None
    ahead: dict[int, Reading] = {}
    """by sequence number, those beyond a gap"""
    numbers: Apart | Column = msgspec.field(default_factory=Apart)
    place: int = 0
    """where in `numbers`"""
    _mark: int = 0
    """of all that is held up to `_marked`, and of `ahead`"""
    _marked: int = 0

    @property
    def upto(self) -> int:
        """Everything up to here is held."""
        return self.numbers.upto[self.place]

    @property
    def mark(self) -> int:
        """Of all that is held, combined by exclusive or."""
        if self._marked < self.upto:
            for reading in self.shelf.between(self._marked, self.upto):
                self._mark ^= reading.mark
            self._marked = self.upto
        return self._mark

    def stand_at(self, numbers: Apart | Column, place: int = 0) -> None:
        """From now on others change what stands there, too, and see it change."""
        numbers.upto[place], self.numbers.in_order[self.place] = self.upto, False
        self.numbers, self.place = numbers, place
        self._note()

    def _note(self) -> None:
        """What others have to know before they put more on the shelf."""
        self.numbers.shelf[self.place] = self.shelf.number
        self.numbers.in_order[self.place] = not self.ahead

    @property
    def covered(self) -> int:
        return 0 if self.checkpoint is None else self.checkpoint.upto

    @property
    def latest(self) -> int:
        return max(self.ahead) if self.ahead else self.upto

    def observed(self, reading: Reading) -> bool:
        """Whether it is new. Raises Refused where its name is known with another content."""
        seq, upto = reading.seq, self.upto
        if seq <= self.covered or seq > upto + MAX_AHEAD:
            return False
        known = self.ahead.get(seq) if seq > upto else self.shelf.between(seq - 1, seq)[0]
        if known is not None:
            seen = reading.frame.content
            if known.frame.content != seen and isinstance(seen, Observation):
                raise Refused(Why.TWO_CONTENTS, seen.two_contents)
            return False
        self._mark = self.mark ^ reading.mark
        self.ahead[seq] = reading
        if seq == upto + 1:
            self._settle()
        else:
            self.numbers.in_order[self.place] = False
        return True

    def is_next(self, reading: Reading) -> bool:
        """Whether this observation comes right after all that is held."""
        return reading.seq == self.upto + 1 and not self.ahead

    def append(self, reading: Reading) -> None:
        """One that comes right after `upto`."""
        if not self.shelf.takes(reading):
            self.shelf = self.shelf.otherwise(reading)
            self._note()
        self.numbers.upto[self.place] += 1

    def advance(self, to: Checkpoint, reading: Reading, shelves: Shelves) -> bool:
        """Whether it stands for more than what stood before.

        Raises Refused where it stands for others than the observations that are held.
        """
        if to.upto <= self.covered:
            return False
        later = self.shelf.between(to.upto, self.upto)
        mark = to.mark
        for held in (*later, *(held for seq, held in self.ahead.items() if seq > to.upto)):
            mark ^= held.mark
        if to.upto <= self.upto and mark != self.mark:
            raise Refused(Why.TWO_CONTENTS, to.two_contents)
        self._mark = mark
        self.checkpoint, self.checkpoint_reading = to, reading
        self.shelf, self.numbers.upto[self.place] = shelves.at(self.source, to.upto), to.upto
        self.ahead |= {held.seq: held for held in later}
        for seq in [seq for seq in self.ahead if seq <= to.upto]:
            del self.ahead[seq]
        self._settle()
        return True

    def _settle(self) -> None:
        while (following := self.ahead.pop(self.upto + 1, None)) is not None:
            self.append(following)
        self._marked = self.upto
        self._note()

    def after(self, seq: int) -> Sequence[Reading]:
        """Observations later than this one that the checkpoint does not stand for, in order."""
        on_shelf = self.shelf.between(max(seq, self.covered), self.upto)
        if not self.ahead:
            return on_shelf
        return [*on_shelf, *(self.ahead[later] for later in sorted(self.ahead) if later > seq)]

    def is_contradicted(self, theirs: Have) -> bool:
        """Whether other contents have come to others under the same names: somebody lies to one of us."""
        is_same = theirs.upto == self.upto and theirs.beyond == tuple(sorted(self.ahead))
        return is_same and theirs.mark != self.mark

    def have(self, n_beyond: int) -> Have:
        ahead = tuple(sorted(self.ahead)[:n_beyond])
        return Have(*self.source, self.covered, self.upto, ahead, self.mark)


class Replica:
    """The set of all observations known, which only grows."""

    def __init__(self, column: Column) -> None:
        self._column = column
        self._shelves = column.ledger.shelves
        self._kept: dict[Source, Kept] = {}
        self._incarnations: Counter[int] = Counter()

    def of(self, source: Source) -> Kept:
        """What is held of a source, perhaps nothing yet. Raises Refused for too many of one observer."""
        kept = self._kept.get(source)
        if kept is None:
            if self._incarnations[source[0]] == MAX_INCARNATIONS:
                raise Refused(Why.TOO_FAST, f"vehicle {source[0]} was started again {MAX_INCARNATIONS} times")
            self._incarnations[source[0]] += 1
            kept = self._kept[source] = Kept(source, self._shelves.at(source, 0))
        return kept

    def take(self, kept: Kept, told: Told, reading: Reading) -> bool:
        """Whether it was new to what is kept of its source.

        Raises Refused where its name is known with another content.
        """
        before = kept.mark
        if isinstance(told, Observation):
            is_new = kept.observed(reading)
        else:
            is_new = kept.advance(told, reading, self._shelves)
        if kept.mark != before:
            self._column.know(before ^ kept.mark)
        return is_new

    def append(self, kept: Kept, reading: Reading) -> None:
        """The same for an observation that `is_next`, in few steps."""
        kept.append(reading)
        self._column.know(reading.mark)

    def readings(self) -> Iterator[Reading]:
        """Everything held."""
        for kept in self._kept.values():
            if kept.checkpoint_reading is not None:
                yield kept.checkpoint_reading
            yield from kept.after(0)

    def lacks(self, have: Iterable[Have]) -> bool:
        """Whether who holds this holds something that is not held here."""
        for theirs in have:
            mine = self._kept.get((theirs.observer, theirs.incarnation))
            upto, ahead = (0, {}) if mine is None else (mine.upto, mine.ahead)
            if theirs.upto > upto or any(seq > upto and seq not in ahead for seq in theirs.beyond):
                return True
        return False

    def digest(self) -> tuple[Have, ...]:
        """Short enough for a message, however much is missing."""
        held = [(source, kept) for source, kept in sorted(self._kept.items()) if kept.latest]
        gaps = sum(bool(kept.ahead) for _, kept in held)
        return tuple(kept.have(MAX_BEYOND // max(gaps, 1)) for _, kept in held)

    def missing(self, have: Iterable[Have]) -> Iterator[bytes]:
        """The frames that who holds this lacks; checkpoints first where they save frames."""
        theirs: Mapping[Source, Have] = {(h.observer, h.incarnation): h for h in have}
        for source in sorted(self._kept):
            kept = self._kept[source]
            told = theirs.get(source) or Have(*source, 0, 0)
            upto = told.upto
            if kept.is_contradicted(told):
                upto = told.checkpoint
            is_better = kept.covered > upto or kept.covered >= told.checkpoint + COMPACT_AFTER
            if kept.checkpoint_reading is not None and is_better:
                yield kept.checkpoint_reading.data
                upto = max(upto, kept.covered)
            if told.beyond and upto == told.upto:
                beyond = set(told.beyond)
                yield from (reading.data for reading in kept.after(upto) if reading.seq not in beyond)
            else:
                yield from [reading.data for reading in kept.after(upto)]
