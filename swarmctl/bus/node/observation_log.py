"""Observations of one source, in order: one shared list for all UAVs of a process. No I/O.

A hundred UAVs with separate lists would have ten thousand lists. Each message would touch a hundred lists,
mostly outside of the processor's cache.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from weakref import WeakValueDictionary

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.core.observation import Source

_numbers = itertools.count(1)


class ObservationLog:
    """The observations with numbers above `base`, without a gap; each UAV has those up to its own `upto`."""

    __slots__ = ("__weakref__", "_frames", "base", "number")

    def __init__(self, base: int, frames: Iterable[DecodedFrame] = ()) -> None:
        self.base = base
        self.number = next(_numbers)
        """number of the log, unique in the process"""
        self._frames = list(frames)

    def try_append(self, decoded: DecodedFrame) -> bool:
        """Append an observation if its number is the next; return whether the log now has the observation."""
        at = decoded.seq - self.base - 1
        if at == len(self._frames):
            self._frames.append(decoded)
        return self._frames[at] is decoded or self._frames[at].data == decoded.data

    def fork(self, decoded: DecodedFrame) -> ObservationLog:
        """Return a new log that has `decoded` after the earlier observations of this log."""
        return ObservationLog(self.base, (*self.between(0, decoded.seq - 1), decoded))

    def between(self, after: int, upto: int) -> Sequence[DecodedFrame]:
        """Return the observations with sequence numbers above `after`, up to and including `upto`."""
        return self._frames[max(after - self.base, 0) : upto - self.base]


class ObservationLogs:
    """The shared logs of all sources; a log without users is freed."""

    def __init__(self) -> None:
        self._logs: WeakValueDictionary[tuple[Source, int], ObservationLog] = WeakValueDictionary()
        self._by_number: WeakValueDictionary[int, ObservationLog] = WeakValueDictionary()

    def at(self, source: Source, base: int) -> ObservationLog:
        """Return the shared log of a source after `base`; create a missing log."""
        log = self._logs.get((source, base))
        if log is None:
            log = self._logs[source, base] = ObservationLog(base)
            self._by_number[log.number] = log
        return log

    def by_number(self, number: int) -> ObservationLog | None:
        """Return the shared log with this number; None for a fork, because a fork is not shared."""
        return self._by_number.get(number)
