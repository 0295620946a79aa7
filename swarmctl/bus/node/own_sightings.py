"""How the UAVs of a process saw each cell themselves, by sensors that are taken for perfect. Pure."""

from __future__ import annotations

from collections.abc import Iterable


class Sightings:
    """Each UAV has a place, a bit of each cell's number: what one tells is compared with what all saw."""

    def __init__(self) -> None:
        self._clear: dict[int, int] = {}
        self._occupied: dict[int, int] = {}
        self._places = 0
        """of who has seen anything, bit by bit"""

    def saw(self, place: int, cell: int, *, occupied: bool) -> None:
        now, before = (self._occupied, self._clear) if occupied else (self._clear, self._occupied)
        now[cell] = now.get(cell, 0) | 1 << place
        self._places |= 1 << place
        if cell in before:
            before[cell] &= ~(1 << place)

    def are_of(self, place: int) -> bool:
        """Whether the UAV in this place has seen anything."""
        return bool(self._places >> place & 1)

    def forget(self, place: int) -> None:
        if not self.are_of(place):
            return
        for seen in (self._clear, self._occupied):
            for cell in seen:
                seen[cell] &= ~(1 << place)
        self._places ^= 1 << place

    def against(self, clear: Iterable[int], occupied: Iterable[int]) -> int:
        """Bit i: the UAV in place i saw one of these cells otherwise."""
        places = 0
        for told, seen in ((clear, self._occupied), (occupied, self._clear)):
            if seen:
                for cell in told:
                    places |= seen.get(cell, 0)
        return places

    def otherwise(self, place: int, clear: Iterable[int], occupied: Iterable[int]) -> set[int]:
        """Those of the cells that the UAV in this place saw otherwise."""
        pairs = ((clear, self._occupied), (occupied, self._clear))
        return {cell for told, seen in pairs if seen for cell in told if seen.get(cell, 0) >> place & 1}
