"""Configurations with fixed wings, and their flights on the virtual clock."""

from __future__ import annotations

from typing import Any

from flights import AREA, small_config

from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.geo import distance_m
from swarmctl.core.mission import Waypoint
from swarmctl.report.outcome import FlightReport


def winged_config(**sections: Any) -> Config:
    """Return a configuration of a fixed wing and a copter over 12 × 12 cells, changed by `sections`."""
    content: dict[str, dict[str, Any]] = {
        "area": {**AREA, "rows": 12, "cols": 12},
        "flight": {"altitude_m": 30.0, "any_angle": True},
        "simulate": {
            "count": 2,
            "ready_s": 3.0,
            "autopilot": ["arduplane", "ardupilot"],
            "start_distance_m": 150.0,
        },
    }
    content = {key: section | sections.pop(key, {}) for key, section in content.items()}
    return small_config(**content, **sections)


def winged(**sections: Any) -> Scenario:
    return build(winged_config(**sections))


def away_m(report: FlightReport, uav: int, place: Waypoint | tuple[float, float]) -> float:
    """Return the final distance of a vehicle from a place."""
    vehicle = report.states[uav].vehicle
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    there = (place.lat_deg, place.lon_deg) if isinstance(place, Waypoint) else place
    return distance_m((vehicle.lat_deg, vehicle.lon_deg), there)
