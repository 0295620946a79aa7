"""The paper's sensor: the 3×3 cells around the vehicle; perfect, or with misses and false alarms.

The sensor has the true positions of the threats, which never reach an agent or a planner.
"""

from __future__ import annotations

import math

import numpy as np

from swarmctl.core.grid import Cell, Grid
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.vehicle import Landed, VehicleState

MIN_HEIGHT_M = 2.0
"""height above home from which the sensor observes [m]"""


class Footprint:
    """One vehicle's sensor; it observes once at each entry into a cell, also into a cell beside the area.

    The model assumes independent errors; a repeated observation of one place would have the same error.
    """

    def __init__(
        self, grid: Grid, hostiles: frozenset[Cell], model: SensorModel, rng: np.random.Generator
    ) -> None:
        self._grid = grid
        self._hostiles = hostiles
        self._model = model
        self._rng = rng
        self._last: Cell | None = None

    def observe(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]:
        """Return (row, col, occupied) of the cells in sight.

        The result is empty if the vehicle has no position, is disarmed, on the ground, below MIN_HEIGHT_M,
        far outside the area, or over the same cell as at the last observation.
        """
        if vehicle.lat_deg is None or vehicle.lon_deg is None or not vehicle.armed:
            return ()
        if vehicle.landed is Landed.ON_GROUND or (vehicle.alt_rel_m or 0.0) < MIN_HEIGHT_M:
            return ()
        east_m, north_m = self._grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
        size_m = self._grid.cell_size_m
        row, col = math.floor(north_m / size_m), math.floor(east_m / size_m)
        if (row, col) == self._last:
            return ()
        self._last = (row, col)
        around = ((row + dr, col + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1))
        return tuple((r, c, self._shows((r, c))) for r, c in around if self._grid.contains((r, c)))

    def _shows(self, cell: Cell) -> bool:
        is_hostile = cell in self._hostiles
        if self._model.is_perfect:
            return is_hostile
        p_hit = 1.0 - self._model.p_miss if is_hostile else self._model.p_false_alarm
        return bool(self._rng.random() < p_hit)
