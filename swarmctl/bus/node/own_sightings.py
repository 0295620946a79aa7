"""Own observations of the UAVs of a process, by cell. The sensors count as perfect. No I/O."""

from __future__ import annotations

from collections.abc import Iterable


class OwnSightings:
    """Bit masks of UAVs by cell, to compare a reported cell with all sightings at once; bit i is place i."""

    def __init__(self) -> None:
        self._clear: dict[int, int] = {}
        self._occupied: dict[int, int] = {}
        self._places = 0
        """bit mask of the UAVs with at least one sighting"""

    def record(self, place: int, cell: int, *, occupied: bool) -> None:
        now, before = (self._occupied, self._clear) if occupied else (self._clear, self._occupied)
        now[cell] = now.get(cell, 0) | 1 << place
        self._places |= 1 << place
        if cell in before:
            before[cell] &= ~(1 << place)

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
        """Return the bit mask of the UAVs that observed one of these cells otherwise."""
        places = 0
        for cells, contrary in ((clear, self._occupied), (occupied, self._clear)):
            if contrary:
                for cell in cells:
                    places |= contrary.get(cell, 0)
        return places

    def conflicting_cells(self, place: int, clear: Iterable[int], occupied: Iterable[int]) -> set[int]:
        """Return the cells that the UAV at this place observed otherwise."""
        pairs = ((clear, self._occupied), (occupied, self._clear))
        return {
            cell
            for cells, contrary in pairs
            if contrary
            for cell in cells
            if contrary.get(cell, 0) >> place & 1
        }
