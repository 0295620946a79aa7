"""The least distance between vehicles in the air, for the summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from swarmctl.agent.state import AgentState, Compared
from swarmctl.agent.traffic.collision_avoidance import AIRBORNE_M
from swarmctl.agent.traffic.separation.conflicts import Crossings
from swarmctl.agent.traffic.separation.flown import Flown
from swarmctl.agent.traffic.separation.trajectory import Point
from swarmctl.core.frames import StateShared
from swarmctl.core.vehicle import Landed, VehicleState


class Closeness:
    """Follows all vehicles that are heard of here; times are by the vehicles' own clocks, from take-off."""

    def __init__(self) -> None:
        self._flown: Flown | None = None
        self._at_flight_s: float | None = None
        self._here: set[int] = set()
        """whose telemetry comes to this process"""

    def moved(self, after: AgentState, flight_time_s: float | None, now: float) -> None:
        """A vehicle of this process has told where it is."""
        self._here.add(after.task.uav)
        if (here := _in_the_air(after)) is not None and self._of(after).saw(after.task.uav, now, here):
            self._at_flight_s = flight_time_s

    def heard(
        self,
        after: AgentState,
        states: Sequence[tuple[int, StateShared]],
        flight_time_s: float | None,
        now: float,
    ) -> None:
        """One of this process has heard of others near it, who may be flown elsewhere."""
        for uav, told in states:
            if uav in self._here or told.alt_rel_m < AIRBORNE_M or told.age_s > 0.0:
                continue
            east_m, north_m = after.task.grid.frame.to_local(told.lat_deg, told.lon_deg)
            height_m = told.alt_rel_m if told.alt_amsl_m is None else told.alt_amsl_m
            if self._of(after).saw(uav, now, (east_m, north_m, height_m)):
                self._at_flight_s = flight_time_s

    def _of(self, after: AgentState) -> Flown:
        if self._flown is None:
            self._flown = Flown(after.task.separation.limits)
        return self._flown

    def summary(self, states: Mapping[int, AgentState], crossings: Crossings | None = None) -> dict[str, Any]:
        """`least_distance` is None where there were never two in the air at once that are heard of here."""
        flown, names = self._flown, _Names({uav: state.task.name for uav, state in states.items()})
        too_close = {} if flown is None else flown.too_close_s
        return {
            "least_distance": self._least(names),
            "too_close": [
                {"vehicles": [names[uav] for uav in pair], "seconds": seconds}
                for pair, seconds in sorted(too_close.items())
            ],
            "alarms": sum(state.n_alarms for state in states.values()),
            "held": sum(state.n_holds for state in states.values()),
            "climbed": sum(state.n_climbs for state in states.values()),
            "first_routes": None if crossings is None else asdict(crossings),
            "plans_in_flight": _plans(states),
        }

    def _least(self, names: Mapping[int, str]) -> dict[str, Any] | None:
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


def _plans(states: Mapping[int, AgentState]) -> dict[str, int]:
    """How often plans were predicted to meet, each counted by who was to give way, and what became of it."""
    names = Compared.__slots__
    added = {name: sum(getattr(state.compared, name) for state in states.values()) for name in names}
    resolved = sum(n for name, n in added.items() if name != "predicted")
    return added | {"unresolved": added["predicted"] - resolved}


class _Names(dict[int, str]):
    """Of vehicles; who is flown elsewhere goes by its system id."""

    def __missing__(self, uav: int) -> str:
        return f"vehicle {uav}"


def _in_the_air(state: AgentState) -> Point | None:
    vehicle = state.vehicle
    if not is_airborne(vehicle) or vehicle.lat_deg is None or vehicle.lon_deg is None:
        return None
    height_m = vehicle.alt_rel_m if vehicle.alt_amsl_m is None else vehicle.alt_amsl_m
    east_m, north_m = state.task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
    return None if height_m is None else (east_m, north_m, height_m)


def is_airborne(vehicle: VehicleState) -> bool:
    return vehicle.armed and vehicle.landed not in (Landed.ON_GROUND, Landed.UNDEFINED)
