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
        at = range(self._n)[index]
        return self._items[at] if isinstance(at, int) else [self._items[i] for i in at]


class Steps(Generic[T]):
    """A value that changes now and then; `first` holds before the first change."""

    __slots__ = ("times_s", "values")

    def __init__(self, first: T) -> None:
        self.times_s = array("d", [-math.inf])
        self.values = [first]

    def add(self, time_s: float, value: T) -> None:
        """Add a value, unless it equals the last one."""
        if self.last != value:
            self.times_s.append(time_s)
            self.values.append(value)

    @property
    def last(self) -> T:
        return self.values[-1]

    def at(self, time_s: float) -> T:
        return self.values[bisect_right(self.times_s, time_s) - 1]


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

    def at(self, time_s: float) -> T | None:
        """Return the last item up to a time; None before the first."""
        n = bisect_right(self.times_s, time_s)
        return self.items[n - 1] if n else None


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
