"""What searches keep for the next one, so that threads that plan at once do not meet in it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

Kept = TypeVar("Kept")


class Shelf(Generic[Kept]):
    """Who uses something takes it out and puts it back afterwards. Each step is one operation of a list,
    which the interpreter does not interrupt.
    """

    def __init__(self) -> None:
        self._things: list[Kept] = []

    def take_all(self) -> list[Kept]:
        """Everything that nobody else has taken, the oldest first."""
        taken: list[Kept] = []
        while True:
            try:
                taken.append(self._things.pop(0))
            except IndexError:
                return taken

    def put(self, things: Iterable[Kept], size: Callable[[Kept], int], most: int) -> None:
        """Puts things back, the oldest first; the oldest go where together they are larger than `most`."""
        self._things.extend(list(things))
        while sum(map(size, kept := self._things.copy())) > most and len(kept) > 1:
            with contextlib.suppress(IndexError):
                self._things.pop(0)
