"""Observations that each UAV of a process made with its own, perfect sensor, by cell. No I/O."""

from __future__ import annotations

from collections.abc import Iterable


class OwnSightings:
    """Masks of UAVs by cell, to compare a report with all sightings at once; bit i: the UAV with index i."""

    def __init__(self) -> None:
        self._clear: dict[int, int] = {}
        self._occupied: dict[int, int] = {}
        self._observers = 0
        """bit mask of the UAVs with at least one sighting"""

    def record(self, index: int, cell: int, *, occupied: bool) -> None:
        same, opposite = (self._occupied, self._clear) if occupied else (self._clear, self._occupied)
        same[cell] = same.get(cell, 0) | 1 << index
        self._observers |= 1 << index
        if cell in opposite:
            opposite[cell] &= ~(1 << index)

    def has_any(self, index: int) -> bool:
        return bool(self._observers >> index & 1)

    def forget(self, index: int) -> None:
        if not self.has_any(index):
            return
        for observers in (self._clear, self._occupied):
            for cell in observers:
                observers[cell] &= ~(1 << index)
        self._observers ^= 1 << index

    def conflicting_uavs(self, clear: Iterable[int], occupied: Iterable[int]) -> int:
        """Return the bit mask of the UAVs with the opposite sighting of at least one of these cells."""
        uavs = 0
        for cells, opposite in ((clear, self._occupied), (occupied, self._clear)):
            if opposite:
                for cell in cells:
                    uavs |= opposite.get(cell, 0)
        return uavs

    def conflicting_cells(self, index: int, clear: Iterable[int], occupied: Iterable[int]) -> set[int]:
        """Return the cells of which the UAV with this index has the opposite sighting."""
        pairs = ((clear, self._occupied), (occupied, self._clear))
        return {
            cell
            for cells, opposite in pairs
            if opposite
            for cell in cells
            if opposite.get(cell, 0) >> index & 1
        }
