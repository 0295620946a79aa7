"""Flights of fixed wings on the virtual clock."""

from __future__ import annotations

from typing import Any

from flights import AREA, small

from swarmctl.config.scenario import Scenario
from swarmctl.core.geo import distance_m
from swarmctl.core.mission import Waypoint
from swarmctl.report.outcome import FlightReport


def winged(**sections: Any) -> Scenario:
    """Return a fixed wing and a copter over 12 × 12 cells."""
    simulate = {"count": 2, "ready_s": 3.0, "autopilot": ["arduplane", "ardupilot"]}
    simulate |= {"start_distance_m": 150.0} | sections.pop("simulate", {})
    flight = {"altitude_m": 30.0, "any_angle": True} | sections.pop("flight", {})
    area = {**AREA, "rows": 12, "cols": 12}
    return small(area=area, simulate=simulate, flight=flight, **sections)


def away_m(report: FlightReport, uav: int, place: Waypoint | tuple[float, float]) -> float:
    """Return the final distance of a vehicle from a place."""
    vehicle = report.states[uav].vehicle
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    there = (place.lat_deg, place.lon_deg) if isinstance(place, Waypoint) else place
    return distance_m((vehicle.lat_deg, vehicle.lon_deg), there)
