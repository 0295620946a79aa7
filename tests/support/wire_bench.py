"""A session and a vehicle on one virtual clock, with a wire between them that loses, doubles and delays.

A subclass has the vehicle: `Bench` a scripted copter, `FlyingBench` a vehicle of the simulator.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

from hypothesis import strategies as st

from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.mavlink.events import ProcedureDone
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.codec import Encoder, FrameSplitter, decode
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.session import Session, SessionStep

HOME = (46.049, 14.506)


@dataclass(frozen=True)
class Faults:
    loss: float = 0.0
    doubling: float = 0.0
    max_delay_s: float = 0.0
    """greatest delay; each datagram has its own, so datagrams may overtake each other"""
    seed: int = 0


wires = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.05, 0.2, 0.4]),
    doubling=st.sampled_from([0.0, 0.1, 0.5]),
    max_delay_s=st.sampled_from([0.0, 0.1, 0.3, 1.5]),
    seed=st.integers(0, 2**16),
)
"""wires from perfect to hardly usable"""


def north_of_home(
    count: int = 5, step_deg: float = 0.001, *, alt: float = 20.0, east: float = 0.0
) -> FlightPlan:
    """Return a plan of waypoints going north, with a landing on the last.

    A step of 0.001° is 111 m.
    """
    points = tuple(Waypoint(HOME[0] + step_deg * i, HOME[1] + east, alt) for i in range(1, count + 1))
    return FlightPlan(alt, points, points[-1])


class WireBench:
    STEP_S = 0.1

    def __init__(self, faults: Faults | None = None) -> None:
        self.session = Session(MavlinkPeer(1))
        self.faults = faults or Faults()
        self.delay_s = 0.0
        """delay of every datagram in each direction"""
        self.now = 0.0
        self.events: list[Any] = []
        self.sent: list[tuple[float, Any]] = []
        """(now, message) of each message from the session"""
        self.block = lambda message: False
        """messages that the wire drops on their way to the vehicle"""
        self.block_down = lambda message: False
        self.on_datagram = lambda data: None
        """callback for every datagram from the vehicle"""
        self.silent = False
        self.outages: list[tuple[float, float]] = []
        """(from, until) of outages; the wire drops every datagram"""
        self.stalls: list[tuple[float, float]] = []
        """(from, until) of stalls: the ground station does nothing, and what arrives waits in its inbox"""
        self._inbox: list[bytes] = []
        self._rng = random.Random(self.faults.seed)
        self._encoder = Encoder()
        self._queue: list[tuple[float, int, bool, bytes]] = []
        self._n = 0
        self._delivers = False

    # the vehicle

    def vehicle_receives(self, data: bytes) -> Iterable[bytes]:
        """Return the vehicle's answers, a datagram each."""
        raise NotImplementedError

    def vehicle_steps(self) -> Iterable[bytes]:
        """Return the datagrams that the vehicle has sent by itself, up to now."""
        raise NotImplementedError

    # the wire

    def spoil(self, faults: Faults, *outages: tuple[float, float]) -> None:
        """Apply the faults from now on; outages count from now."""
        self.faults = faults
        self.outages = [(self.now + begin, self.now + end) for begin, end in outages]
        self._rng.seed(faults.seed)

    def heal(self) -> None:
        self.faults, self.outages = Faults(), []

    def _post(self, data: bytes, up: bool) -> None:
        f, rng = self.faults, self._rng
        if self.silent or any(begin <= self.now < end for begin, end in self.outages):
            return
        for _ in range(2 if rng.random() < f.doubling else 1):
            if rng.random() >= f.loss:
                self._n += 1
                arrives_s = self.now + self.delay_s + rng.random() * f.max_delay_s
                heapq.heappush(self._queue, (arrives_s, self._n, up, data))

    def take(self, step: SessionStep) -> None:
        """Keep the events of one input to the session, and send its messages."""
        self.events += step.events
        for message in step.messages:
            self.sent.append((self.now, message))
            data = self._encoder.pack(message, 0)
            if not self.block(message):
                self._post(data, True)
        self._deliver()

    def _deliver(self) -> None:
        if self._delivers:
            return  # answers join the queue
        self._delivers = True
        while self._queue and self._queue[0][0] <= self.now:
            _, _, up, data = heapq.heappop(self._queue)
            if up:
                self._down(self.vehicle_receives(data))
            elif self.is_stalled or self._inbox:
                self._inbox.append(data)
            else:
                self._hear(data)
        self._delivers = False

    @property
    def is_stalled(self) -> bool:
        return any(begin <= self.now < end for begin, end in self.stalls)

    def _empty_inbox(self) -> None:
        while self._inbox:
            self._hear(self._inbox.pop(0))

    def _hear(self, data: bytes) -> None:
        self.on_datagram(data)
        for frame in FrameSplitter().feed(data):
            message = decode(frame)
            if message is not None and not self.block_down(message):
                self.take(self.session.receive(message, self.now))

    def _down(self, frames: Iterable[bytes]) -> None:
        for data in frames:
            self._post(data, False)

    def of(self, kind: str) -> list[Any]:
        """Return the messages of one type that the session has sent."""
        return [m for _, m in self.sent if m.get_type() == kind]

    @property
    def commands(self) -> list[int]:
        """Return the MAV_CMDs that the session has sent, in order."""
        return [m.command for m in self.of("COMMAND_LONG")]

    # time

    def run(self, seconds: float, until: Any = lambda: False) -> bool:
        """Let time pass; return True as soon as `until()` holds."""
        end = self.now + seconds
        while self.now < end:
            if until():
                return True
            self.now += self.STEP_S
            self._down(self.vehicle_steps())
            if self.is_stalled:
                self._deliver()
                continue
            self._empty_inbox()
            self.take(self.session.tick(self.now))
        return bool(until())

    def begin(self, name: str, procedure: Any) -> None:
        self.take(self.session.begin(name, procedure, self.now))

    def do(self, name: str, procedure: Any, limit_s: float = 400.0) -> Any:
        """Run a procedure to its end."""
        self.begin(name, procedure)
        assert self.run(limit_s, lambda: self.session.busy_with is None), f"{name} does not end"
        return self.result

    @property
    def result(self) -> Any:
        """The result of the last procedure."""
        return next(e.result for e in reversed(self.events) if isinstance(e, ProcedureDone))

    def upload(self, plan: FlightPlan) -> basic.Uploaded:
        return self.upload_items(self.session.mission_items(plan))

    def upload_items(self, items: tuple[MissionItem, ...]) -> basic.Uploaded:
        return self.do("upload", lambda c: basic.upload(c, items))

    def swap(self, new: FlightPlan) -> basic.Swapped:
        return self.do("swap", lambda c: basic.swap(c, new))

    def begin_swap(self, new: FlightPlan) -> None:
        self.begin("swap", lambda c: basic.swap(c, new))

    # stories

    def connected(self) -> Self:
        assert self.run(60, lambda: self.session.state.mode != ""), "no heartbeat was received"
        self.take(self.session.keep_streams(self.now))
        return self

    def prepared(self) -> Self:
        self.connected()
        assert self.do("prepare", basic.prepare).failure is None
        return self

    def uploaded(self, first: FlightPlan) -> Self:
        self.prepared()
        assert self.upload(first).failure is None
        return self

    def flying(self, first: FlightPlan) -> Self:
        """Return the bench with the vehicle in flight to the second waypoint of `first`."""
        self.uploaded(first)
        assert self.do("launch", basic.launch).failure is None
        second = self.session.dialect.first_waypoint_seq + 1
        assert self.run(120, lambda: self.session.state.mission_seq == second)
        return self
