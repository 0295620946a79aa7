"""A vehicle for the conformance suite on the virtual clock, and vehicles with altered messages."""

from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.outcomes import Outcome
from sim_vehicle.conformance.registry import Check, select
from sim_vehicle.conformance.runner import RunReport, granted_permissions, run
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario
from sim_vehicle.station.frames import NOISE, Receiver

HOME = (46.0490, 14.5060, 300.0)
GROUND = ("heartbeat", "version", "parameters", "commands", "mission.download")
STEP_S = 0.05
Alteration = Callable[[Any], list[Any]]


class FleetWire:
    """A `Wire` directly into a fleet: waiting advances simulated time, without a socket."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self._now = 0.0
        self._queue = deque(frame for _, frame in fleet.step(0.0))

    def send(self, data: bytes) -> None:
        self._queue.extend(frame for _, frame in self.fleet.receive(data, self._now, peer="conformance"))

    def receive(self, timeout_s: float) -> bytes | None:
        end_s = self._now + timeout_s
        while not self._queue and self._now < end_s:
            self._now = min(self._now + STEP_S, end_s)
            self._queue.extend(frame for _, frame in self.fleet.step(self._now))
        return self._queue.popleft() if self._queue else None

    def now_s(self) -> float:
        return self._now

    def follow(self, sysid: int) -> None:
        """Do nothing: every vehicle receives every message and processes those addressed to it."""

    def close(self) -> None: ...


def fleet(
    personality: str = "ardupilot", kind: str = "copter", *, ready_s: float | None = None, count: int = 1
) -> Fleet:
    scenario = default_scenario(count, home=HOME, seed=1, personality=personality, kind=kind)
    return Fleet(scenario, ready_s=ready_s)


def connected(wire: FleetWire, sysid: int | None = None) -> VehicleUnderTest:
    """Return a station connected to the vehicle behind a wire, with the permissions without options."""
    vehicle = VehicleUnderTest(wire)
    vehicle.permissions = granted_permissions(vehicle.connect(sysid), frozenset(), ground_only=False)
    return vehicle


def store_mission(vehicle: VehicleUnderTest, n_items: int = 6) -> list[plans.PlanItem]:
    """Store a mission on the vehicle and return its items; the suite has no copy of it."""
    vehicle.saved_plans.add(plans.MISSION)
    items = plans.store_sample(vehicle, n_items)
    vehicle.saved_plans.clear()
    return items


def has_mission(vehicle: VehicleUnderTest, items: list[plans.PlanItem]) -> bool:
    vehicle.begin_check()
    return plans.coordinates(vehicle, plans.download(vehicle)) == plans.coordinates(vehicle, items)


def one_check(function: Any, *needs: str) -> Check:
    """Return a check outside of the registry."""
    return Check("parameters.made_up", function, needs=frozenset(needs))


def conform(wire: FleetWire, *patterns: str) -> RunReport:
    """Run the applicable checks on the vehicle behind a wire."""
    return run(connected(wire), select(patterns))


def named(report: RunReport, outcome: Outcome) -> set[str]:
    return {result.check.name for result in report.results if result.outcome is outcome}


def describe_failures(report: RunReport) -> str:
    failed = [r for r in report.results if r.outcome is Outcome.FAILED]
    return "\n".join(f"{result.check.name}: {result.seen}" for result in failed)


def without_simulator_mark(message: Any) -> list[Any]:
    """Hide the mark of the simulator."""
    if message.get_type() == "AUTOPILOT_VERSION":
        message.uid2 = bytes(18)
        message.uid = 7
    return [message]


def selects(kind: str, **fields: Any) -> Callable[[Any], bool]:
    """Return a condition: the message has this type, and these values in its fields."""
    wanted = fields.items()
    return lambda message: (
        message.get_type() == kind and all(getattr(message, name) == value for name, value in wanted)
    )


def acknowledged(message: Any) -> list[Any]:
    """Return the acceptance of a command that the vehicle does not receive."""
    return [mavlink.MAVLink_command_ack_message(message.command, 0, 0, 0, 255, 190)]


class BentWire(FleetWire):
    """A wire that passes the vehicle's messages through `alter`: message in, messages out."""

    def __init__(self, inner: Fleet, alter: Alteration) -> None:
        super().__init__(inner)
        self._alter = alter
        self._receiver = Receiver()
        self.armed_seen = False

    def receive(self, timeout_s: float) -> bytes | None:
        data = super().receive(timeout_s)
        self.armed_seen |= bool(self.fleet.truth().armed[0])
        if data is None:
            return None
        out = b""
        for frame in self._receiver.frames(data, 0.0):
            if frame.kind.startswith((NOISE, "UNKNOWN_")):
                out += frame.raw
                continue
            for altered in self._alter(frame.message):
                codec = mavlink.MAVLink(None, frame.sysid, frame.component)
                codec.seq = frame.seq
                out += bytes(altered.pack(codec))
        return out


class DroppingWire(FleetWire):
    """A wire that drops the messages selected by `ignores` and returns the messages of `answers`."""

    def __init__(
        self, inner: Fleet, ignores: Callable[[Any], bool], answers: Callable[[Any], list[Any]] = lambda _: []
    ) -> None:
        super().__init__(inner)
        self._ignores, self._answers = ignores, answers
        self._receiver = Receiver()
        self._codec = mavlink.MAVLink(None, 1, 1)

    def send(self, data: bytes) -> None:
        for message in self._receiver.messages(data):
            if self._ignores(message):
                self._queue.extend(bytes(answer.pack(self._codec)) for answer in self._answers(message))
                return
        super().send(data)


def failures_with(alter: Alteration, *patterns: str) -> set[str]:
    """Return the checks that fail on a vehicle bent in this way."""
    return named(conform(BentWire(fleet(ready_s=0.0), alter), *patterns), Outcome.FAILED)
