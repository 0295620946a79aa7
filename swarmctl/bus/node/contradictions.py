"""Contradictions between a UAV's own observations and those of other UAVs. No I/O.

The cause is a forged report or a sensor error. Beliefs merge both observations, because neither is known to
be right. If `NodeOptions.perfect_sensors` is false, no contradiction is found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Set

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Checkpoint, Observation

Notice = tuple[str, str]
"""(topic, text)"""


class Contradictions:
    """Contradictions found by one UAV; `flagged`: number of contradicting cells, by the reporting UAV."""

    def __init__(self, uav: int, options: NodeOptions, flagged: Counter[int]) -> None:
        self._uav = uav
        self._options = options
        self._flagged = flagged
        self._clear: set[int] = set()
        self._occupied: set[int] = set()
        """row · cols + col of the cells that the UAV itself saw as clear, and as occupied"""

    def record_own(self, seen: Observation) -> None:
        """Record an observation of the UAV's own sensor."""
        if not self._options.perfect_sensors:
            return
        for row, col, occupied in seen.cells:
            same, opposite = (self._occupied, self._clear) if occupied else (self._clear, self._occupied)
            cell = row * self._options.cols + col
            same.add(cell)
            opposite.discard(cell)

    def find(self, decoded: DecodedFrame, among: Set[Cell] | None = None) -> list[Notice]:
        """Return a notice if a frame contradicts own observations; count the contradicting cells.

        `among`: the only cells that are compared; None: all cells
        """
        observer = decoded.frame.sender
        if observer == self._uav or not (self._clear or self._occupied):
            return []
        clear, occupied = decoded.clear, decoded.occupied
        if isinstance(decoded.frame.content, Checkpoint):
            clear, occupied = self._cells_of(decoded.frame.content)
        if clear.isdisjoint(self._occupied) and occupied.isdisjoint(self._clear):
            return []
        conflicting = (clear & self._occupied) | (occupied & self._clear)
        cols = self._options.cols
        if among is not None:
            conflicting &= {row * cols + col for row, col in among}
        if not conflicting:
            return []
        self._flagged[observer] += len(conflicting)
        cell = min(conflicting)
        row, col = divmod(cell, cols)
        content = "occupied" if cell in occupied else "clear"
        text = (
            f"vehicle {observer} reports cell ({row}, {col}) as {content}, which contradicts this "
            "vehicle's own observation; both observations are kept"
        )
        return [(f"flagged {observer}", text)]

    def _cells_of(self, content: Checkpoint) -> tuple[frozenset[int], frozenset[int]]:
        counts = content.counts(self._options.rows * self._options.cols)
        is_occupied = counts.hits > 0
        return frozenset(counts.cells[~is_occupied].tolist()), frozenset(counts.cells[is_occupied].tolist())
