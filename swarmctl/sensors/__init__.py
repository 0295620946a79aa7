"""Sensors: plug-ins that return a vehicle's observations at its position. Pure.

`footprint` simulates the paper's sensor. It knows the true threats, so agents and planners may not import
this room. A new simulated sensor is a module here and a line in `SOURCES`; its name is a value of
`sensor.source`. Imports core. Begin with `Sensor`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import msgspec
import numpy as np

from swarmctl.core.grid import Cell, Grid
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.vehicle import VehicleState
from swarmctl.sensors.footprint import Footprint


class Sensor(Protocol):
    """The sensor of one vehicle."""

    def observe(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]:
        """Return (row, col, occupied) of the cells observed now; often none."""


class NoSensor:
    """A sensor without observations, for vehicles whose payloads report over the bus."""

    def __init__(self, *_: object) -> None: ...

    def observe(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]:
        return ()


class SensorSource(msgspec.Struct, frozen=True):
    """The origin of a vehicle's observations."""

    sensor: Callable[[Grid, frozenset[Cell], SensorModel, np.random.Generator], Sensor]
    """a factory of a vehicle's sensor, from area, hostiles, error rates and random generator"""
    external: bool
    """True if payloads may report (`swarmctl.bus.external_observations`)"""

    @property
    def is_simulated(self) -> bool:
        return self.sensor is not NoSensor


SOURCES = {
    "simulated": SensorSource(Footprint, external=False),
    "external": SensorSource(NoSensor, external=True),
    "both": SensorSource(Footprint, external=True),
}
