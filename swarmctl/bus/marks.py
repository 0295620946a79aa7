"""Numbers that tell which observations of a source are held: equal for all who hold the same. Pure."""

from __future__ import annotations

from functools import lru_cache

from swarmctl.core.observation import Source


@lru_cache(maxsize=4096)
def mark_of(source: Source, upto: int) -> int:
    """All from the first to `upto`; 63 bits. Worked out once for all UAVs of a process."""
    return mixed(mixed(mixed(0, source[0]), source[1]), upto)


def mixed(mark: int, number: int) -> int:
    """The steps of splitmix64."""
    mark = (mark ^ number) * 0xBF58476D1CE4E5B9 & 0xFFFFFFFFFFFFFFFF
    mark = (mark ^ mark >> 27) * 0x94D049BB133111EB & 0xFFFFFFFFFFFFFFFF
    return (mark ^ mark >> 31) >> 1
