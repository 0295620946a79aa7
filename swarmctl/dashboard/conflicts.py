"""Conflicts in space and time between the flights that the vehicles announce. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmctl.agent.traffic.prediction import MAX_AGE_S
from swarmctl.agent.traffic.separation.clash import find_clashes
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import Trajectory, until_landing
from swarmctl.config.scenario import separation_of
from swarmctl.core.geo import LocalFrame
from swarmctl.dashboard.facts import VehicleFacts
from swarmctl.dashboard.picture import Conflict

if TYPE_CHECKING:
    from swarmctl.dashboard.model import Timeline


def predicted(timeline: Timeline, time_s: float) -> tuple[Conflict, ...]:
    """Return the conflicts that are predicted at a time, soonest first."""
    frame, limits = timeline.scenario.grid.frame, separation_of(timeline.scenario.config).limits
    vehicles = timeline.vehicles
    announced = {uav: _flight(vehicle, frame, time_s) for uav, vehicle in vehicles.items()}
    flights = {uav: KnownFlight.predicted(flight) for uav, flight in announced.items() if flight is not None}
    found = []
    for uav in list(flights):
        own = flights.pop(uav).flight
        for clash in find_clashes(own, flights, limits):
            if (mine := own.at(clash.at_s)) is not None:
                pair = (vehicles[uav].name, vehicles[clash.other].name)
                found.append(Conflict(pair, max(clash.at_s, 0.0), mine[:2]))
    return tuple(sorted(found, key=lambda conflict: (conflict.in_s, conflict.vehicles)))


def _flight(vehicle: VehicleFacts, frame: LocalFrame, time_s: float) -> Trajectory | None:
    """Return the announced flight, with times from now on in seconds of the vehicle's clock."""
    sent = vehicle.intents.at(time_s)
    if sent is None:
        return None
    boot_s, intent = vehicle.motion.at(time_s).boot_s, sent.intent
    elapsed_s = 0.0 if boot_s is None or sent.boot_s is None else boot_s - sent.boot_s
    elapsed_s += intent.age_s
    if len(intent.points) < 2 or not 0.0 <= elapsed_s <= MAX_AGE_S:
        return None
    flight = Trajectory(
        tuple(p.in_s - elapsed_s for p in intent.points),
        tuple((*frame.to_local(p.lat_deg, p.lon_deg), p.alt_amsl_m) for p in intent.points),
    )
    rest = flight.since(0.0)
    return None if rest is None or len(rest.times_s) < 2 else until_landing(rest)
