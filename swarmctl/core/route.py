"""Flight plans for routes over cells: waypoints and landing spots on the ground."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import FlightPlan, Waypoint

CORNER_TOLERANCE = 0.02
"""Greatest distance at which a leg may pass the corner that two diagonal cells share [cells]. A vehicle
follows a leg with about this error. A leg between the centres meets the corner exactly."""

MAX_OVERSHOOT_CELLS = 0.4
"""Greatest distance past the centre of a cell at which a copter may stop for a new plan [cells].

The copter stays in that cell. With room for the whole stop before the centre, changes would begin a cell
later, and a copter sees one cell ahead.
"""

LANDING_SPACING_M = 12.0
"""Wanted distance between the landing spots in one cell, for a separation of 10 m or less [m]."""
LANDING_MARGIN = 1.2
"""Wanted distance between the landing spots for a greater separation, as a share of the separation."""


def ends_and_turns(cells: Sequence[Cell]) -> tuple[Cell, ...]:
    """Return the ends and the turns of a route over neighbouring cells.

    The track from centre to centre covers the same cells as the route.
    """
    if len(cells) < 3:
        return tuple(cells)
    turns = (
        here
        for before, here, after in zip(cells, cells[1:], cells[2:], strict=False)
        if _step(before, here) != _step(here, after)
    )
    return (cells[0], *turns, cells[-1])


def flight_plan(
    grid: Grid,
    cells: Sequence[Cell],
    *,
    altitude_m: float,
    landing_lat_lon: LatLon,
    position: LatLon | None = None,
    may_cross: Callable[[Cell], bool] = lambda _: False,
) -> FlightPlan:
    """Return the plan to fly a route over neighbouring cells and land.

    Waypoints are the centres of the first and the last cell, and of the cells with a turn. From a `position`
    within cells[0] the vehicle flies straight ahead, not back to the centre of cells[0]. Exception: the
    straight leg would cross a cell off the route, and `may_cross` forbids this cell.
    """
    if not cells:
        raise ValueError("a route without cells cannot be flown: expected at least the goal cell")
    turns = ends_and_turns(cells)
    if position is not None and len(turns) > 1 and grid.cell_at(*position) == turns[0]:
        if _may_skip_first_centre(grid, turns, position):
            turns = turns[1:]
        elif may_cross(_crossed(grid, cells[0], cells[1], position)):
            turns = ends_and_turns(cells[1:])
    return _plan(grid, turns, altitude_m, landing_lat_lon)


def track_plan(
    grid: Grid,
    corners: Sequence[Cell],
    *,
    altitude_m: float,
    landing_lat_lon: LatLon,
    position: LatLon | None = None,
    may_join: Callable[[tuple[float, float], Cell], bool] = lambda _point, _corner: False,
) -> FlightPlan:
    """Return the plan to fly straight legs between corners (cells) and land.

    From a `position` within corners[0] the vehicle flies straight to the next corner if `may_join` allows the
    leg from this position (x, y) [cells]. Otherwise the vehicle flies back to the centre of corners[0].
    """
    if not corners:
        raise ValueError("a track without corners cannot be flown: expected at least the goal cell")
    if position is not None and len(corners) > 1 and grid.cell_at(*position) == corners[0]:
        east_m, north_m = grid.frame.to_local(*position)
        if may_join((east_m / grid.cell_size_m, north_m / grid.cell_size_m), corners[1]):
            corners = corners[1:]
    return _plan(grid, corners, altitude_m, landing_lat_lon)


def _plan(grid: Grid, corners: Sequence[Cell], altitude_m: float, landing_lat_lon: LatLon) -> FlightPlan:
    track = tuple(Waypoint(*grid.centre(cell), altitude_m) for cell in corners)
    landing = Waypoint(*landing_lat_lon, altitude_m)
    return FlightPlan(altitude_m, track, landing, max_overshoot_m=max_overshoot_m(grid))


def max_overshoot_m(grid: Grid) -> float:
    """Return the greatest distance past a splice point at which a copter may stop for a new plan [m]."""
    return MAX_OVERSHOOT_CELLS * grid.cell_size_m


def cells_between(begin: Cell, end: Cell) -> list[Cell]:
    """Return a line of neighbouring cells from `begin` to `end`, both included; no route is shorter."""
    n = max(abs(end[0] - begin[0]), abs(end[1] - begin[1]))
    rows, cols = end[0] - begin[0], end[1] - begin[1]
    return [
        begin,
        *((begin[0] + round(k * rows / n), begin[1] + round(k * cols / n)) for k in range(1, n + 1)),
    ]


def landing_spot(grid: Grid, cell: Cell, index: int, count: int, separation_m: float) -> LatLon:
    """Return the landing spot of vehicle `index` of the `count` vehicles that share a goal cell.

    The spots are distinct points inside the cell, on a square lattice about its centre. Their spacing is the
    wanted distance for the least separation over ground, or less if the cell is too small for that.
    """
    if not 0 <= index < count:
        raise ValueError(f"landing spot {index} of {count}: expected 0 to {count - 1}")
    east_m, north_m = grid.centre_m(cell)
    n_cols = _landing_columns(count)
    n_rows = -(-count // n_cols)
    wanted_m = max(LANDING_SPACING_M, LANDING_MARGIN * separation_m)
    spacing_m = min(wanted_m, greatest_landing_spacing_m(grid.cell_size_m, count))
    row, col = divmod(index, n_cols)
    return grid.frame.to_geodetic(
        east_m + (col - (n_cols - 1) / 2) * spacing_m, north_m + (row - (n_rows - 1) / 2) * spacing_m
    )


def greatest_landing_spacing_m(cell_size_m: float, count: int) -> float:
    """Return the greatest distance between the landing spots of `count` vehicles in one cell [m]."""
    return cell_size_m / _landing_columns(count)


def _landing_columns(count: int) -> int:
    return math.isqrt(count - 1) + 1


def _step(here: Cell, there: Cell) -> Cell:
    return there[0] - here[0], there[1] - here[1]


def _may_skip_first_centre(grid: Grid, turns: Sequence[Cell], position: LatLon) -> bool:
    (row, col), (next_row, next_col) = turns[0], turns[1]
    if row == next_row or col == next_col:
        return True  # the whole leg stays in one row or column of cells
    # The leg approaches the line of the centres, so the first shared corner is the farthest from the leg.
    leg, across = _leg(grid, turns[0], turns[1], position)
    return abs(across) <= CORNER_TOLERANCE * leg


def _crossed(grid: Grid, here: Cell, there: Cell, position: LatLon) -> Cell:
    """Return the cell that the leg from `position` to the diagonal neighbour `there` crosses."""
    _, across = _leg(grid, here, there, position)
    d_row, d_col = _step(here, there)
    # If the corner is to the left, the leg passes to the right of the corner: to the east on a flight north.
    enters_column_first = (across > 0.0) == (d_row * d_col > 0)
    return (here[0], there[1]) if enters_column_first else (there[0], here[1])


def _leg(grid: Grid, here: Cell, there: Cell, position: LatLon) -> tuple[float, float]:
    """Return the length [cells] of the leg from `position` to the centre of `there`, and a cross product.

    The cross product is leg × corner, with the corner that `here` and `there` share. If the product is
    positive, the corner is to the left of the leg.
    """
    (row, col), (next_row, next_col) = here, there
    x, y = (metres / grid.cell_size_m for metres in grid.frame.to_local(*position))
    corner_x = col + 1.0 if next_col > col else float(col)
    corner_y = row + 1.0 if next_row > row else float(row)
    leg_x, leg_y = next_col + 0.5 - x, next_row + 0.5 - y
    across = leg_x * (corner_y - y) - leg_y * (corner_x - x)
    return math.hypot(leg_x, leg_y), across
