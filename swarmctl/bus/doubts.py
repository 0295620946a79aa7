"""Who tells the contrary of what a UAV saw itself: a liar, or a sensor that errs. Pure.

What is told is believed all the same, for who is right? Only sensors taken for perfect contradict each other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from swarmctl.bus.reading import Reading
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Checkpoint, Observation

Said = tuple[str, str]
"""(topic, text)"""


class Doubts:
    """One UAV's. Counts cells in `flagged`, by who told of them."""

    def __init__(self, uav: int, rows: int, cols: int, *, perfect: bool, flagged: Counter[int]) -> None:
        self._uav = uav
        self._cols = cols
        self._n_cells = rows * cols
        self._perfect = perfect
        self._flagged = flagged
        self._own: dict[int, bool] = {}
        """cell -> what was seen there"""
        self._own_cells = self._own.keys()

    def saw(self, seen: Observation) -> None:
        """Its own sensor did."""
        if self._perfect:
            self._own.update((row * self._cols + col, occupied) for row, col, occupied in seen.cells)

    def of(self, reading: Reading) -> Iterable[Said]:
        """What there is to say of something that has just been told."""
        # Most that is told is of cells that were not seen here: one look at sets.
        if isinstance(reading.frame.content, Observation) and self._own_cells.isdisjoint(reading.cells):
            return ()
        return self._against(reading, None) if self._own else ()

    def of_earlier(self, readings: Iterable[Reading], cells: Iterable[Cell]) -> Iterator[Said]:
        """The same of what had been told before, now that these cells were seen otherwise."""
        concerned = {row * self._cols + col for row, col in cells}
        for reading in readings:
            yield from self._against(reading, concerned)

    def _against(self, reading: Reading, concerned: set[int] | None) -> Iterator[Said]:
        own, observer = self._own, reading.frame.sender
        if observer == self._uav:
            return
        against = [
            cell
            for cell, occupied in self._told_by(reading)
            if own.get(cell, occupied) != occupied and (concerned is None or cell in concerned)
        ]
        if against:
            self._flagged[observer] += len(against)
            row, col = divmod(against[0], self._cols)
            what = "clear" if own[against[0]] else "occupied"
            text = f"vehicle {observer} tells that ({row}, {col}) is {what}, which was seen otherwise here"
            yield f"flagged {observer}", text

    def _told_by(self, reading: Reading) -> Iterator[tuple[int, bool]]:
        told = reading.frame.content
        if not isinstance(told, Checkpoint):
            return zip(reading.cells, reading.occupied, strict=True)
        counts = told.counts(self._n_cells)
        return zip(counts.cells.tolist(), (counts.hits > 0).tolist(), strict=True)
