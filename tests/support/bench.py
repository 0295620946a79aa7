"""A session and a scripted copter; a test can choose every answer of the copter."""

from __future__ import annotations

from collections.abc import Iterable

from scripted_copter import Copter, Script
from wire_bench import Faults, WireBench, north_of_home

from swarmctl.core.mission import FlightPlan

STEP_S = WireBench.STEP_S

__all__ = ["STEP_S", "Bench", "Faults", "north_of_home"]


class Bench(WireBench):
    def __init__(self, script: Script | None = None, faults: Faults | None = None) -> None:
        super().__init__(faults)
        self.copter = Copter(1, script or Script())

    def vehicle_receives(self, data: bytes) -> Iterable[bytes]:
        return self.copter.receive(data, self.now)

    def vehicle_steps(self) -> Iterable[bytes]:
        return self.copter.step(self.now)

    def mission_is(self, plan: FlightPlan) -> bool:
        """Return whether the vehicle's memory has exactly this plan, without item 0."""
        items = self.session.mission_items(plan)
        stored = [(i.command, i.frame, i.x, i.y, int(i.z * 100) / 100) for i in items]
        return [m[:5] for m in self.copter.mission][1:] == stored[1:]
