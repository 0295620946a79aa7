"""What vehicles tell of the area: observations, each with a name, and checkpoints that stand for many.

An observer numbers its observations from 1 on. It begins again when its program is started again, under a
greater incarnation number, so that (observer, incarnation, seq) never names two.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

Source = tuple[int, int]
"""(observer, incarnation)"""
MAX_CELLS = 512
"""of one observation"""
MAX_PACKED_BYTES = 40_000
"""of a checkpoint; an observer that has seen more than fits tells its observations one by one"""
MAX_LOOKS = 65_535
"""at a cell, in a checkpoint: all UAVs and their incarnations together stay within 32 bits"""

Id = Annotated[int, msgspec.Meta(ge=1, le=254)]
Incarnation = Annotated[int, msgspec.Meta(ge=0, lt=2**62)]
Seq = Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
Index = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]


class Observation(msgspec.Struct, frozen=True, gc=False, tag="inform/observation"):
    """Cells that one vehicle saw at one moment."""

    observer: Id
    """system id of the vehicle that saw it"""
    seq: Seq
    """counts this observer's observations"""
    time_s: float
    """by the observer's run clock [s]"""
    cells: Annotated[tuple[tuple[Index, Index, bool], ...], msgspec.Meta(max_length=MAX_CELLS)]
    """(row, col, occupied), each cell once"""
    incarnation: Incarnation = 0
    """greater each time the observer's program is started"""

    def __post_init__(self) -> None:
        if not math.isfinite(self.time_s):
            raise ValueError("a time that is no number")

    @property
    def source(self) -> Source:
        return self.observer, self.incarnation

    @property
    def two_contents(self) -> str:
        """What to say where its name came with another content before."""
        return (
            f"observation {self.seq} of vehicle {self.observer} came with two different contents; expected "
            "one observer a system id: look for a second process that flies this vehicle"
        )


@dataclass(frozen=True, slots=True)
class CellCounts:
    """How often which cells were looked at, and how often a hostile was seen there; arrays of one length."""

    cells: NDArray[np.int64]
    """row · cols + col, ascending"""
    looks: NDArray[np.int32]
    hits: NDArray[np.int32]


class Checkpoint(msgspec.Struct, frozen=True, gc=False, tag="inform/checkpoint"):
    """Stands for all observations of one source up to one: memory and snapshots stay small for ever."""

    observer: Id
    incarnation: Incarnation
    upto: Seq
    """the last observation it stands for"""
    packed: Annotated[bytes, msgspec.Meta(max_length=MAX_PACKED_BYTES)]
    """zlib over three arrays of u32, little-endian: steps between the cells, looks, hits"""
    mark: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    """the `mark_of` all observations it stands for, combined by exclusive or: who holds them can tell whether
    they are the same"""

    @property
    def source(self) -> Source:
        return self.observer, self.incarnation

    @property
    def two_contents(self) -> str:
        """What to say where it stands for other observations than have come."""
        return (
            f"a checkpoint of vehicle {self.observer} stands for other observations up to {self.upto} than "
            "those that came; expected one observer a system id: look for a second process that flies it"
        )

    def counts(self, n_cells: int) -> CellCounts:
        """Raises ValueError where it is none for an area of so many cells."""
        return _unpacked(self.packed, n_cells)


BeliefItem = Observation | Checkpoint
_encode = msgspec.msgpack.Encoder().encode
CellBytes = tuple[bytes, bytes]
"""row · cols + col of the cells that were looked at, and of those that hold a hostile, as bytes of `CELL`:
those of many observations are joined in a fraction of the time that arrays take"""
CELL = np.dtype(np.int64)


