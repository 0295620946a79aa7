"""Values with the times from which on they hold, for a look at any time. Pure.

Each history only grows, in order of time. A value at a time is a bisection, so a timeline needs no keyframes.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar, overload

T = TypeVar("T")
KEPT_SECONDS = 8
"""number of different seconds whose values are kept: browsers may look at different times"""


class Grown(Sequence[T], Generic[T]):
    """The first `n` items of a list that only grows; nothing is copied."""

    __slots__ = ("_items", "_n")

    def __init__(self, items: list[T], n: int) -> None:
        self._items = items
        self._n = n

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        if isinstance(index, slice):
            return [self._items[i] for i in range(*index.indices(self._n))]
        if not -self._n <= index < self._n:
            raise IndexError(index)
        return self._items[index if index >= 0 else self._n + index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    def continues(self, other: Sequence[T]) -> bool:
        """Return whether this sequence begins with `other`, an earlier look at the same list."""
        return isinstance(other, Grown) and other._items is self._items and other._n <= self._n


class Steps(Generic[T]):
    """A value that changes now and then."""

    __slots__ = ("times_s", "values")

    def __init__(self) -> None:
        self.times_s = array("d")
        self.values: list[T] = []

    def add(self, time_s: float, value: T) -> None:
        """Add a value, unless it equals the last one."""
        if not self.values or self.values[-1] != value:
            self.times_s.append(time_s)
            self.values.append(value)

    @property
    def last(self) -> T | None:
        return self.values[-1] if self.values else None

    def at(self, time_s: float) -> T | None:
        """Return the value at a time; None before the first."""
        n = bisect_right(self.times_s, time_s)
        return self.values[n - 1] if n else None


class Items(Generic[T]):
    """A list whose items each have a time."""

    __slots__ = ("items", "times_s")

    def __init__(self) -> None:
        self.times_s = array("d")
        self.items: list[T] = []

    def add(self, time_s: float, item: T) -> None:
        self.times_s.append(time_s)
        self.items.append(item)

    def until(self, time_s: float) -> Grown[T]:
        return Grown(self.items, bisect_right(self.times_s, time_s))


class Rows:
    """Rows of numbers, packed; NaN for an unknown number."""

    __slots__ = ("_width", "numbers", "times_s")

    def __init__(self, width: int) -> None:
        self.times_s = array("d")
        self.numbers = array("d")
        self._width = width

    def add(self, time_s: float, row: Sequence[float | None]) -> None:
        self.times_s.append(time_s)
        self.numbers.extend([math.nan if number is None else number for number in row])

    def at(self, time_s: float) -> list[float | None] | None:
        """Return the last row up to a time, with None for unknown numbers; None before the first row."""
        n = bisect_right(self.times_s, time_s)
        return self.row(n - 1) if n else None

    def row(self, index: int) -> list[float | None]:
        at = index * self._width
        return [None if math.isnan(x) else x for x in self.numbers[at : at + self._width]]

    @property
    def last(self) -> list[float | None] | None:
        return self.row(len(self.times_s) - 1) if self.times_s else None


class EachSecond(Generic[T]):
    """A value that is computed for the begin of each second, and kept for the seconds asked for last."""

    __slots__ = ("_compute", "_kept")

    def __init__(self, compute: Callable[[float], T]) -> None:
        self._compute = compute
        self._kept: dict[object, T] = {}

    def at(self, time_s: float, end_s: float, version: int) -> T:
        """Return the value at the begin of the second of `time_s`.

        `end_s` is the time of the newest data, and `version` their number. Later data come after `end_s`.
        """
        begin_s = float(math.floor(time_s))
        key = begin_s, (None if begin_s < end_s else version)
        if key not in self._kept:
            while len(self._kept) >= KEPT_SECONDS:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._compute(begin_s)
        return self._kept[key]


def last_before(times_s: Sequence[float], time_s: float) -> float | None:
    """Return the last of ascending times up to `time_s`; None if there is none."""
    n = bisect_right(times_s, time_s)
    return times_s[n - 1] if n else None
