"""Conflicts of one vehicle's plans with the plans of other vehicles. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from swarmctl.agent.traffic.separation.clash import Clash
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.core.records import replace


class TrafficCounts(msgspec.Struct, frozen=True):
    """Numbers of reactions to other vehicles, and of predicted conflicts of plans: all, and by resolution."""

    alarms: int = 0
    holds: int = 0
    climbs: int = 0
    predicted: int = 0
    by_height: int = 0
    by_route: int = 0
    by_waiting: int = 0
    """conflicts after which the vehicle kept its previous plan, or held"""
    ceased: int = 0
    """conflicts that ended because the other vehicle changed its plan, or times shifted"""

    @classmethod
    def total(cls, counts: Iterable[TrafficCounts]) -> TrafficCounts:
        """Return the sums over several vehicles. The vehicle that gives way counts a conflict."""
        return cls(*map(sum, zip(*map(msgspec.structs.astuple, counts), strict=True)))

    @property
    def unresolved(self) -> int:
        return self.predicted - self.by_height - self.by_route - self.by_waiting - self.ceased


class FlightComparison(msgspec.Struct, frozen=True):
    own: Trajectory
    other: KnownFlight
    clash: Clash | None

    def is_of(self, own: Trajectory, other: KnownFlight) -> bool:
        return self.own is own and self.other is other


class Conflicts(msgspec.Struct, frozen=True):
    compared: Mapping[int, FlightComparison] = msgspec.field(default_factory=dict)
    """last comparison with each other vehicle"""
    predicted: frozenset[int] = frozenset()
    """vehicles in conflict with the flown route, to which this vehicle has to give way"""
    deferred_for: frozenset[int] = frozenset()
    """vehicles for which a new plan was deferred"""
    counts: TrafficCounts = msgspec.field(default_factory=TrafficCounts)

    def counted(self, **more: int) -> Conflicts:
        """Return the conflicts with higher counts: `more` by the name of each count."""
        sums = {name: getattr(self.counts, name) + n for name, n in more.items()}
        return replace(self, counts=replace(self.counts, **sums))

    def new_of(self, clashes: Sequence[Clash]) -> Sequence[Clash]:
        """Return the clashes with vehicles that were not in conflict before."""
        return [clash for clash in clashes if clash.other not in self.predicted | self.deferred_for]