def checkpoint(
    before: Checkpoint | None, later: Iterable[Observation], cols: int, n_cells: int
) -> Checkpoint | None:
    """One that stands for `before` and for `later`, which follow it without a gap and are not empty.

    None where it would not fit into a message.
    """
    ordered = sorted(later, key=lambda seen: seen.seq)
    looked = [(row * cols + col, 1, int(occupied)) for seen in ordered for row, col, occupied in seen.cells]
    table = np.array(looked, dtype=np.int64).reshape(-1, 3)
    if before is not None:
        counts = before.counts(n_cells)
        table = np.vstack([table, np.stack([counts.cells, counts.looks, counts.hits], axis=1)])
    cells, which = np.unique(table[:, 0], return_inverse=True)
    looks = np.bincount(which, table[:, 1], cells.size)
    hits = np.bincount(which, table[:, 2], cells.size)
    many = looks > MAX_LOOKS
    hits[many] = hits[many] * MAX_LOOKS // looks[many]
    looks[many] = MAX_LOOKS
    packed = zlib.compress(
        np.concatenate([np.diff(cells, prepend=0), looks, hits]).astype("<u4").tobytes(), 1
    )
    last = ordered[-1]
    if len(packed) > MAX_PACKED_BYTES:
        return None
    mark = 0 if before is None else before.mark
    for seen in ordered:
        mark ^= mark_of(seen)
    return Checkpoint(last.observer, last.incarnation, last.seq, packed, mark)


def mark_of(seen: Observation) -> int:
    """63 bits that differ where name or content do."""
    return int.from_bytes(blake2b(_encode(seen), digest_size=8).digest()) >> 1


class IndexedObservation(msgspec.Struct, frozen=True, gc=False):
    """An observation as all beliefs of a process hold it."""

    seen: Observation
    name: tuple[int, int, int]
    """observer, incarnation, sequence number"""
    cells: CellBytes


_named: dict[int, tuple[IndexedObservation, int, int]] = {}
"""By identity, which a held observation keeps: to hash one takes longer than to work its cells out."""
MAX_HELD = 16_384


def indexed(seen: Observation, rows: int, cols: int) -> IndexedObservation:
    """Made once for all UAVs of a process. Raises ValueError where a cell lies outside the area."""
    held = _named.get(id(seen))
    if held is not None and held[0].seen is seen and held[1] == rows and held[2] == cols:
        return held[0]
    for row, col, _ in seen.cells:
        if row >= rows or col >= cols or row < 0 or col < 0:
            raise ValueError(
                f"observation {seen.seq} of vehicle {seen.observer}: cell ({row}, {col}) "
                f"is outside the area of {rows} × {cols} cells; do both fly the same configuration?"
            )
    looked = np.array([row * cols + col for row, col, _ in seen.cells], dtype=CELL).tobytes()
    occupied = np.array([row * cols + col for row, col, here in seen.cells if here], dtype=CELL).tobytes()
    if len(_named) >= MAX_HELD:
        _named.clear()
    made = IndexedObservation(seen, (seen.observer, seen.incarnation, seen.seq), (looked, occupied))
    _named[id(seen)] = made, rows, cols
    return made


@lru_cache(maxsize=128)  # of a large area, half a megabyte each
def _unpacked(packed: bytes, n_cells: int) -> CellCounts:
    unpacker = zlib.decompressobj()
    try:
        # Never more than an area has: a few bytes can unpack to gigabytes.
        raw = unpacker.decompress(packed, 12 * n_cells + 1)
    except zlib.error as error:
        raise ValueError(f"a checkpoint that cannot be unpacked: {error}") from None
    if len(raw) % 12 or len(raw) > 12 * n_cells or not unpacker.eof:
        raise ValueError(f"a checkpoint of {len(raw)} bytes: expected 12 for each of at most {n_cells} cells")
    steps, looks, hits = np.frombuffer(raw, "<u4").astype(np.int64).reshape(3, -1)
    cells = np.cumsum(steps)
    if cells.size and (cells[-1] >= n_cells or (steps[1:] == 0).any()):
        raise ValueError(f"a checkpoint with cells outside the area of {n_cells} cells, or named twice")
    if (hits > looks).any() or (looks < 1).any() or (looks > MAX_LOOKS).any():
        raise ValueError("a checkpoint whose looks and hits cannot be")
    counts = CellCounts(cells, looks.astype(np.int32), hits.astype(np.int32))
    for array in (counts.cells, counts.looks, counts.hits):
        array.flags.writeable = False
    return counts
