"""What a UAV says, as messages: numbered, sealed and counted. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.bus.node.counters import Tally
from swarmctl.bus.node.exchange import Out
from swarmctl.core.frames import MAX_FRAMES, MAX_INNER_BYTES, Content, Frame, Seal, StateShared, act_of
from swarmctl.core.geo import LatLon


class Voice:
    """One UAV's."""

    def __init__(self, uav: int, incarnation: int, seal: Seal, tally: Tally) -> None:
        self.at: LatLon | None = None
        """where it is"""
        self._uav = uav
        self._incarnation = incarnation
        self._seal = seal
        self._tally = tally
        self._n = 0

    def says(self, content: Content, to: tuple[int, ...], unix_s: float) -> Out:
        data = self.frame(content, unix_s)
        act = act_of(content)
        self._tally.sent[act] += len(to)
        self._tally.sent_bytes += len(data) * len(to)
        return Out(to, act, data)

    def frame(self, content: Content, unix_s: float) -> bytes:
        """Its next, to nobody yet."""
        self._n += 1
        lat_deg, lon_deg = (None, None) if self.at is None or isinstance(content, StateShared) else self.at
        frame = Frame(self._uav, self._incarnation, self._n, unix_s, content, lat_deg, lon_deg)
        return self._seal.close(frame)


def in_parts(frames: list[bytes]) -> Iterator[tuple[bytes, ...]]:
    """As many in each as fit into a message; one empty part where there are none."""
    part: list[bytes] = []
    size = 0
    for frame in frames:
        if part and (size + len(frame) > MAX_INNER_BYTES or len(part) == MAX_FRAMES):
            yield tuple(part)
            part, size = [], 0
        part.append(frame)
        size += len(frame) + 8
    yield tuple(part)
