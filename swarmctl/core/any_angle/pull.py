"""Pulling a lattice route straight, and making its turns wide enough for a vehicle that needs room for them.

A lattice route turns in steps of 45°. A straight leg between two of its cells may take the place of the way
between them where it is neither longer nor more exposed, so the whole is never worse than the lattice route
in anything that is compared. How exposure is compared (`ExposureMeasure`) matters: see `swarmctl.core.any_angle.track`.

Of a fixed wing the turn onto the first leg is not planned here, nor its landing (`swarmctl.agent.replan.landing_pattern`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmctl.core.any_angle.corners import TIES, ExposureMeasure, Weights, choose_corners
from swarmctl.core.any_angle.track import CrossedCells, GridPoint, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.grid import Cell
from swarmctl.core.route import CORNER_TOLERANCE

WORSE_BY = 0.05
"""A track is given up where what is left of it has become more exposed than its route by this share of what
is left of the route: less is not worth stopping a vehicle for."""


@dataclass(frozen=True, slots=True)
class Track:
    """What is flown instead of a lattice route."""

    corners: tuple[Cell, ...]
    """both ends and where it turns, all cells of the route in its order"""
    over: tuple[Cell, ...]
    """the cells under it, in the order flown"""
    abreast: tuple[int, ...]
    """for each of them the index of the route's cell that stands for it"""
    length_cells: float
    exposure_sum: float
    """ΣP_s over the cells entered after the first"""
    safety_factor: float
    """∏(1 − P_s) over the same"""


def pull_straight(
    threat: ThreatMap,
    cells: Sequence[Cell],
    counting: ExposureMeasure,
    *,
    radius_cells: float = 0.0,
    weights: Weights | None = None,
) -> Track:
    """The straight legs to fly for a route over neighbouring cells: the fewest, of those the shortest.

    Where turns need `radius_cells` [cells], each is an arc inside its corner and takes at most half of a leg
    between two turns. If no choice of legs that are no worse leaves that room, the legs may be worse, as
    little as can be by `weights` (Eq. 5; by exposure alone without): such a vehicle cannot fly the lattice
    route either. Walls are kept clear in any case. Raises Unflyable.
    """
    if len(cells) < 3:
        return track(threat, cells, tuple(range(len(cells))), radius_cells)
    route = np.array(cells, dtype=np.int64)
    corners = choose_corners(threat, route, counting, radius_cells, weights or Weights(1.0, 0.0))
    return track(threat, cells, corners, radius_cells)


def track(threat: ThreatMap, cells: Sequence[Cell], corners: Sequence[int], radius_cells: float) -> Track:
    """The track over the cells with the indices `corners` of a route."""
    points = [centre(cells[k]) for k in corners]
    flown, leg_of = rounded(points, radius_cells)
    under = crossed_cells(flown)
    abreast = tuple(_abreast(cells, corners, under, leg_of)) if leg_of else (0,) * len(under.cells)
    exposure, hazard = threat.entered(under.cells[1:]).tolist()
    return Track(
        tuple(cells[k] for k in corners),
        under.cells,
        abreast,
        math.fsum(under.ways),
        exposure,
        math.exp(-hazard),
    )


def route_index_at(track: Track, cell: Cell, since: int = 0) -> int | None:
    """The index of the route's cell that stands for a cell under the track, at or after `since` if it passes
    there more than once; None where it does not pass."""
    found = [k for over, k in zip(track.over, track.abreast, strict=True) if over == cell]
    return next((k for k in found if k >= since), found[-1] if found else None)


def still_holds(
    now: ThreatMap,
    before: ThreatMap,
    counting: ExposureMeasure,
    route: Sequence[Cell],
    track: Track,
    *,
    radius_cells: float,
    cell: Cell,
    index: int,
) -> bool:
    """Whether what is left of a track is as good as what is left of its route, now that more is known.

    The vehicle is over `cell` of the track, for which `route[index]` stands; `before` is the threat by which
    the track was last found good. Along a leg the one may have its dear part behind it and the other before
    it, so what is left may have been dearer on the track from the beginning: only more than that is news.
    """
    flown, _ = rounded([centre(corner) for corner in track.corners], radius_cells)
    under = crossed_cells(flown)
    here = next(
        (i for i, at in enumerate(under.cells) if at == cell and track.abreast[i] >= index),
        len(under.cells) - 1,
    )
    walls = ThreatMap(now.p_s, now.hazard, now.blocked & ~before.blocked)
    if not is_clear(walls, flown[under.legs[here] :]):
        return False
    ahead = crossed_cells([centre(at) for at in route[index:]])
    rest, lattice = _from(under, here), _from(ahead, 0)
    mine, its = counting.of(now, rest), counting.of(now, lattice)
    were = np.maximum(counting.of(before, rest) - counting.of(before, lattice), 0.0)
    return bool((mine <= its * (1.0 + WORSE_BY) + were + TIES).all())


def _from(under: CrossedCells, here: int) -> CrossedCells:
    """What lies before a vehicle that leaves the cell with this index."""
    return CrossedCells(under.cells[here:], (0.0, *under.ways[here + 1 :]), under.legs[here:])


def may_join(threat: ThreatMap, position: GridPoint, here: Cell, corner: Cell) -> bool:
    """Whether a vehicle within cell `here` may fly straight to the next corner, not by its cell's centre."""
    # DEVIATION: as on a lattice route it cuts over other cells than planned where none of them is worse than
    # the worst of the planned ones beside it.
    planned = crossed_cells((centre(here), centre(corner))).cells
    if not is_clear(threat, (position, centre(corner)), CORNER_TOLERANCE):
        return False
    for row, col in set(crossed_cells((position, centre(corner))).cells) - set(planned):
        beside = [threat.p_s[r, c] for r, c in planned if max(abs(r - row), abs(c - col)) <= 1]
        if not beside or threat.p_s[row, col] > max(beside):
            return False
    return True


def _abreast(
    cells: Sequence[Cell], corners: Sequence[int], under: CrossedCells, leg_of: Sequence[int]
) -> list[int]:
    """The nearest cell of the route for each under the track, never going back."""
    found: list[int] = []
    for (row, col), piece in zip(under.cells, under.legs, strict=True):
        first = max(found[-1] if found else 0, corners[leg_of[piece]])
        last = max(first, corners[leg_of[piece] + 1])
        distances = [max(abs(cells[k][0] - row), abs(cells[k][1] - col)) for k in range(first, last + 1)]
        nearest = min(range(len(distances)), key=lambda i: (distances[i], -i))
        found.append(first + nearest)
    return found
