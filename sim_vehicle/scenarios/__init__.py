"""Scenarios: what a file may say (`model`, `plan`, `steps`) and how it is read (`file`)."""

from sim_vehicle.scenarios.file import ScenarioError, default_scenario, load_scenario
from sim_vehicle.scenarios.model import Area, Gps, Scenario, VehicleSpec, Wind

__all__ = [
    "Area",
    "Gps",
    "Scenario",
    "ScenarioError",
    "VehicleSpec",
    "Wind",
    "default_scenario",
    "load_scenario",
]
