"""Outgoing messages of a UAV: numbered, signed and counted. No I/O."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.bus.node.exchange import NetworkCounters, OutgoingMessage
from swarmctl.core.frames import (
    MAX_FRAMES,
    MAX_INNER_BYTES,
    Content,
    Frame,
    FrameCodec,
    MemberShared,
    StateShared,
    act_of,
)
from swarmctl.core.geo import LatLon
from swarmctl.core.observation import Observation


class Sender:
    def __init__(self, uav: int, incarnation: int, codec: FrameCodec, counters: NetworkCounters) -> None:
        self.position: LatLon | None = None
        self._uav = uav
        self._incarnation = incarnation
        self._codec = codec
        self._counters = counters
        self._n = 0

    def message(self, content: Content, to: tuple[int, ...], unix_s: float) -> OutgoingMessage:
        """Return the next message, counted as sent to each receiver."""
        data = self.frame(content, unix_s)
        act = act_of(content)
        self._counters.sent[act] += len(to)
        self._counters.sent_bytes += len(data) * len(to)
        return OutgoingMessage(to, act, data)

    def frame(self, content: Content, unix_s: float) -> bytes:
        """Return the next numbered and signed frame, which is not counted as sent."""
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
