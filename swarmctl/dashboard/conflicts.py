"""Conflicts in space and time between the flights that the vehicles announce. Pure."""

from __future__ import annotations

from collections.abc import Collection

from swarmctl.agent.traffic.prediction import MAX_AGE_S
from swarmctl.agent.traffic.separation.clash import find_clashes
from swarmctl.agent.traffic.separation.trajectory import Trajectory, until_landing
from swarmctl.config.scenario import Scenario, separation_of
from swarmctl.dashboard.facts import VehicleFacts
from swarmctl.dashboard.picture import Conflict


class Conflicts:
    """The prediction of conflicts."""

    def __init__(self, scenario: Scenario) -> None:
        self._frame = scenario.grid.frame
        self._limits = separation_of(scenario.config).limits

    def at(self, vehicles: Collection[VehicleFacts], time_s: float) -> tuple[Conflict, ...]:
        """Return the conflicts that are predicted at a time, soonest first."""
        flights = {v.uav: flight for v in vehicles if (flight := self._flight(v, time_s)) is not None}
        names = {v.uav: v.name for v in vehicles}
        found = []
        for uav in list(flights):
            own = flights.pop(uav)
            for clash in find_clashes(own, flights, self._limits):
                if (mine := own.at(clash.at_s)) is not None:
                    pair = (names[uav], names[clash.other])
                    found.append(Conflict(pair, max(clash.at_s, 0.0), mine[:2]))
        return tuple(sorted(found, key=lambda conflict: (conflict.in_s, conflict.vehicles)))

    def _flight(self, vehicle: VehicleFacts, time_s: float) -> Trajectory | None:
        """Return the announced flight, with times from now on in seconds of the vehicle's clock."""
        sent = vehicle.intents.at(time_s)
        if sent is None:
            return None
        boot_s = vehicle.motion.at(time_s).boot_s
        elapsed_s = 0.0 if boot_s is None or sent.boot_s is None else boot_s - sent.boot_s
        elapsed_s += sent.intent.age_s
        points = sent.intent.points
        if len(points) < 2 or not 0.0 <= elapsed_s <= MAX_AGE_S:
            return None
        to_local = self._frame.to_local
        flight = Trajectory(
            tuple(p.in_s - elapsed_s for p in points),
            tuple((*to_local(p.lat_deg, p.lon_deg), p.alt_amsl_m) for p in points),
        )
        rest = flight.since(0.0)
        return None if rest is None or len(rest.times_s) < 2 else until_landing(rest)
