"""A pool of objects that searches keep for the next search, shared by threads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")


class Pool(Generic[T]):
    """Objects for one thread at a time: a thread takes objects out, and puts them back after use.

    Each operation on the list is atomic in the interpreter.
    """

    def __init__(self) -> None:
        self._objects: list[T] = []

    def take_all(self) -> list[T]:
        """Remove and return all objects, the oldest first."""
        taken: list[T] = []
        while True:
            try:
                taken.append(self._objects.pop(0))
            except IndexError:
                return taken

    def put(self, objects: Iterable[T], size: Callable[[T], int], max_total: int) -> None:
        """Put objects back; drop the oldest, but never the newest, while all exceed the size `max_total`."""
        self._objects.extend(list(objects))
        while sum(map(size, kept := self._objects.copy())) > max_total and len(kept) > 1:
            with contextlib.suppress(IndexError):
                self._objects.pop(0)
