"""The world of one seed: the true hostiles, and the random numbers of strikes and sensors. Pure.

Each random number is a function of the seed and of the event for which it is drawn (a counter-based draw).
So one seed is the same world for every level of an experiment: a vehicle that enters a cell draws the same
number for the same hostile, whatever its route before, and whatever the number of other vehicles.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.config.scenario import Scenario, draw_hostiles
from swarmctl.core.grid import Cell
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.threat import FiringStrength

MASK = (1 << 64) - 1
GAMMA = 0x9E3779B97F4A7C15
FIRST, SECOND = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class Purpose(IntEnum):
    """Purposes of the draws; each purpose has separate numbers."""

    STRIKE = 1
    SENSOR = 2


def uniform(seed: int, *keys: int) -> float:
    """Return the uniform number in [0, 1) of a seed and of the keys of an event, whole numbers of 0 or more.

    Each key goes through the mixing function of SplitMix64 (Steele, Lea and Flood, 2014).
    """
    mixed = _mix(seed & MASK)
    for key in keys:
        mixed = _mix(mixed ^ key)
    return (mixed >> 11) * 2.0**-53


def _mix(value: int) -> int:
    value = (value + GAMMA) & MASK
    value = ((value ^ value >> 30) * FIRST) & MASK
    value = ((value ^ value >> 27) * SECOND) & MASK
    return value ^ value >> 31


class World(msgspec.Struct, frozen=True):
    """The true hostiles and the draws of one seed, in an area of `rows` × `cols` cells."""

    seed: int
    rows: int
    cols: int
    hostiles: frozenset[Cell]

    @classmethod
    def drawn(cls, scenario: Scenario, seed: int) -> World:
        """Return the world of a seed; a flight with this seed has the same hostiles."""
        hostiles = draw_hostiles(scenario.config, scenario.prior.count, seed)
        return cls(seed, scenario.grid.rows, scenario.grid.cols, hostiles)

    def occupancy(self) -> NDArray[np.float64]:
        """Return 1 for the cell of a hostile and 0 elsewhere, shape (rows, cols)."""
        occupied = np.zeros((self.rows, self.cols))
        for cell in self.hostiles:
            occupied[cell] = 1.0
        return occupied

    def around(self, cell: Cell) -> list[Cell]:
        """Return the 3 × 3 cells around a cell, without those outside the area, by row and column."""
        row, col = cell
        return [
            (r, c)
            for r in range(max(row - 1, 0), min(row + 2, self.rows))
            for c in range(max(col - 1, 0), min(col + 2, self.cols))
        ]

    def strikes(self, uav: int, cell: Cell, visit: int, strength: FiringStrength) -> int:
        """Return the number of hostiles that hit vehicle `uav` at its n-th entry into a cell (Eq. 1)."""
        by_steps = strength.direct, strength.first_neighbour, strength.second_neighbour
        hits = 0
        for hostile in self.around(cell):
            if hostile in self.hostiles:
                p_hit = by_steps[abs(hostile[0] - cell[0]) + abs(hostile[1] - cell[1])]  # Eq. 1
                draw = uniform(self.seed, Purpose.STRIKE, uav, self._index(hostile), self._index(cell), visit)
                hits += draw < p_hit
        return hits

    def shows_hostile(self, uav: int, cell: Cell, look: int, sensor: SensorModel) -> bool:
        """Return whether the n-th look of vehicle `uav` at a cell shows a hostile."""
        is_hostile = cell in self.hostiles
        if sensor.is_perfect:
            return is_hostile
        p_shown = 1.0 - sensor.p_miss if is_hostile else sensor.p_false_alarm
        return uniform(self.seed, Purpose.SENSOR, uav, self._index(cell), look) < p_shown

    def _index(self, cell: Cell) -> int:
        return cell[0] * self.cols + cell[1]
