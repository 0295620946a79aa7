"""Decoding of frames. A process decodes most frames once for all its nodes. No I/O."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import lru_cache

import msgspec

from swarmctl.core.frames import (
    MAX_INNER_BYTES,
    Frame,
    FrameCodec,
    IntentShared,
    MessageRefused,
    RefusalReason,
    StateShared,
)
from swarmctl.core.observation import Checkpoint, Observation, Source, indexed, mark_of

CACHED_FRAMES = 16_384
"""greatest number of cached frames"""
MAX_CACHED_BYTES = 1024
"""size of the longest cached frame; longer frames are not cached, so forged frames do not fill the memory"""


class DecodedFrame(msgspec.Struct, frozen=True, gc=False):
    """A valid frame: well formed, inside the area, and signed if the swarm requires signatures."""

    frame: Frame
    data: bytes
    source: Source
    """sender and incarnation"""
    seq: int = 0
    """sequence number of an observation; 0 in all other frames"""
    clear: frozenset[int] = frozenset()
    """row · cols + col of the cells observed as clear; empty for other frames than observations"""
    occupied: frozenset[int] = frozenset()
    """row · cols + col of the cells observed as occupied"""
    mark: int = 0
    """hash of the observation's source, number and content; 0 in all other frames"""


DecodeFrame = Callable[[bytes], DecodedFrame]
"""decoder of a frame's bytes; raises MessageRefused"""


def frame_decoder(codec: FrameCodec, rows: int, cols: int) -> DecodeFrame:
    """Return a caching decoder of frames about an area of rows × cols cells."""

    def decode(data: bytes) -> DecodedFrame:
        frame = codec.decode(data)
        is_relayable = isinstance(frame.content, Observation | Checkpoint | StateShared | IntentShared)
        if is_relayable and len(data) > MAX_INNER_BYTES:
            raise MessageRefused(
                RefusalReason.OVERSIZE,
                f"{len(data)} bytes; a frame of more than {MAX_INNER_BYTES} bytes cannot be relayed",
            )
        source, content = (frame.sender, frame.incarnation), frame.content
        if isinstance(content, Observation):
            _refuse_repeated_cells(content)
            with _refuse_outside():
                indexed(content, rows, cols)
            clear, occupied = (
                frozenset(row * cols + col for row, col, occupied in content.cells if occupied == is_occupied)
                for is_occupied in (False, True)
            )
            mark = mark_of(content)
            return DecodedFrame(frame, data, source, content.seq, clear, occupied, mark)
        if isinstance(content, Checkpoint):
            with _refuse_outside():
                content.counts(rows * cols)
        return DecodedFrame(frame, data, source)

    cached = lru_cache(maxsize=CACHED_FRAMES)(decode)
    return lambda data: cached(data) if len(data) <= MAX_CACHED_BYTES else decode(data)


@contextlib.contextmanager
def _refuse_outside() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise MessageRefused(RefusalReason.OUTSIDE, str(error)) from None


def _refuse_repeated_cells(seen: Observation) -> None:
    if len({(row, col) for row, col, _ in seen.cells}) < len(seen.cells):
        raise MessageRefused(
            RefusalReason.MALFORMED, f"observation {seen.seq} of vehicle {seen.observer} lists a cell twice"
        )
