"""A session and a vehicle of the simulator on one virtual clock.

The wire between them loses, doubles and delays.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

import pytest
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.mavlink.events import ProcedureDone
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.codec import Encoder, FrameSplitter, decode
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.session import Session, SessionStep
from swarmctl.mavlink.telemetry.streams import UNUSED_IDS

HOME = (46.049, 14.506)
BOTH = pytest.mark.parametrize("personality", ["ardupilot", "px4"])
"""Run a test on each multicopter."""
ALT_M = 300.0
NO_LOGS = {"ardupilot": {"LOG_BACKEND_TYPE": 0.0}, "px4": {"SDLOG_MODE": -1.0}}
"""Parameters of a vehicle that records no flights; an eighth of a flight's time goes into its log."""


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


def is_partial_list(message: Any) -> bool:
    """Return whether a message writes a part of the list; a copter without answers to it has to hold."""
    return bool(message.get_type() == "MISSION_WRITE_PARTIAL_LIST")


def plan(*, north: int = 5, alt: float = 20.0, east: float = 0.0) -> FlightPlan:
    """Return a plan of `north` waypoints 55 m apart going north, with a landing on the last."""
    return north_of_home(north, 0.0005, alt=alt, east=east)


class FlyingBench:
    STEP_S = 0.05
    UNUSED_EVERY_S: float | None = 1.0
    """Interval of the streams that a session does not use; None: the vehicle's own interval."""

    def __init__(
        self,
        personality: str,
        kind: str = "copter",
        *,
        params: dict[str, float] | None = None,
        ready_s: float = 1.0,
    ) -> None:
        self.session = Session(MavlinkPeer(1))
        self.faults = Faults()
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
        vehicle = {"sysid": 1, "lat_deg": HOME[0], "lon_deg": HOME[1], "alt_amsl_m": ALT_M}
        vehicle |= {"personality": personality, "type": kind, "params": NO_LOGS[personality] | (params or {})}
        self.fleet = Fleet(Scenario.model_validate({"seed": 1, "vehicles": [vehicle]}), ready_s=ready_s)
        self.vehicle = self.fleet.vehicles[0]
        self._other = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)

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
                self._down(frame for _, frame in self.fleet.receive(data, self.now, peer="station"))
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
            self._down(frame for _, frame in self.fleet.step(self.now))
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
        rates = self.vehicle.rates
        for msgid in UNUSED_IDS if self.UNUSED_EVERY_S else ():
            if rates.interval_s(msgid) is not None:
                rates.set(msgid, self.UNUSED_EVERY_S, self.now)
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

    # other stations and faults

    def inject(self, fault: str) -> None:
        """Inject a fault from now on, written as on the simulator's command line."""
        self.fleet.inject(parse_fault(fault), self.now)

    def another_sends(self, message: Any) -> None:
        """Send a message from another ground station; the session receives the answers as well."""
        data = message.pack(self._other)
        self._down(frame for _, frame in self.fleet.receive(data, self.now, peer="other"))

    def another_commands(self, number: int, *params: float) -> None:
        rest = (0.0,) * (7 - len(params))
        self.another_sends(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *rest))

    def another_sets_mode(self, mode: str) -> None:
        self.another_commands(mavlink.MAV_CMD_DO_SET_MODE, *self.session.dialect.mode_params(mode))

    def another_sets(self, **params: float) -> None:
        for name, value in params.items():
            kind = mavlink.MAV_PARAM_TYPE_REAL32
            self.another_sends(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))

    def pilot(self, act: Callable[[Any], object]) -> None:
        """Act on the vehicle without a message, as a pilot's switches do."""
        act(self.vehicle)
        self.vehicle.update(self.now)

    # true state of the vehicle

    @property
    def params(self) -> Any:
        return self.vehicle.params

    @property
    def mode(self) -> str:
        """The vehicle's true mode, by the ground station's name."""
        return self.session.dialect.mode_name(self.vehicle.mode.number)

    @property
    def stored(self) -> tuple[MissionItem, ...]:
        """The mission in the vehicle's memory."""
        mission = self.vehicle.mission
        items = (mission.item(i) for i in range(mission.count))
        return tuple(
            MissionItem(i.command, i.frame, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4)
            for i in items
        )

    def watched_swap(self, new: FlightPlan) -> tuple[basic.Swapped, set[str], set[tuple[int, int] | None]]:
        """Return the result of a swap, the modes during it and the positions aimed at."""
        modes, aims = set(), set()

        def watch() -> bool:
            modes.add(self.mode)
            aims.add(self.aim)
            return self.session.busy_with is None

        self.begin_swap(new)
        assert self.run(300, watch), "the swap does not end"
        return self.result, modes, aims

    def holds(self, items: tuple[MissionItem, ...]) -> bool:
        return bool(items) and self.session.dialect.differences(items, self.stored) == ()

    @property
    def aim(self) -> tuple[int, int] | None:
        """The position (degE7) of the flown item; None without a flown item or without a position."""
        flown = self.vehicle.mission.current_item
        flies = flown is not None and self.mode == self.session.dialect.mission_mode
        return (flown.x, flown.y) if flies and flown.x else None


def on_the_ground(
    personality: str, *, loss: float = 0.0, seed: int = 0, params: dict[str, float] | None = None
) -> FlyingBench:
    """Return a disarmed vehicle on the ground after a second of contact; then the wire has this loss."""
    bench = FlyingBench(personality, params=params, ready_s=0.0).connected()
    bench.run(1.0)
    bench.spoil(Faults(loss=loss, seed=seed))
    return bench
