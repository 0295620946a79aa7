"""Separation between vehicles in the air, as statistics for the summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.plan_conflicts import TrafficCounts
from swarmctl.agent.traffic.prediction import AIRBORNE_M, position_amsl
from swarmctl.agent.traffic.separation.conflicts import CrossingCounts
from swarmctl.core.frames import StateShared
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.report.flown_separation import FlownSeparation


class SeparationStatistics:
    """Distances between all vehicles known to this process."""

    def __init__(self) -> None:
        self._flown: FlownSeparation | None = None
        self._at_flight_s: float | None = None
        """flight time of the vehicle whose agent recorded the least distance [s]; None: not known"""
        self._own_uavs: set[int] = set()
        """system ids of the vehicles that this process flies"""

    def moved(self, after: AgentState, flight_time_s: float | None, now: float) -> None:
        """Record the position of a vehicle of this process."""
        self._own_uavs.add(after.task.uav)
        position = position_amsl(after) if _is_airborne(after.vehicle) else None
        if position is not None and self._flown_separation(after).add_position(after.task.uav, now, position):
            self._at_flight_s = flight_time_s

    def neighbours_moved(
        self,
        after: AgentState,
        states: Sequence[tuple[int, StateShared]],
        flight_time_s: float | None,
        now: float,
    ) -> None:
        """Record the new positions of airborne vehicles of other processes."""
        for uav, state in states:
            if uav in self._own_uavs or state.alt_rel_m < AIRBORNE_M:
                continue
            east_m, north_m = after.task.grid.frame.to_local(state.lat_deg, state.lon_deg)
            if self._flown_separation(after).add_position(
                uav, now - state.age_s, (east_m, north_m, state.alt_amsl_m)
            ):
                self._at_flight_s = flight_time_s

    def _flown_separation(self, after: AgentState) -> FlownSeparation:
        if self._flown is None:
            self._flown = FlownSeparation(after.task.separation.limits)
        return self._flown

    def summary(
        self, states: Mapping[int, AgentState], crossings: CrossingCounts | None = None
    ) -> dict[str, Any]:
        """Return the section of `summary.json`. `least_distance` is None if no two vehicles flew at once."""
        flown, names = self._flown, _Names({uav: state.task.name for uav, state in states.items()})
        counts = TrafficCounts.total(state.conflicts.counts for state in states.values())
        too_close = {} if flown is None else flown.too_close_s
        return {
            "least_distance": self._least_distance(names),
            "too_close": [
                {"vehicles": [names[uav] for uav in pair], "seconds": seconds}
                for pair, seconds in sorted(too_close.items())
            ],
            "alarms": counts.alarms,
            "held": counts.holds,
            "climbed": counts.climbs,
            "first_routes": None if crossings is None else msgspec.structs.asdict(crossings),
            "plans_in_flight": {
                "predicted": counts.predicted,
                "by_height": counts.by_height,
                "by_route": counts.by_route,
                "by_waiting": counts.by_waiting,
                "ceased": counts.ceased,
                "unresolved": counts.unresolved,
            },
        }

    def _least_distance(self, names: Mapping[int, str]) -> dict[str, Any] | None:
        flown = self._flown
        if flown is None or flown.nearest is None or flown.between is None:
            return None
        return {
            "vehicles": [names[uav] for uav in flown.between],
            "distance_m": flown.nearest.distance_m,
            "horizontal_m": flown.nearest.horizontal_m,
            "vertical_m": flown.nearest.vertical_m,
            "at_flight_s": self._at_flight_s,
        }


class _Names(dict[int, str]):
    """Vehicle names; `vehicle 3` for vehicle 3 of another process."""

    def __missing__(self, uav: int) -> str:
        return f"vehicle {uav}"


def _is_airborne(vehicle: VehicleState) -> bool:
    return vehicle.armed and vehicle.landed not in (Landed.ON_GROUND, Landed.UNDEFINED)
