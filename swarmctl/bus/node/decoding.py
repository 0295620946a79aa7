"""A frame as every node of a process reads it: once, however many of them it goes to. Pure."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import lru_cache

import msgspec

from swarmctl.core.frames import MAX_INNER_BYTES, Frame, IntentShared, Refused, Seal, StateShared, Why
from swarmctl.core.observation import Checkpoint, Observation, Source, mark_of, named

CACHED = 16_384
CACHED_BYTES = 1024
"""Longer frames are read by each who gets them: what strangers send must not fill the memory."""


class Reading(msgspec.Struct, frozen=True, gc=False):
    """A frame that is well formed, signed where it has to be, and of this area."""

    frame: Frame
    act: str
    """act/kind"""
    data: bytes
    source: Source
    """whose, if it tells what was seen"""
    seq: int = 0
    """of an observation, as are the fields below; 0 for all else"""
    clear: frozenset[int] = frozenset()
    """row · cols + col of the cells that were seen so"""
    occupied: frozenset[int] = frozenset()
    mark: int = 0
    """tells it from all others, and from another content under its name"""


Read = Callable[[bytes], Reading]
"""Raises Refused."""


def reader(seal: Seal, rows: int, cols: int) -> Read:
    """Reads frames about an area of so many cells."""

    def read(data: bytes) -> Reading:
        frame = seal.open(data)
        passed_on = isinstance(frame.content, Observation | Checkpoint | StateShared | IntentShared)
        if passed_on and len(data) > MAX_INNER_BYTES:
            raise Refused(Why.OVERSIZE, f"{len(data)} bytes, which nobody could pass on")
        source, content = (frame.sender, frame.incarnation), frame.content
        if isinstance(content, Observation):
            _check_once(content)
            with _outside():
                named(content, rows, cols)
            clear, occupied = (
                frozenset(row * cols + col for row, col, is_so in content.cells if is_so == wanted)
                for wanted in (False, True)
            )
            mark = mark_of(content)
            return Reading(frame, frame.act, data, source, content.seq, clear, occupied, mark)
        if isinstance(content, Checkpoint):
            with _outside():
                content.counts(rows * cols)
        return Reading(frame, frame.act, data, source)

    cached = lru_cache(maxsize=CACHED)(read)
    return lambda data: cached(data) if len(data) <= CACHED_BYTES else read(data)


@contextlib.contextmanager
def _outside() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise Refused(Why.OUTSIDE, str(error)) from None


def _check_once(seen: Observation) -> None:
    if len({(row, col) for row, col, _ in seen.cells}) < len(seen.cells):
        raise Refused(Why.MALFORMED, f"observation {seen.seq} of vehicle {seen.observer}: a cell seen twice")
