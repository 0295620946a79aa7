"""The flown part of a flight: its length, the cells entered, and their believed exposure. Pure."""

from __future__ import annotations

import math

import msgspec

from swarmctl.core.geo import distance_m
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState


class Flown(msgspec.Struct, frozen=True):
    length_m: float = 0.0
    cells: tuple[Cell, ...] = ()
    exposure: float = 0.0
    """ΣP_s over the cells entered after the first, by the last decision before the entry; no-fly cells: 0"""
    safety: float = 1.0
    """∏(1 − P_s) over the same cells"""
    no_fly_entered: int = 0
    """number of entries into no-fly cells"""

    def moved(self, before: VehicleState, after: VehicleState) -> Flown:
        """Return the record with the way between two positions of an armed vehicle."""
        here, there = before.lat_lon, after.lat_lon
        if not after.armed or here is None or there is None:
            return self
        return replace(self, length_m=self.length_m + distance_m(here, there))

    def entered(self, cell: Cell, p_s: float) -> Flown:
        """Return the record with one more cell, of believed exposure `p_s`."""
        entered = replace(self, cells=(*self.cells, cell))
        if not self.cells:
            return entered  # the exposure of a planned route does not count the start cell
        if math.isinf(p_s):
            return replace(entered, no_fly_entered=self.no_fly_entered + 1)
        return replace(entered, exposure=self.exposure + p_s, safety=self.safety * (1.0 - min(p_s, 1.0)))
