"""Observations of the area, each with a name, and checkpoints that replace many observations.

An observer numbers its observations from 1 on. After a restart the numbers begin again at 1, under a greater
incarnation number. So (observer, incarnation, seq) is the name of one observation.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable
from functools import lru_cache
from hashlib import blake2b
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

Source = tuple[int, int]
"""(observer, incarnation)"""
ObservationId = tuple[int, int, int]
"""(observer, incarnation, seq); for a checkpoint the seq of its last observation"""
MAX_CELLS = 512
"""most cells of one observation"""
MAX_PACKED_BYTES = 40_000
"""longest packed counts [bytes]; observations that would need more are not replaced by a checkpoint"""
MAX_LOOKS = 65_535
"""most looks at a cell in a checkpoint: the sums over all UAVs and incarnations stay within 32 bits"""

Id = Annotated[int, msgspec.Meta(ge=1, le=254)]
Incarnation = Annotated[int, msgspec.Meta(ge=0, lt=2**62)]
Seq = Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
Index = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]


class Observation(msgspec.Struct, frozen=True, gc=False, tag="inform/observation"):
    """The cells that one vehicle saw at one moment."""

    observer: Id
    """system id of the vehicle"""
    seq: Seq
    """running number of the observer's observations"""
    time_s: float
    """observer's run clock [s]"""
    cells: Annotated[tuple[tuple[Index, Index, bool], ...], msgspec.Meta(max_length=MAX_CELLS)]
    """(row, col, occupied)"""
    incarnation: Incarnation = 0
    """number that grows with each start of the observer's program"""

    def __post_init__(self) -> None:
        if not math.isfinite(self.time_s):
            raise ValueError("the time of the observation is not finite")

    @property
    def source(self) -> Source:
        return self.observer, self.incarnation

    @property
    def two_contents(self) -> str:
        """Error text for one name that came with two contents."""
        return (
            f"observation {self.seq} of vehicle {self.observer} came with two different contents; look "
            "for a second process that flies this vehicle [two-contents]"
        )


class CellCounts(msgspec.Struct, frozen=True):
    """Looks at some cells, and looks that showed a hostile; arrays of one length."""

    cells: NDArray[np.int64]
    """row · cols + col, ascending"""
    looks: NDArray[np.int32]
    hits: NDArray[np.int32]


class Checkpoint(msgspec.Struct, frozen=True, gc=False, tag="inform/checkpoint"):
    """Counts that replace all observations of one source up to `upto`, to save memory and bandwidth."""

    observer: Id
    incarnation: Incarnation
    upto: Seq
    """number of the last observation in the counts"""
    packed: Annotated[bytes, msgspec.Meta(max_length=MAX_PACKED_BYTES)]
    """zlib over three arrays of u32, little-endian: steps between the cells, looks, hits"""
    mark: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    """exclusive or of `mark_of` over the replaced observations, for comparison with another UAV's mark"""

    @property
    def source(self) -> Source:
        return self.observer, self.incarnation

    @property
    def two_contents(self) -> str:
        """Error text for a checkpoint that does not match the observations received before."""
        return (
            f"the checkpoint of vehicle {self.observer} up to observation {self.upto} does not match the "
            "observations received; look for a second process that flies this vehicle"
        )

    def counts(self, n_cells: int) -> CellCounts:
        """Return the counts. Raises ValueError for counts that do not fit an area of `n_cells`."""
        return _unpacked(self.packed, n_cells)


BeliefItem = Observation | Checkpoint
_encode = msgspec.msgpack.Encoder().encode
CellBytes = tuple[bytes, bytes]
"""row · cols + col of the cells with a look, and of the cells with a hostile, as bytes of `CELL_INDEX_DTYPE`.
Joining the bytes of many observations is much faster than joining arrays."""
CELL_INDEX_DTYPE = np.dtype(np.int64)


def checkpoint(
    before: Checkpoint | None, later: Iterable[Observation], cols: int, n_cells: int
) -> Checkpoint | None:
    """Return a checkpoint for `before` and `later`; None if the result is too long for a message.

    `later` has at least one observation and follows `before` without a gap.
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
    too_many = looks > MAX_LOOKS
    hits[too_many] = hits[too_many] * MAX_LOOKS // looks[too_many]
    looks[too_many] = MAX_LOOKS
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
    """Return a hash of 63 bits over name and content."""
    return int.from_bytes(blake2b(_encode(seen), digest_size=8).digest()) >> 1


class IndexedObservation(msgspec.Struct, frozen=True, gc=False):
    """An observation with its name and cell indices, shared by all beliefs of a process."""

    seen: Observation
    name: tuple[int, int, int]
    """observer, incarnation, sequence number"""
    cells: CellBytes


_indexed: dict[int, tuple[IndexedObservation, int, int]] = {}
"""Cache by `id` of the observation; the entry keeps the observation alive. Hashing an observation would be
slower than indexing its cells."""
MAX_CACHED_OBSERVATIONS = 16_384
"""number of entries at which the cache is cleared"""


def indexed(seen: Observation, rows: int, cols: int) -> IndexedObservation:
    """Return the indexed observation; all UAVs of a process share one object.

    Raises ValueError if a cell lies outside the area.
    """
    cached = _indexed.get(id(seen))
    if cached is not None and cached[0].seen is seen and cached[1] == rows and cached[2] == cols:
        return cached[0]
    for row, col, _ in seen.cells:
        if row >= rows or col >= cols or row < 0 or col < 0:
            raise ValueError(
                f"observation {seen.seq} of vehicle {seen.observer}: cell ({row}, {col}) "
                f"is outside the area of {rows} × {cols} cells; give all vehicles the same configuration"
            )
    looked = np.array([row * cols + col for row, col, _ in seen.cells], dtype=CELL_INDEX_DTYPE).tobytes()
    occupied = np.array(
        [row * cols + col for row, col, here in seen.cells if here], dtype=CELL_INDEX_DTYPE
    ).tobytes()
    if len(_indexed) >= MAX_CACHED_OBSERVATIONS:
        _indexed.clear()
    item = IndexedObservation(seen, (seen.observer, seen.incarnation, seen.seq), (looked, occupied))
    _indexed[id(seen)] = item, rows, cols
    return item


@lru_cache(maxsize=128)  # 16 bytes for each cell with a look
def _unpacked(packed: bytes, n_cells: int) -> CellCounts:
    unpacker = zlib.decompressobj()
    try:
        # The limit is the size of the area, because a few bytes can unpack to gigabytes.
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
        raise ValueError("a checkpoint with impossible counts: expected 1 ≤ looks ≤ 65535 and hits ≤ looks")
    counts = CellCounts(cells, looks.astype(np.int32), hits.astype(np.int32))
    for array in (counts.cells, counts.looks, counts.hits):
        array.flags.writeable = False
    return counts
