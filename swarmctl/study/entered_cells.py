"""The cells that a vehicle enters on a route or its straightened track, and the lengths between. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from swarmctl.core.any_angle.track import centre, crossed_cells
from swarmctl.core.grid import Cell


class EnteredCells(msgspec.Struct, frozen=True):
    """The cells entered, in order. The middle of a cell is halfway between entry and exit."""

    cells: tuple[Cell, ...]
    to_edge: tuple[float, ...]
    """length from the middle of each cell but the last to its exit [cells]"""
    from_edge: tuple[float, ...]
    """length from that exit to the middle of the next cell [cells]"""


NONE_ENTERED = EnteredCells((), (), ())


def along_route(cells: Sequence[Cell]) -> EnteredCells:
    """Return the cells on the way from centre to centre."""
    steps = (math.sqrt(2.0) if a[0] != b[0] and a[1] != b[1] else 1.0 for a, b in pairwise(cells))
    halves = tuple(0.5 * step for step in steps)
    return EnteredCells(tuple(cells), halves, halves)


def along_track(corners: Sequence[Cell]) -> EnteredCells:
    """Return the cells along straight legs between the centres of corners."""
    crossed = crossed_cells([centre(corner) for corner in corners])
    last = len(crossed.cells) - 1
    # The way begins and ends in the middle of a cell.
    halves = [length if i in (0, last) else 0.5 * length for i, length in enumerate(crossed.lengths)]
    return EnteredCells(crossed.cells, tuple(halves[:-1]), tuple(halves[1:]))
