"""Observations that each UAV of a process made with its own sensor, by cell; only perfect sensors. No I/O."""

from __future__ import annotations

from collections.abc import Iterable


class OwnSightings:
    """Masks of UAVs by cell, to compare a report with all sightings at once; bit i: the UAV at place i."""

    def __init__(self) -> None:
        self._clear: dict[int, int] = {}
        self._occupied: dict[int, int] = {}
        self._places = 0
        """bit mask of the UAVs with at least one sighting"""

    def record(self, place: int, cell: int, *, occupied: bool) -> None:
        same, opposite = (self._occupied, self._clear) if occupied else (self._clear, self._occupied)
        same[cell] = same.get(cell, 0) | 1 << place
        self._places |= 1 << place
        if cell in opposite:
            opposite[cell] &= ~(1 << place)

    def has_any(self, place: int) -> bool:
        """Return whether the UAV at this place has a sighting."""
        return bool(self._places >> place & 1)

    def forget(self, place: int) -> None:
        if not self.has_any(place):
            return
        for observers in (self._clear, self._occupied):
            for cell in observers:
                observers[cell] &= ~(1 << place)
        self._places ^= 1 << place

    def conflicting_places(self, clear: Iterable[int], occupied: Iterable[int]) -> int:
        """Return the bit mask of the UAVs with the opposite sighting of at least one of these cells."""
        places = 0
        for cells, opposite in ((clear, self._occupied), (occupied, self._clear)):
            if opposite:
                for cell in cells:
                    places |= opposite.get(cell, 0)
        return places

    def conflicting_cells(self, place: int, clear: Iterable[int], occupied: Iterable[int]) -> set[int]:
        """Return the cells of which the UAV at this place has the opposite sighting."""
        pairs = ((clear, self._occupied), (occupied, self._clear))
        return {
            cell
            for cells, opposite in pairs
            if opposite
            for cell in cells
            if opposite.get(cell, 0) >> place & 1
        }
