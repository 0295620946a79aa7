"""Who tells the contrary of what a UAV saw itself: a liar, or a sensor that errs. Pure.

What is told is believed all the same, for who is right? Only sensors taken for perfect contradict each other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Set

from swarmctl.bus.node.decoding import Reading
from swarmctl.bus.node.ledger import Column
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Checkpoint, Observation

Said = tuple[str, str]
"""(topic, text)"""


class Doubts:
    """One UAV's. Counts cells in `flagged`, by who told of them."""

    def __init__(
        self, uav: int, column: Column, rows: int, cols: int, *, perfect: bool, flagged: Counter[int]
    ) -> None:
        self._uav = uav
        self._place = column.place
        self._sightings = column.ledger.sightings
        self._cols = cols
        self._n_cells = rows * cols
        self._perfect = perfect
        self._flagged = flagged

    def saw(self, seen: Observation) -> None:
        """Its own sensor did."""
        if not self._perfect:
            return
        for row, col, occupied in seen.cells:
            self._sightings.saw(self._place, row * self._cols + col, occupied=occupied)

    def has_none_of(self, reading: Reading) -> bool:
        """Whether there is nothing to say of an observation."""
        if not self._sightings.are_of(self._place):
            return True
        return not self._sightings.against(reading.clear, reading.occupied) >> self._place & 1

    def of(self, reading: Reading) -> Iterator[Said]:
        """What there is to say of something that has just been told."""
        return self._against(reading, None)

    def of_earlier(self, readings: Iterable[Reading], cells: Iterable[Cell]) -> Iterator[Said]:
        """The same of what had been told before, now that these cells were seen otherwise."""
        concerned = {row * self._cols + col for row, col in cells}
        for reading in readings:
            yield from self._against(reading, concerned)

    def _against(self, reading: Reading, concerned: set[int] | None) -> Iterator[Said]:
        observer = reading.frame.sender
        if observer == self._uav or not self._sightings.are_of(self._place):
            return
        clear, occupied = self._told_by(reading)
        against = self._sightings.otherwise(self._place, clear, occupied)
        if concerned is not None:
            against &= concerned
        if against:
            self._flagged[observer] += len(against)
            cell = min(against)
            row, col = divmod(cell, self._cols)
            what = "occupied" if cell in occupied else "clear"
            text = f"vehicle {observer} tells that ({row}, {col}) is {what}, which was seen otherwise here"
            yield f"flagged {observer}", text

    def _told_by(self, reading: Reading) -> tuple[Set[int], Set[int]]:
        """(clear, occupied)"""
        told = reading.frame.content
        if not isinstance(told, Checkpoint):
            return reading.clear, reading.occupied
        counts = told.counts(self._n_cells)
        is_occupied = counts.hits > 0
        return set(counts.cells[~is_occupied].tolist()), set(counts.cells[is_occupied].tolist())
