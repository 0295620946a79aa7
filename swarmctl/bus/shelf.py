"""Observations of one source, in order: one list for all UAVs of a process that hold the same. Pure.

A hundred UAVs that each kept a table of what they hold of each other would have ten thousand of them, and
every message would go through a hundred places of memory that were last used long ago.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from weakref import WeakValueDictionary

from swarmctl.bus.reading import Reading
from swarmctl.core.observation import Source


class Shelf:
    """What follows observation `base` without a gap. It only grows; each who uses it knows up to where."""

    __slots__ = ("__weakref__", "_readings", "base")

    def __init__(self, base: int, readings: Iterable[Reading] = ()) -> None:
        self.base = base
        self._readings = list(readings)

    def put(self, reading: Reading) -> Shelf:
        """Where it stands now: here, or in a shelf of its own if another stands in its place."""
        at = reading.seq - self.base - 1
        if at == len(self._readings):
            self._readings.append(reading)
        elif self._readings[at] is not reading and self._readings[at].data != reading.data:
            return Shelf(self.base, (*self._readings[:at], reading))
        return self

    def between(self, after: int, upto: int) -> Sequence[Reading]:
        """Of these sequence numbers, without the first."""
        return self._readings[max(after - self.base, 0) : upto - self.base]


class Shelves:
    """Of all sources, as long as anybody uses them."""

    def __init__(self) -> None:
        self._shelves: WeakValueDictionary[tuple[Source, int], Shelf] = WeakValueDictionary()

    def at(self, source: Source, base: int) -> Shelf:
        shelf = self._shelves.get((source, base))
        if shelf is None:
            shelf = self._shelves[source, base] = Shelf(base)
        return shelf
