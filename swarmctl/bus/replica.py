"""What a UAV holds for others: the frames of all observations it knows, by source, and what it lacks. Pure.

Frames are kept word for word, with their observers' signatures, so that whoever asks gets from any neighbour
what only one of them heard. A checkpoint takes the place of the frames it stands for.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache

import msgspec

from swarmctl.bus.reading import Reading
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


class Kept(msgspec.Struct, gc=False):
    """All frames of one source. Of what holds no cycles the garbage collector need not know."""

    checkpoint: Checkpoint | None = None
    checkpoint_reading: Reading | None = None
    later: dict[int, Reading] = {}
    """by sequence number, those the checkpoint does not stand for"""
    upto: int = 0
    """everything up to here is held"""
    latest: int = 0
    mark: int = 0
    """in the replica's fingerprint; 0 where nothing is held"""

    @property
    def covered(self) -> int:
        return 0 if self.checkpoint is None else self.checkpoint.upto

    def observed(self, seen: Observation, reading: Reading) -> bool:
        """Whether it is new. Raises Refused where its name is known with another content."""
        seq, later = seen.seq, self.later
        if self.checkpoint is not None and seq <= self.checkpoint.upto:
            return False
        if seq > self.upto + MAX_AHEAD:
            return False
        known = later.get(seq)
        if known is not None:
            if known is not reading and known.frame.content != seen:
                raise Refused(Why.TWO_CONTENTS, seen.two_contents)
            return False
        later[seq] = reading
        self.latest = max(self.latest, seq)
        if seq == self.upto + 1:
            self.upto = seq
            if self.latest > seq:
                self._settle()
        return True

    def advance(self, to: Checkpoint, reading: Reading) -> bool:
        """Whether it stands for more than what stood before."""
        if to.upto <= self.covered:
            return False
        self.checkpoint, self.checkpoint_reading = to, reading
        self.later = {seq: held for seq, held in self.later.items() if seq > to.upto}
        self.upto, self.latest = max(self.upto, to.upto), max(self.latest, to.upto)
        self._settle()
        return True

    def _settle(self) -> None:
        while self.upto + 1 in self.later:
            self.upto += 1

    def observations(self) -> Iterator[Observation]:
        """Those the checkpoint does not stand for."""
        contents = (reading.frame.content for reading in self.later.values())
        return (content for content in contents if isinstance(content, Observation))

    def have(self, source: Source, n_beyond: int) -> Have:
        return Have(*source, self.covered, self.upto, self.beyond(self.upto)[:n_beyond])

    def beyond(self, upto: int) -> tuple[int, ...]:
        """The observations held that come after `upto`, in order."""
        if self.latest <= upto:
            return ()
        return tuple(sorted(seq for seq in self.later if seq > upto))


class Replica:
    """The set of all observations known, which only grows."""

    def __init__(self) -> None:
        self._kept: dict[Source, Kept] = {}
        self._fingerprint = 0
        self.changed: dict[Source, Kept] = {}
        """sources whose marks are out of date"""

    def of(self, source: Source) -> Kept:
        """What is held of a source, perhaps nothing yet. Raises Refused for too many of one observer."""
        kept = self._kept.get(source)
        if kept is None:
            if sum(observer == source[0] for observer, _ in self._kept) >= MAX_INCARNATIONS:
                raise Refused(Why.TOO_FAST, f"vehicle {source[0]} was started again {MAX_INCARNATIONS} times")
            kept = self._kept[source] = Kept()
        return kept

    def take(self, kept: Kept, told: Told, reading: Reading) -> bool:
        """Whether it was new to what is kept of its source.

        Raises Refused where its name is known with another content.
        """
        is_new = (
            kept.observed(told, reading) if isinstance(told, Observation) else kept.advance(told, reading)
        )
        if is_new:
            self.changed[reading.source] = kept
        return is_new

    def readings(self) -> Iterator[Reading]:
        """Everything held."""
        for kept in self._kept.values():
            if kept.checkpoint_reading is not None:
                yield kept.checkpoint_reading
            yield from kept.later.values()

    def lacks(self, have: Iterable[Have]) -> bool:
        """Whether who holds this holds something that is not held here."""
        for theirs in have:
            mine = self._kept.get((theirs.observer, theirs.incarnation)) or Kept()
            if theirs.upto > mine.upto or any(s > mine.upto and s not in mine.later for s in theirs.beyond):
                return True
        return False

    def digest(self) -> tuple[Have, ...]:
        """Short enough for a message, however much is missing."""
        held = [(source, kept) for source, kept in sorted(self._kept.items()) if kept.latest]
        gaps = sum(kept.latest > kept.upto for _, kept in held)
        return tuple(kept.have(source, MAX_BEYOND // max(gaps, 1)) for source, kept in held)

    @property
    def fingerprint(self) -> int:
        """The same for all who hold the same, whatever stands for it; 63 bits."""
        for source, kept in self.changed.items():
            mark = _mark(*source, kept.upto)
            for seq in kept.beyond(kept.upto):
                mark = _mixed(mark, seq)
            self._fingerprint ^= kept.mark ^ mark
            kept.mark = mark
        self.changed.clear()
        return self._fingerprint >> 1

    def missing(self, have: Iterable[Have]) -> Iterator[bytes]:
        """The frames that who holds this lacks; checkpoints first where they save frames."""
        theirs: Mapping[Source, Have] = {(h.observer, h.incarnation): h for h in have}
        for source in sorted(self._kept):
            kept = self._kept[source]
            told = theirs.get(source) or Have(*source, 0, 0)
            upto = told.upto
            is_better = kept.covered > upto or kept.covered >= told.checkpoint + COMPACT_AFTER
            if kept.checkpoint_reading is not None and is_better:
                yield kept.checkpoint_reading.data
                upto = max(upto, kept.covered)
            beyond = set(told.beyond)
            for seq in kept.beyond(upto):
                if seq not in beyond:
                    yield kept.later[seq].data


@lru_cache(maxsize=4096)
def _mark(observer: int, incarnation: int, upto: int) -> int:
    """A number that tells which observations of a source are held; worked out once for all UAVs here."""
    return _mixed(_mixed(_mixed(0, observer), incarnation), upto)


def _mixed(mark: int, number: int) -> int:
    """The steps of splitmix64."""
    mark = (mark ^ number) * 0xBF58476D1CE4E5B9 & 0xFFFFFFFFFFFFFFFF
    mark = (mark ^ mark >> 27) * 0x94D049BB133111EB & 0xFFFFFFFFFFFFFFFF
    return mark ^ mark >> 31
