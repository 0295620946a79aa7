"""A session and a scripted copter on one virtual clock, with a wire that loses, doubles and delays."""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass

from scripted_copter import Copter, Script

from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.mavlink import procedures
from swarmctl.mavlink.codec import Decoder, Encoder, FrameSplitter
from swarmctl.mavlink.conversation import Peer
from swarmctl.mavlink.session import Session

STEP_S = 0.1


@dataclass(frozen=True)
class Faults:
    loss: float = 0.0
    doubling: float = 0.0
    max_delay_s: float = 0.0
    """drawn for each datagram, so they overtake each other"""
    seed: int = 0


def plan(*, north: int = 5, alt: float = 20.0, east: float = 0.0) -> FlightPlan:
    """`north` waypoints 111 m apart going north, then a landing on the last one."""
    points = tuple(Waypoint(46.049 + 0.001 * i, 14.506 + east, alt) for i in range(1, north + 1))
    return FlightPlan(alt, points, points[-1])


class Bench:
    def __init__(self, script: Script | None = None, faults: Faults | None = None) -> None:
        self.copter = Copter(1, script or Script())
        self.session = Session(Peer(1))
        self.faults = faults or Faults()
        self.now = 0.0
        self.events: list = []
        self.sent: list = []
        """(now, message) of everything the session has sent"""
        self.block = lambda message: False
        """what the wire swallows on the way to the vehicle"""
        self.block_down = lambda message: False
        self.silent = False
        self._rng = random.Random(self.faults.seed)
        self._encoder, self._decoder = Encoder(), Decoder()
        self._queue: list[tuple[float, int, bool, bytes]] = []
        self._n = 0

    # the wire

    def _post(self, data: bytes, up: bool) -> None:
        f, rng = self.faults, self._rng
        if self.silent:
            return
        for _ in range(2 if rng.random() < f.doubling else 1):
            if rng.random() >= f.loss:
                self._n += 1
                heapq.heappush(self._queue, (self.now + rng.random() * f.max_delay_s, self._n, up, data))

    def take(self, step) -> None:
        self.events += step.events
        for message in step.messages:
            self.sent.append((self.now, message))
            data = self._encoder.pack(message, 0)
            if not self.block(message):
                self._post(data, True)
        self._deliver()

    def _deliver(self) -> None:
        while self._queue and self._queue[0][0] <= self.now:
            _, _, up, data = heapq.heappop(self._queue)
            if up:
                self._down(self.copter.receive(data, self.now))
            else:
                for frame in FrameSplitter().feed(data):
                    message = self._decoder.decode(frame)
                    if not self.block_down(message):
                        self.take(self.session.receive(message, self.now))

    def _down(self, frames: list[bytes]) -> None:
        for data in frames:
            self._post(data, False)

    # time

    def run(self, seconds: float, until=lambda: False) -> bool:
        """Let time pass; True as soon as `until()` holds."""
        end = self.now + seconds
        while self.now < end:
            if until():
                return True
            self.now += STEP_S
            self._down(self.copter.step(self.now))
            self.take(self.session.tick(self.now))
        return until()

    def do(self, name: str, procedure, limit_s: float = 400.0):
        """Run a procedure to its end."""
        self.take(self.session.begin(name, procedure, self.now))
        assert self.run(limit_s, lambda: self.session.busy_with is None), f"{name} does not end"
        return self.session.result

    def items(self, plan: FlightPlan):
        return self.session.dialect.mission_items(plan)

    # stories

    def connected(self) -> Bench:
        assert self.run(60, lambda: self.session.state.mode != "")
        self.take(self.session.keep_streams(self.now))
        return self

    def prepared(self) -> Bench:
        self.connected()
        assert self.do("prepare", procedures.prepare).failure is None
        return self

    def flying(self, first: FlightPlan) -> Bench:
        """In the air, on its way to the second waypoint of `first`."""
        self.prepared()
        assert self.do("upload", lambda c: procedures.upload(c, self.items(first))).failure is None
        assert self.do("launch", procedures.launch).failure is None
        assert self.run(90, lambda: self.copter.seq >= 3 and self.session.state.mission_seq == 3)
        return self

    def mission_is(self, plan: FlightPlan) -> bool:
        """Exactly this plan is on the vehicle, by its own memory; item 0 aside."""
        return [m[:5] for m in self.copter.mission][1:] == self._stored(plan)[1:]

    def flies(self, plan: FlightPlan, *, behind: FlightPlan | None = None) -> bool:
        """Its list has this whole plan, alone or `behind` another one, and its current item is of it."""
        before = self._stored(plan)[:2] if behind is None else self._stored(behind)
        begin, tail = len(before), self._stored(plan)[2:]
        held = [m[:5] for m in self.copter.mission]
        own = range(0 if behind is None else begin, begin + len(tail))
        return held[1:begin] == before[1:] and held[begin : own.stop] == tail and self.copter.seq in own

    def _stored(self, plan: FlightPlan) -> list[tuple]:
        return [(i.command, i.frame, i.x, i.y, int(i.z * 100) / 100) for i in self.items(plan)]
