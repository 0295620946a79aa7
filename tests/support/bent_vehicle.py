"""A vehicle for the conformance suite on the virtual clock, and one that is bent on its way out."""

from collections.abc import Callable, Collection
from typing import Any

from fleet_wire import FleetWire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import select
from sim_vehicle.conformance.runner import Outcome, Report, permissions, run
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario

HOME = (46.0490, 14.5060, 300.0)
GROUND = ("heartbeat", "version", "parameters", "commands", "mission.download")
Bend = Callable[[Any], list[Any]]


def fleet(
    personality: str = "ardupilot", kind: str = "copter", *, ready_s: float | None = None, count: int = 1
) -> Fleet:
    scenario = default_scenario(count, home=HOME, seed=1, personality=personality, kind=kind)
    return Fleet(scenario, ready_s=ready_s)


def met(wire: FleetWire, *, allow: Collection[str] = (), sysid: int | None = None) -> Peer:
    """A station that has met the vehicle behind a wire and has its permissions."""
    peer = Peer(wire)
    peer.permits = set(permissions(peer.meet(sysid), frozenset(allow), ground_only=False))
    return peer


def conform(wire: FleetWire, *patterns: str, allow: Collection[str] = ()) -> Report:
    """The checks that fit, on the vehicle behind a wire."""
    return run(met(wire, allow=allow), select(patterns))


def named(report: Report, outcome: Outcome) -> set[str]:
    return {result.check.name for result in report.results if result.outcome is outcome}


def told(report: Report) -> str:
    failed = [r for r in report.results if r.outcome is Outcome.FAILED]
    return "\n".join(f"{result.check.name}: {result.seen}" for result in failed)


class BentWire(FleetWire):
    """What the vehicle sends goes through `bend`: message in, messages out."""

    def __init__(self, inner: Fleet, bend: Bend) -> None:
        super().__init__(inner)
        self._bend = bend
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.armed_seen = False

    def receive(self, timeout_s: float) -> bytes | None:
        data = super().receive(timeout_s)
        self.armed_seen |= bool(self.fleet.truth().armed[0])
        if data is None:
            return None
        out = b""
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN_"):
                out += bytes(message.get_msgbuf())
                continue
            for bent in self._bend(message):
                codec = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
                codec.seq = message.get_seq()
                out += bytes(bent.pack(codec))
        return out


class Obstinate(FleetWire):
    """The vehicle does not get the messages that `ignores`; `answers` answers them in its place."""

    def __init__(
        self, inner: Fleet, ignores: Callable[[Any], bool], answers: Callable[[Any], list[Any]] = lambda _: []
    ) -> None:
        super().__init__(inner)
        self._ignores, self._answers = ignores, answers
        self._heard = mavlink.MAVLink(None)
        self._heard.robust_parsing = True
        self._codec = mavlink.MAVLink(None, 1, 1)

    def send(self, data: bytes) -> None:
        for message in self._heard.parse_buffer(data) or ():
            if message.get_type() != "BAD_DATA" and self._ignores(message):
                self._queue.extend(bytes(answer.pack(self._codec)) for answer in self._answers(message))
                return
        super().send(data)


def bent(bend: Bend, *patterns: str) -> set[str]:
    """The checks that fail on a vehicle that is bent so."""
    return named(conform(BentWire(fleet(ready_s=0.0), bend), *patterns), Outcome.FAILED)
