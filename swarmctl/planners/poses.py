"""The poses of a group, and the graph of its states over an area. Pure.

A pose is a shape with one of eight headings; its number is 8 · shape + heading, with the headings in the
order of `offsets_of`. The place of member i is its offset turned by the heading,

    east = forward · sin χ + right · cos χ,     north = forward · cos χ − right · sin χ,

and its cell is the leader's cell plus the place rounded to whole cells. A change of pose costs the straight
ways of the members between their places.
"""

from __future__ import annotations

import functools
import math

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.planners.base import Problem
from swarmctl.planners.kernels.group_field import GroupGraph
from swarmctl.planners.kernels.lattice import ROOT2, Floats, Ints, offsets_of

Shape = tuple[tuple[float, float], ...]
"""(forward, right) of each member from the leader [cells]"""

HEADINGS_DEG = np.array([90, 0, 270, 180, 45, 315, 225, 135])
"""clockwise from north, in the order of `offsets_of`"""
_H = math.sqrt(0.5)
_SIN = np.array([1.0, 0.0, -1.0, 0.0, _H, -_H, -_H, _H])
_COS = np.array([0.0, 1.0, 0.0, -1.0, _H, _H, -_H, -_H])
STEP_CELLS = np.array([1.0] * 4 + [ROOT2] * 4)
POINTS_A_CELL = 4
"""points a cell of length at which a member's way from place to place is compared with walls"""


class Poses(msgspec.Struct, frozen=True, eq=False):
    """Places of the members in each pose, and the changes between poses."""

    cells: Ints
    """(poses, members, 2): rows north and columns east of the leader"""
    ways_cells: Floats
    """(poses, poses): sum of the members' ways from place to place [cells]"""
    is_allowed: NDArray[np.bool_]
    """(poses, poses): False for a turn above the limit"""
    swept: Ints
    """(poses, poses, members, points, 2): cells on the members' ways, as in `cells`"""

    @property
    def n_members(self) -> int:
        return int(self.cells.shape[1])

    @property
    def reach(self) -> int:
        """Greatest number of rows or columns between the leader and a member."""
        return int(np.abs(self.cells).max())


@functools.lru_cache(maxsize=16)
def poses_of(shapes: tuple[Shape, ...], max_turn_deg: int) -> Poses:
    """Return the poses of these shapes; a turn at one step is at most `max_turn_deg`."""
    offsets = np.array(shapes, dtype=np.float64)[:, np.newaxis]
    forward, right = offsets[..., 0], offsets[..., 1]
    sin, cos = _SIN[:, np.newaxis], _COS[:, np.newaxis]
    places = np.stack((forward * cos - right * sin, forward * sin + right * cos), axis=-1)
    places = places.reshape(-1, *places.shape[2:])
    change = places[np.newaxis] - places[:, np.newaxis]
    ways = np.hypot(change[..., 0], change[..., 1])
    angle = np.tile(HEADINGS_DEG, len(shapes))
    is_allowed = np.abs((angle - angle[:, np.newaxis] + 180) % 360 - 180) <= max_turn_deg
    n_parts = math.ceil(POINTS_A_CELL * ways[is_allowed].max())
    share = np.arange(n_parts + 1)[:, np.newaxis] / max(n_parts, 1)
    swept = places[:, np.newaxis, :, np.newaxis] + change[..., np.newaxis, :] * share
    swept[..., -1, :] = places  # without rounding
    return Poses(_whole(places), ways.sum(axis=2), is_allowed, _whole(swept))


def _whole(places: Floats) -> Ints:
    return np.rint(places).astype(np.int64)


class GroupArea(msgspec.Struct, frozen=True, eq=False):
    """The graph of a group's states, with indices from cells and back."""

    graph: GroupGraph
    poses: Poses
    width: int
    """cells in a row with its padding"""
    pad: int

    def flat(self, cell: Cell) -> int:
        """Return the padded flat index of a cell."""
        return (cell[0] + self.pad) * self.width + cell[1] + self.pad

    def states(self, cell: Cell, poses: Ints) -> Ints:
        """Return the indices of the states in these poses with the leader in a cell."""
        return self.flat(cell) * len(self.poses.cells) + poses

    def cells_of(self, states: Ints) -> tuple[Cell, ...]:
        """Return the leader's cells in these states."""
        rows, cols = np.divmod(states // len(self.poses.cells), self.width)
        return tuple(zip((rows - self.pad).tolist(), (cols - self.pad).tolist(), strict=True))


def group_area(
    problem: Problem, poses: Poses, survival: bool, change_cost: float, other_shape_cost: float
) -> GroupArea:
    """Return the graph of a problem; `survival` selects 1 − ∏(1 − P_s) instead of ΣP_s of the members.

    `other_shape_cost` is the cost of a cell of length in another shape than the first.
    """
    n_poses, n_members = poses.cells.shape[:2]
    passable = problem.passable
    rows, cols = passable.shape
    pad = poses.reach + 1
    width = cols + 2 * pad
    is_wall = np.isinf(passable)
    beyond = [
        np.maximum(np.arange(-pad, n + pad) - n + 1, np.arange(pad, -n - pad, -1)) for n in (rows, cols)
    ]
    barrier = np.maximum(np.maximum.outer(*beyond), 0).astype(np.float64)
    barrier[pad:-pad, pad:-pad] = np.where(is_wall, math.inf, 0.0)
    near = ndimage.maximum_filter((barrier > 0.0).view(np.uint8), 2 * pad + 1, mode="nearest")

    own = np.zeros(barrier.shape)
    own[pad:-pad, pad:-pad] = np.where(is_wall, 0.0, problem.less_gain(np.where(is_wall, 0.0, passable)))
    if survival:
        np.subtract(1.0, np.minimum(own, 1.0), out=own)
    entry = np.full((*barrier.shape, n_poses), math.inf)
    for k in range(n_poses):
        exposed = np.ones((rows, cols)) if survival else np.zeros((rows, cols))
        combine = np.multiply if survival else np.add
        for row, col in poses.cells[k].tolist():
            window = np.s_[pad + row : pad + row + rows, pad + col : pad + col + cols]
            combine(exposed, own[window], out=exposed)
            exposed[np.isinf(barrier[window])] = math.nan
        cost = problem.w * (1.0 - exposed if survival else exposed)
        entry[pad:-pad, pad:-pad, k] = np.where(np.isnan(cost), math.inf, cost)

    distance = (1.0 - problem.w) * problem.psi_per_cell
    shape = np.arange(n_poses) // 8
    enters_other_shape = np.not_equal.outer(shape, shape) & (shape > 0)
    turn = distance * poses.ways_cells + change_cost * enters_other_shape
    turn[~poses.is_allowed] = math.inf
    cells_ahead = np.tile(STEP_CELLS, n_poses // 8)
    price = n_members * distance + np.where(shape > 0, other_shape_cost, 0.0)
    offsets = offsets_of(width)
    graph = GroupGraph(
        barrier=barrier.reshape(-1),
        near_barrier=near.reshape(-1),
        entry=entry.reshape(-1),
        turn=turn,
        turn_length=poses.ways_cells,
        swept=np.ascontiguousarray(poses.swept @ np.array([width, 1]), dtype=np.int32),
        step=price * cells_ahead,
        step_length=n_members * cells_ahead,
        ahead=np.tile(offsets, n_poses // 8),
        offsets=offsets,
        goals=np.array(sorted({(row + pad) * width + col + pad for row, col in problem.goals})),
    )
    return GroupArea(graph, poses, width, pad)
