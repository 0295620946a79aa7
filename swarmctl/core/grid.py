"""The surveillance area: square cells laid on the ground."""

from __future__ import annotations

import math
from functools import cached_property

import msgspec

from swarmctl.core.geo import LatLon, LocalFrame

Cell = tuple[int, int]
"""(row, col); row 0 is the south edge and rows grow north, columns grow east."""


class Grid(msgspec.Struct, frozen=True, dict=True):
    """`rows` × `cols` cells of `cell_size_m`; the origin is the south-west corner of cell (0, 0)."""

    rows: int
    cols: int
    cell_size_m: float
    origin_lat_deg: float
    origin_lon_deg: float

    def __post_init__(self) -> None:
        if self.rows < 1 or self.cols < 1:
            raise ValueError(f"an area of {self.rows} × {self.cols} cells: expected at least 1 × 1")
        if not (math.isfinite(self.cell_size_m) and self.cell_size_m > 0.0):
            raise ValueError(f"cell size of {self.cell_size_m} m: expected a finite number above 0")
        LocalFrame(self.origin_lat_deg, self.origin_lon_deg)  # raises ValueError for an invalid origin

    @cached_property
    def frame(self) -> LocalFrame:
        """The plane with its origin at the south-west corner."""
        return LocalFrame(self.origin_lat_deg, self.origin_lon_deg)

    @property
    def n_cells(self) -> int:
        return self.rows * self.cols

    @property
    def size_east_m(self) -> float:
        return self.cols * self.cell_size_m

    @property
    def size_north_m(self) -> float:
        return self.rows * self.cell_size_m

    def contains(self, cell: Cell) -> bool:
        return 0 <= cell[0] < self.rows and 0 <= cell[1] < self.cols

    def cell_at(self, lat_deg: float, lon_deg: float) -> Cell | None:
        """Return the cell of a point; None outside the area. A cell includes its south and west edges."""
        east_m, north_m = self.frame.to_local(lat_deg, lon_deg)
        if not (0.0 <= east_m < self.size_east_m and 0.0 <= north_m < self.size_north_m):
            return None
        return self._clamped(east_m, north_m)

    def nearest_border_cell(self, lat_deg: float, lon_deg: float) -> Cell:
        """Return the cell on the area's border that is nearest to a point inside or outside the area."""
        east_m, north_m = self.frame.to_local(lat_deg, lon_deg)
        if not (math.isfinite(east_m) and math.isfinite(north_m)):
            raise ValueError(
                f"({lat_deg}, {lon_deg}) is no position: expected latitude, longitude in degrees"
            )
        row, col = self._clamped(east_m, north_m)
        last_row, last_col = self.rows - 1, self.cols - 1
        if row in (0, last_row) or col in (0, last_col):
            return row, col
        _, border_cell = min(
            (north_m, (0, col)),
            (east_m, (row, 0)),
            (self.size_north_m - north_m, (last_row, col)),
            (self.size_east_m - east_m, (row, last_col)),
        )
        return border_cell

    def centre(self, cell: Cell) -> LatLon:
        """Return (latitude, longitude) [deg] of the centre of a cell."""
        east_m, north_m = self.centre_m(cell)
        return self.frame.to_geodetic(east_m, north_m)

    def centre_m(self, cell: Cell) -> tuple[float, float]:
        """Return (east, north) [m] of the centre of a cell in `frame`."""
        if not self.contains(cell):
            raise ValueError(
                f"cell {cell} is outside the area: expected row 0..{self.rows - 1} "
                f"and column 0..{self.cols - 1}"
            )
        return (cell[1] + 0.5) * self.cell_size_m, (cell[0] + 0.5) * self.cell_size_m

    def corners(self) -> tuple[LatLon, LatLon, LatLon, LatLon]:
        """Return the SW, SE, NE and NW corner of the area, each (latitude, longitude) [deg]."""
        to_geodetic = self.frame.to_geodetic
        return (
            to_geodetic(0.0, 0.0),
            to_geodetic(self.size_east_m, 0.0),
            to_geodetic(self.size_east_m, self.size_north_m),
            to_geodetic(0.0, self.size_north_m),
        )

    def _clamped(self, east_m: float, north_m: float) -> Cell:
        row = math.floor(north_m / self.cell_size_m)
        col = math.floor(east_m / self.cell_size_m)
        return min(max(row, 0), self.rows - 1), min(max(col, 0), self.cols - 1)
