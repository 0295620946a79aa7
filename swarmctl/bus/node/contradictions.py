"""Contradictions between a UAV's own observations and those of other UAVs. No I/O.

The cause is a forged report or a sensor error. Beliefs merge both observations, because neither is known to
be right. If `NodeOptions.perfect_sensors` is false, no contradiction is found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Set

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.reception import ReceptionColumn
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Checkpoint, Observation

Notice = tuple[str, str]
"""(topic, text)"""


class Contradictions:
    """Contradictions found by one UAV; `flagged`: number of contradicting cells, by the reporting UAV."""

    def __init__(
        self, uav: int, column: ReceptionColumn, rows: int, cols: int, *, perfect: bool, flagged: Counter[int]
    ) -> None:
        self._uav = uav
        self._index = column.index
        self._sightings = column.table.sightings
        self._cols = cols
        self._n_cells = rows * cols
        self._perfect = perfect
        self._flagged = flagged

    def record_own(self, seen: Observation) -> None:
        """Record an observation of the UAV's own sensor."""
        if not self._perfect:
            return
        for row, col, occupied in seen.cells:
            self._sightings.record(self._index, row * self._cols + col, occupied=occupied)

    def agrees_with_own(self, decoded: DecodedFrame) -> bool:
        """Return whether an observation contradicts no own observation."""
        if not self._sightings.has_any(self._index):
            return True
        return not self._sightings.conflicting_uavs(decoded.clear, decoded.occupied) >> self._index & 1

    def find(self, decoded: DecodedFrame) -> Iterator[Notice]:
        """Yield a notice if a new frame contradicts own observations; count the contradicting cells."""
        return self._find(decoded, None)

    def find_earlier(self, frames: Iterable[DecodedFrame], cells: Iterable[Cell]) -> Iterator[Notice]:
        """Yield notices for earlier frames that contradict the UAV's new observation of `cells`."""
        new_cells = {row * self._cols + col for row, col in cells}
        for decoded in frames:
            yield from self._find(decoded, new_cells)

    def _find(self, decoded: DecodedFrame, compared_cells: set[int] | None) -> Iterator[Notice]:
        observer = decoded.frame.sender
        if observer == self._uav or not self._sightings.has_any(self._index):
            return
        clear, occupied = self._cells_of(decoded)
        conflicting = self._sightings.conflicting_cells(self._index, clear, occupied)
        if compared_cells is not None:
            conflicting &= compared_cells
        if conflicting:
            self._flagged[observer] += len(conflicting)
            cell = min(conflicting)
            row, col = divmod(cell, self._cols)
            content = "occupied" if cell in occupied else "clear"
            text = (
                f"vehicle {observer} reports cell ({row}, {col}) as {content}, which contradicts this "
                "vehicle's own observation; both observations are kept"
            )
            yield f"flagged {observer}", text

    def _cells_of(self, decoded: DecodedFrame) -> tuple[Set[int], Set[int]]:
        content = decoded.frame.content
        if not isinstance(content, Checkpoint):
            return decoded.clear, decoded.occupied
        counts = content.counts(self._n_cells)
        is_occupied = counts.hits > 0
        return set(counts.cells[~is_occupied].tolist()), set(counts.cells[is_occupied].tolist())
