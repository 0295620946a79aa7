"""Straightening of lattice routes, with turns as wide as the vehicle needs.

A lattice route turns in steps of 45°. A straight leg may replace a part of the route if the leg is neither
longer nor more exposed. Only a track with turn radii may be worse than its route, if no other track is found.
`swarmctl.core.any_angle.track` explains the measures of exposure.

The turn of a fixed wing onto its first leg is not planned. `swarmctl.agent.replan.landing_pattern` plans the
landing.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

import msgspec
import numpy as np

from swarmctl.core.any_angle.corners import TIE_TOLERANCE, CostWeights, ExposureMeasure, choose_corners
from swarmctl.core.any_angle.track import CrossedCells, GridPoint, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.grid import Cell
from swarmctl.core.route import CORNER_TOLERANCE
from swarmctl.core.track_position import StraightLegs

TOLERATED_EXCESS = 0.05
"""Greatest share by which a track ahead of the vehicle may be more exposed than the route ahead. A smaller
excess does not justify a swap of the mission."""


class Track(msgspec.Struct, frozen=True):
    """A straightened route."""

    corners: tuple[Cell, ...]
    """both ends and the turns, as cells of the route in order"""
    over: tuple[Cell, ...]
    """cells under the track, in the order flown"""
    length_cells: float
    exposure_sum: float
    """ΣP_s over the cells entered after the first"""
    safety_factor: float
    """∏(1 − P_s) over the cells entered after the first"""


def pull_straight(
    threat: ThreatMap,
    cells: Sequence[Cell],
    measure: ExposureMeasure,
    *,
    radius_cells: float = 0.0,
    weights: CostWeights | None = None,
) -> Track:
    """Return the shortest track of fewest straight legs for a route over neighbouring cells.

    If the turn radius `radius_cells` [cells] is above 0, each turn is an arc inside its corner. The arc takes
    at most half of a leg between two turns. If all such tracks found are worse than the route, the result has
    the least cost by `weights` (Eq. 5), or the least exposure if `weights` is None. Raises Unflyable.
    """
    if len(cells) < 3:
        return track(threat, cells, tuple(range(len(cells))), radius_cells)
    route = np.array(cells, dtype=np.int64)
    corners = choose_corners(threat, route, measure, radius_cells, weights or CostWeights(1.0, 0.0))
    return track(threat, cells, corners, radius_cells)


def track(threat: ThreatMap, cells: Sequence[Cell], corners: Sequence[int], radius_cells: float) -> Track:
    """Return the track with its corners at the cells with the indices `corners` of a route."""
    points = [centre(cells[k]) for k in corners]
    flown, _ = rounded(points, radius_cells)
    under = crossed_cells(flown)
    exposure, hazard = threat.entered(under.cells[1:]).tolist()
    return Track(
        tuple(cells[k] for k in corners),
        under.cells,
        math.fsum(under.lengths),
        exposure,
        math.exp(-hazard),
    )


def is_still_good(
    now: ThreatMap,
    before: ThreatMap,
    measure: ExposureMeasure,
    route: Sequence[Cell],
    track: Track,
    *,
    radius_cells: float,
    here: GridPoint,
    index: int,
) -> bool:
    """Return whether the track ahead of the vehicle is as good as the route ahead, by the threat `now`.

    The vehicle is at `here`, beside `route[index]`. `before` is the threat at the last decision for this
    track. The track may be more exposed than the route by the excess
    under `before` and by TOLERATED_EXCESS. A wall that `before` lacks is not allowed.
    """
    flown, _ = rounded([centre(corner) for corner in track.corners], radius_cells)
    under = crossed_cells(flown)
    passed = StraightLegs.over(flown).locate(here).along_m if len(flown) > 1 else 0.0
    n_left = min(bisect_right(list(accumulate(under.lengths)), passed), len(under.cells) - 1)
    walls = ThreatMap(now.p_s, now.hazard, now.blocked & ~before.blocked)
    if not is_clear(walls, flown[under.legs[n_left] :]):
        return False
    track_ahead = _cells_ahead(under, n_left)
    route_ahead = _cells_ahead(crossed_cells([centre(at) for at in route[index:]]), 0)
    on_track, on_route = measure.of(now, track_ahead), measure.of(now, route_ahead)
    excess_before = np.maximum(measure.of(before, track_ahead) - measure.of(before, route_ahead), 0.0)
    return bool((on_track <= on_route * (1.0 + TOLERATED_EXCESS) + excess_before + TIE_TOLERANCE).all())


def _cells_ahead(under: CrossedCells, here: int) -> CrossedCells:
    """Return the cells ahead of a vehicle that leaves the cell with this index."""
    return CrossedCells(under.cells[here:], (0.0, *under.lengths[here + 1 :]), under.legs[here:])


def may_join(threat: ThreatMap, position: GridPoint, here: Cell, corner: Cell) -> bool:
    """Return whether a vehicle within cell `here` may fly straight to the next corner."""
    # DEVIATION: as on a lattice route, the vehicle may enter an unplanned cell that is at most as exposed as
    # the worst planned cell beside this cell.
    planned = crossed_cells((centre(here), centre(corner))).cells
    if not is_clear(threat, (position, centre(corner)), CORNER_TOLERANCE):
        return False
    for row, col in set(crossed_cells((position, centre(corner))).cells) - set(planned):
        beside = [threat.p_s[r, c] for r, c in planned if max(abs(r - row), abs(c - col)) <= 1]
        if not beside or threat.p_s[row, col] > max(beside):
            return False
    return True
