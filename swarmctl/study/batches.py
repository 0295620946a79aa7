"""Batches: the missions that are left, in portions of about one second of work. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import msgspec

BATCH_S = 1.0
FIRST_SIZE = 4
GREATEST_GROWTH = 8


class Batch(msgspec.Struct, frozen=True):
    """Missions of one level, which one worker computes in one go."""

    level: int
    seeds: range


def missing(wanted: range, done: Iterable[range]) -> list[range]:
    """Return the parts of `wanted` that no range of `done` has, in order."""
    left: list[range] = []
    start = wanted.start
    for part in sorted(done, key=lambda part: part.start):
        if start < min(part.start, wanted.stop):
            left.append(range(start, min(part.start, wanted.stop)))
        start = max(start, part.stop)
    if start < wanted.stop:
        left.append(range(start, wanted.stop))
    return left


class BatchQueue(Iterator[Batch]):
    """The batches that are left. The durations of finished batches decide the size of the next ones."""

    def __init__(self, left: Mapping[int, Iterable[range]]) -> None:
        self._left = {level: [part for part in parts if part] for level, parts in left.items()}
        self._n_left = {level: sum(map(len, parts)) for level, parts in self._left.items()}
        self._size: dict[int, int] = {}

    @property
    def n_left(self) -> int:
        """The number of missions in no batch yet."""
        return sum(self._n_left.values())

    def __next__(self) -> Batch:
        """Return a batch of the level with the most missions left, so that all levels end together."""
        level = max(self._n_left, key=lambda level: self._n_left[level], default=None)
        if level is None or self._n_left[level] == 0:
            raise StopIteration
        part = self._left[level][0]
        seeds, rest = (part[: self._size.get(level, FIRST_SIZE)], part[self._size.get(level, FIRST_SIZE) :])
        self._left[level][:1] = [rest] if rest else []
        self._n_left[level] -= len(seeds)
        return Batch(level, seeds)

    def note_duration(self, batch: Batch, seconds: float) -> None:
        """Choose the size of the level's next batches by the duration of a finished one."""
        size = int(BATCH_S / max(seconds / len(batch.seeds), 1e-9))
        self._size[batch.level] = max(1, min(size, GREATEST_GROWTH * len(batch.seeds)))
