"""A session and a scripted copter, whose every answer a test can choose."""

from __future__ import annotations

from collections.abc import Iterable

from scripted_copter import Copter, Script
from wire_bench import Faults, WireBench, north_of_home

from swarmctl.core.mission import FlightPlan

STEP_S = WireBench.STEP_S

__all__ = ["STEP_S", "Bench", "Faults", "plan"]


def plan(*, north: int = 5, alt: float = 20.0, east: float = 0.0) -> FlightPlan:
    """`north` waypoints 111 m apart going north, then a landing on the last one."""
    return north_of_home(north=north, step_deg=0.001, alt=alt, east=east)


class Bench(WireBench):
    def __init__(self, script: Script | None = None, faults: Faults | None = None) -> None:
        super().__init__(faults)
        self.copter = Copter(1, script or Script())

    def vehicle_receives(self, data: bytes) -> Iterable[bytes]:
        return self.copter.receive(data, self.now)

    def vehicle_steps(self) -> Iterable[bytes]:
        return self.copter.step(self.now)

    def items(self, plan: FlightPlan):
        return self.session.dialect.mission_items(plan)

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
