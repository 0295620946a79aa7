"""A session and a simulated vehicle that flies, on one virtual clock, over a wire that loses and delays."""

from __future__ import annotations

import heapq
import random
from typing import Any

from bench import Faults

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenario import Scenario
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.mavlink import procedures
from swarmctl.mavlink.codec import Decoder, Encoder, FrameSplitter
from swarmctl.mavlink.conversation import Peer
from swarmctl.mavlink.session import Session

STEP_S = 0.05
HOME = (46.049, 14.506)
ALT_M = 300.0


def plan(*, north: int = 5, alt: float = 20.0, east: float = 0.0) -> FlightPlan:
    """`north` waypoints 55 m apart going north, then a landing on the last one."""
    points = tuple(Waypoint(HOME[0] + 0.0005 * i, HOME[1] + east, alt) for i in range(1, north + 1))
    return FlightPlan(alt, points, points[-1])


class FlyingBench:
    def __init__(self, personality: str, kind: str = "copter") -> None:
        vehicle = {"sysid": 1, "lat_deg": HOME[0], "lon_deg": HOME[1], "alt_amsl_m": ALT_M}
        vehicle |= {"personality": personality, "type": kind}
        self.fleet = Fleet(Scenario.model_validate({"seed": 1, "vehicles": [vehicle]}), ready_s=1.0)
        self.vehicle = self.fleet.vehicles[0]
        self.session = Session(Peer(1))
        self.faults = Faults()
        self.now = 0.0
        self.events: list[Any] = []
        self.sent: list[Any] = []
        """(now, message) of everything the session has sent"""
        self.block = lambda message: False
        """what the wire swallows on the way to the vehicle"""
        self.block_down = lambda message: False
        self.outages: list[tuple[float, float]] = []
        """(from, until) in which nothing gets through"""
        self._rng = random.Random(0)
        self._encoder, self._decoder = Encoder(), Decoder()
        self._queue: list[tuple[float, int, bool, bytes]] = []
        self._n = 0
        self._delivers = False

    def inject(self, fault: str) -> None:
        """As on the simulator's command line, from now on."""
        self.fleet.inject(parse_fault(fault), self.now)

    # the wire

    def spoil(self, faults: Faults, *outages: tuple[float, float]) -> None:
        """From now on; outages count from now."""
        self.faults = faults
        self.outages = [(self.now + begin, self.now + end) for begin, end in outages]
        self._rng.seed(faults.seed)

    def heal(self) -> None:
        self.faults, self.outages = Faults(), []

    def _post(self, data: bytes, up: bool) -> None:
        f, rng = self.faults, self._rng
        if any(begin <= self.now < end for begin, end in self.outages):
            return
        for _ in range(2 if rng.random() < f.doubling else 1):
            if rng.random() >= f.loss:
                self._n += 1
                heapq.heappush(self._queue, (self.now + rng.random() * f.max_delay_s, self._n, up, data))

    def take(self, step: Any) -> None:
        self.events += step.events
        for message in step.messages:
            self.sent.append((self.now, message))
            data = self._encoder.pack(message, 0)
            if not self.block(message):
                self._post(data, True)
        self._deliver()

    def _deliver(self) -> None:
        if self._delivers:
            return  # what is answered joins the queue
        self._delivers = True
        while self._queue and self._queue[0][0] <= self.now:
            _, _, up, data = heapq.heappop(self._queue)
            if up:
                self._down(self.fleet.receive(data, self.now, peer="station"))
            else:
                self._hear(data)
        self._delivers = False

    def _hear(self, data: bytes) -> None:
        for frame in FrameSplitter().feed(data):
            message = self._decoder.decode(frame)
            if message is not None and not self.block_down(message):
                self.take(self.session.receive(message, self.now))

    def _down(self, frames: Any) -> None:
        for _, data in frames:
            self._post(data, False)

    # time

    def run(self, seconds: float, until: Any = lambda: False) -> bool:
        """Let time pass; True as soon as `until()` holds."""
        end = self.now + seconds
        while self.now < end:
            if until():
                return True
            self.now += STEP_S
            self._down(self.fleet.step(self.now))
            self.take(self.session.tick(self.now))
        return bool(until())

    def begin(self, name: str, procedure: Any) -> None:
        self.take(self.session.begin(name, procedure, self.now))

    def do(self, name: str, procedure: Any, limit_s: float = 400.0) -> Any:
        """Run a procedure to its end."""
        self.begin(name, procedure)
        assert self.run(limit_s, lambda: self.session.busy_with is None), f"{name} does not end"
        return self.session.result

    def swap(self, new: FlightPlan) -> procedures.Swapped:
        items = self.session.mission_items(new)
        return self.do("swap", lambda c: procedures.swap(c, items))

    # stories

    def prepared(self) -> FlyingBench:
        assert self.run(60, lambda: self.session.state.mode != "")
        self.take(self.session.keep_streams(self.now))
        assert self.do("prepare", procedures.prepare).failure is None
        return self

    def uploaded(self, first: FlightPlan) -> FlyingBench:
        self.prepared()
        items = self.session.mission_items(first)
        assert self.do("upload", lambda c: procedures.upload(c, items)).failure is None
        return self

    def flying(self, first: FlightPlan) -> FlyingBench:
        """In the air, on its way to the second waypoint of `first`."""
        self.uploaded(first)
        assert self.do("launch", procedures.launch).failure is None
        second = self.session.dialect.first_waypoint_seq + 1
        assert self.run(120, lambda: self.session.state.mission_seq == second)
        return self

    # what is true

    @property
    def mode(self) -> str:
        """As the ground station names it, but by the vehicle itself."""
        return self.session.dialect.mode_name(self.vehicle.mode.number)

    @property
    def stored(self) -> tuple[MissionItem, ...]:
        """The mission by the vehicle's own memory."""
        mission = self.vehicle.mission
        items = (mission.item(i) for i in range(mission.count))
        return tuple(
            MissionItem(i.command, i.frame, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4)
            for i in items
        )

    def holds(self, what: tuple[MissionItem, ...]) -> bool:
        return bool(what) and self.session.dialect.differences(what, self.stored) == ()

    @property
    def aim(self) -> tuple[int, int] | None:
        """The place (degE7) of the item that it flies; None where it flies none, or one without a place."""
        flown = self.vehicle.mission.flown
        flies = flown is not None and self.mode == self.session.dialect.mission_mode
        return (flown.x, flown.y) if flies and flown.x else None
