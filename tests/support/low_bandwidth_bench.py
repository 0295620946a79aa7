"""A simulated vehicle behind a radio of low bandwidth, whose buffer overflows."""

from __future__ import annotations

import heapq
from itertools import count

from flying_bench import HOME, FlyingBench
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.session import Session
from swarmctl.mavlink.telemetry.streams import Streaming

FRAME = LocalFrame(*HOME)


def route(*points: tuple[float, float], leaves_ahead: bool = False) -> FlightPlan:
    """Return a plan over points (east, north) of home [m], with a landing at the last."""
    track = tuple(Waypoint(*FRAME.to_geodetic(*point), 20.0) for point in points)
    return FlightPlan(20.0, track, track[-1], leaves_ahead=leaves_ahead)


class LowBandwidthBench(FlyingBench):
    """A radio with `rate_bytes_s` each way; a datagram that would wait longer than `BUFFER_S` is lost."""

    BUFFER_S = 1.0
    AIR_S = 0.02
    UNUSED_EVERY_S = None

    def __init__(self, personality: str, rate_bytes_s: float, streaming: Streaming | None = None) -> None:
        super().__init__(personality)
        self.session = Session(MavlinkPeer(1), streaming=streaming)
        self.down: list[tuple[float, bytes]] = []
        """time of arrival [s], and the datagram"""
        self.n_lost = 0
        self.rate_bytes_s = rate_bytes_s
        self._free_s = {True: 0.0, False: 0.0}
        self._numbers = count()

    def _post(self, data: bytes, up: bool) -> None:
        begin_s = max(self._free_s[up], self.now)
        if begin_s - self.now > self.BUFFER_S:
            self.n_lost += 1
            return
        self._free_s[up] = begin_s + len(data) / self.rate_bytes_s
        there_s = self._free_s[up] + self.AIR_S
        if not up:
            self.down.append((there_s, data))
        heapq.heappush(self._queue, (there_s, next(self._numbers), up, data))

    def another_streams(self, *ids: int, every_s: float = 0.25) -> None:
        """Request streams for another station, over the same radio."""
        for msgid in ids:
            order = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            wanted = (float(msgid), 1e6 * every_s, 0.0, 0.0, 0.0, 0.0, 0.0)
            self.another_sends(mavlink.MAVLink_command_long_message(1, 1, order, 0, *wanted))

    def bytes_s(self, over_s: float) -> float:
        """Return the vehicle's average data rate over the last `over_s` seconds [bytes/s]."""
        return sum(len(data) for at_s, data in self.down if at_s > self.now - over_s) / over_s
