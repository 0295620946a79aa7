"""Scenarios: file format (`model`, `plan`, `steps`), reader (`file`) and runs (`runner`).

`script` is the ground station of a run.
Begin with `file.load_scenario` and `runner.Run`. Only `command` uses the wall clock.
"""

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
