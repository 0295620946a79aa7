"""Observations of one source, in order: one list for all UAVs of a process that hold the same. Pure.

A hundred UAVs that each kept a table of what they hold of each other would have ten thousand of them, and
every message would go through a hundred places of memory that were last used long ago.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from weakref import WeakValueDictionary

from swarmctl.bus.node.decoding import Reading
from swarmctl.core.observation import Source

_numbers = itertools.count(1)


class Shelf:
    """What follows observation `base` without a gap. It only grows; each who uses it knows up to where."""

    __slots__ = ("__weakref__", "_readings", "base", "number")

    def __init__(self, base: int, readings: Iterable[Reading] = ()) -> None:
        self.base = base
        self.number = next(_numbers)
        """tells it from all others of the process"""
        self._readings = list(readings)

    def takes(self, reading: Reading) -> bool:
        """Whether it stands here now; no if another stands in its place."""
        at = reading.seq - self.base - 1
        if at == len(self._readings):
            self._readings.append(reading)
        return self._readings[at] is reading or self._readings[at].data == reading.data

    def otherwise(self, reading: Reading) -> Shelf:
        """One of its own, on which this stands where another stands here."""
        return Shelf(self.base, (*self.between(0, reading.seq - 1), reading))

    def between(self, after: int, upto: int) -> Sequence[Reading]:
        """Of these sequence numbers, without the first."""
        return self._readings[max(after - self.base, 0) : upto - self.base]


class Shelves:
    """Of all sources, as long as anybody uses them."""

    def __init__(self) -> None:
        self._shelves: WeakValueDictionary[tuple[Source, int], Shelf] = WeakValueDictionary()
        self._numbered: WeakValueDictionary[int, Shelf] = WeakValueDictionary()

    def at(self, source: Source, base: int) -> Shelf:
        shelf = self._shelves.get((source, base))
        if shelf is None:
            shelf = self._shelves[source, base] = Shelf(base)
            self._numbered[shelf.number] = shelf
        return shelf

    def numbered(self, number: int) -> Shelf | None:
        """None for one that stands apart because contents differ."""
        return self._numbered.get(number)
