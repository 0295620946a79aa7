"""Frames of a UAV: numbered and signed. No I/O."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.core.frames import (
    MAX_FRAMES,
    MAX_INNER_BYTES,
    Content,
    Frame,
    FrameCodec,
    MemberShared,
    StateShared,
)
from swarmctl.core.geo import LatLon
from swarmctl.core.observation import Observation


class Sender:
    def __init__(self, uav: int, incarnation: int, codec: FrameCodec) -> None:
        self.position: LatLon | None = None
        self._uav = uav
        self._incarnation = incarnation
        self._codec = codec
        self._n = 0

    def frame(self, content: Content, unix_s: float) -> bytes:
        """Return the next frame."""
        self._n += 1
        has_position = isinstance(content, StateShared | MemberShared)
        lat_deg, lon_deg = (None, None) if has_position or self.position is None else self.position
        frame = Frame(self._uav, self._incarnation, self._n, unix_s, content, lat_deg, lon_deg)
        return self._codec.encode(frame)

    def earlier_frame(self, observation: Observation, unix_s: float) -> bytes:
        """Return the frame of an observation of an earlier incarnation; such frames are only passed on."""
        frame = Frame(self._uav, observation.incarnation, observation.seq, unix_s, observation)
        return self._codec.encode(frame)


def split_frames(frames: list[bytes]) -> Iterator[tuple[bytes, ...]]:
    """Yield the frames in parts that each fit into a message; one empty part if `frames` is empty."""
    part: list[bytes] = []
    size = 0
    for frame in frames:
        if part and (size + len(frame) > MAX_INNER_BYTES or len(part) == MAX_FRAMES):
            yield tuple(part)
            part, size = [], 0
        part.append(frame)
        size += len(frame) + 8
    yield tuple(part)
