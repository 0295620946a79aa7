"""The route of a group in formation: the members' exposures at their places count, and turns cost.

The sum over a route of the group's leader is the sum of Eq. 5 over the n members,

    J = Σ over steps [ (1 − w)·ψ·(n·d + ways of the members to their new places) + c + w·E ],

with d the length of the step, c the costs of a change of shape and of another shape than the first, and E
the exposure on arrival: the sum of P_s over the members' cells, or 1 − ∏(1 − P_s). At each cell the group may
turn and change its shape, and then goes one step ahead. `poses` has the places, `group_field` the search over
(cell, heading, shape), `meeting` the split of a group.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners.base import Problem, Route, Unreachable, route_of
from swarmctl.planners.kernels import group_field
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.descent import REL_TIE
from swarmctl.planners.kernels.lattice import Ints
from swarmctl.planners.poses import HEADINGS_DEG, GroupArea, Poses, Shape, group_area, poses_of

USES_W = True
NEEDS_MACHINE_CODE = True
KEEPS_LONGEST = False
KEEPS_SHORTEST = False

MAX_PLACE_CELLS = 1000.0


class Params(msgspec.Struct, frozen=True):
    """The shapes of a group, and the cost of its exposure and of its changes."""

    shapes: tuple[Shape, ...] = (((0.0, 0.0),),)
    """for each shape the place of each member, (forward, right) of the leader [cells]; the leader is first"""
    exposure: Literal["sum", "survival"] = "sum"
    """`sum`: ΣP_s of the members; `survival`: 1 − ∏(1 − P_s), the chance of a strike on a member"""
    change_cost: float = 0.0
    """cost of a change to another shape than the first, besides the members' ways, in the unit of Eq. 5; the
    change back is free"""
    other_shape_cost: float = 0.0
    """cost of a cell of length in another shape than the first, in the unit of Eq. 5"""
    max_turn_deg: Literal[45, 90, 135, 180] = 90
    """greatest turn between two steps"""
    start_heading_deg: float | None = None
    """heading at the start, clockwise from north, rounded to one of eight; None: any"""
    start_shape: int | None = None
    """index in `shapes` at the start; None: any"""

    def __post_init__(self) -> None:
        if not self.shapes:
            raise ValueError("shapes is empty: expected at least one shape")
        for index, shape in enumerate(self.shapes):
            if len(shape) != len(self.shapes[0]) or not shape:
                raise ValueError(
                    f"shape {index} has {len(shape)} places, and shape 0 {len(self.shapes[0])}: expected one "
                    "place for each member in every shape"
                )
            if shape[0] != (0.0, 0.0):
                raise ValueError(f"shape {index} begins with {shape[0]}: expected (0, 0), the leader's place")
            for place in shape:
                if not all(abs(offset) <= MAX_PLACE_CELLS for offset in place):
                    raise ValueError(
                        f"shape {index} has the place {place}: expected at most {MAX_PLACE_CELLS:g} cells"
                    )
        for name, cost in (("change_cost", self.change_cost), ("other_shape_cost", self.other_shape_cost)):
            if not 0.0 <= cost < math.inf:
                raise ValueError(f"{name} is {cost}: expected a finite number, 0 or more")
        if self.start_heading_deg is not None and not math.isfinite(self.start_heading_deg):
            raise ValueError(f"start_heading_deg is {self.start_heading_deg}: expected a finite number")
        if self.start_shape is not None and not 0 <= self.start_shape < len(self.shapes):
            raise ValueError(f"start_shape is {self.start_shape}: expected 0 to {len(self.shapes) - 1}")

    def start_poses(self) -> Ints:
        """Return the numbers of the poses that the group may have at the start."""
        headings = np.arange(8)
        if self.start_heading_deg is not None:
            turn = np.abs((HEADINGS_DEG - self.start_heading_deg + 180.0) % 360.0 - 180.0)
            headings = headings[[int(turn.argmin())]]
        shapes = range(len(self.shapes)) if self.start_shape is None else [self.start_shape]
        return np.concatenate([8 * shape + headings for shape in shapes])


def plan(problem: Problem, params: Params) -> Route:
    """Return the leader's route of least cost for the group; among equal costs the members' shortest ways.

    The sums of the route are the leader's own. Bounds on length have no influence. Raises Unreachable.
    """
    area = area_of(problem, params)
    starts = area.states(problem.start, params.start_poses())
    label, cost = compiled(group_field.find_labels)(area.graph, starts)
    if math.isinf(cost):
        n = area.poses.n_members
        if n == 1:
            raise problem.unreachable()
        shapes = "its shape" if len(params.shapes) == 1 else f"any of its {len(params.shapes)} shapes"
        raise Unreachable(
            f"no route leads a group of {n} from {problem.start} to a goal in {shapes}: walls, or the border "
            "of the area, lie in its way"
        )
    cells = area.cells_of(compiled(group_field.descend)(area.graph, label, starts, cost))
    return route_of(problem, cells, _cheapest_poses(area, cells, params)[0])


def measure(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    """Return the least J of a group with its leader on these cells; infinite if a wall is in its way."""
    return _cheapest_poses(area_of(problem, params), cells, params)[0]


def shapes_along(problem: Problem, cells: Sequence[Cell], params: Params) -> tuple[int, ...]:
    """Return the index of the shape in which the group arrives at each cell, by `measure`.

    A change of shape takes place at the cell before. Raises Unreachable if a wall is in the group's way.
    """
    return tuple(pose // 8 for pose in _passable_poses(problem, cells, params))


def members_along(problem: Problem, cells: Sequence[Cell], params: Params) -> NDArray[np.int64]:
    """Return the cells of all members at each cell of the leader: (cells, members, 2), row and column.

    Members may be outside the area at first. Raises Unreachable if a wall is in the group's way.
    """
    poses = _passable_poses(problem, cells, params)
    tracks: Ints = np.asarray(cells)[:, np.newaxis] + _poses(params).cells[np.array(poses)]
    return tracks


def area_of(problem: Problem, params: Params) -> GroupArea:
    """Return the graph of the group's states over the area of a problem."""
    survival = params.exposure == "survival"
    return group_area(problem, _poses(params), survival, params.change_cost, params.other_shape_cost)


def _poses(params: Params) -> Poses:
    return poses_of(params.shapes, params.max_turn_deg)


def _passable_poses(problem: Problem, cells: Sequence[Cell], params: Params) -> list[int]:
    cost, poses = _cheapest_poses(area_of(problem, params), cells, params)
    if math.isinf(cost):
        raise Unreachable(f"a group of {len(params.shapes[0])} cannot fly this route: walls are in its way")
    return poses


def _cheapest_poses(area: GroupArea, cells: Sequence[Cell], params: Params) -> tuple[float, list[int]]:
    """Return the least cost of these cells, and the pose on arrival at each; of equal costs the shortest.

    The heading of a step is given by its cells, so there is one candidate for each shape.
    """
    graph, n_poses = area.graph, len(area.poses.cells)
    heading = {int(offset): h for h, offset in enumerate(graph.offsets)}
    sums = {int(pose): (0.0, 0.0) for pose in params.start_poses()}
    parents: list[dict[int, int]] = []
    for here, there in pairwise(cells):
        m, h = area.flat(here), heading[area.flat(there) - area.flat(here)]
        arrived: dict[int, tuple[float, float]] = {}
        parent: dict[int, int] = {}
        for k in range(h, n_poses, 8):
            state = (m + graph.ahead[k]) * n_poses + k
            onward = float(graph.entry[state] + graph.step[k])
            if math.isinf(onward) or not _may_move(area, m, k):
                continue
            for j, (cost, length) in sums.items():
                found = (
                    cost + onward + float(graph.turn[j, k]),
                    length + float(graph.turn_length[j, k] + graph.step_length[k]),
                )
                if _is_better(found, arrived.get(k)) and _may_turn(area, m, j, k):
                    arrived[k], parent[k] = found, j
        sums = arrived
        parents.append(parent)
    if not sums:
        return math.inf, []
    best = next(iter(sums))
    for pose, found in sums.items():
        if _is_better(found, sums[best]):
            best = pose
    poses = [best]
    for parent in reversed(parents):
        poses.append(parent[poses[-1]])
    return sums[best][0], poses[::-1]


def _is_better(found: tuple[float, float], known: tuple[float, float] | None) -> bool:
    """Return whether a finite (cost, length) is cheaper, or as cheap and shorter."""
    if known is None:
        return not math.isinf(found[0])
    if abs(found[0] - known[0]) <= REL_TIE * known[0]:
        return found[1] < known[1]
    return found[0] < known[0]


def _may_move(area: GroupArea, m: int, k: int) -> bool:
    graph = area.graph
    return not graph.near_barrier[m] or group_field.may_move(
        graph.barrier, graph.offsets, graph.swept[k, k], m, k % 8
    )


def _may_turn(area: GroupArea, m: int, j: int, k: int) -> bool:
    graph = area.graph
    return not graph.near_barrier[m] or group_field.may_turn(graph.barrier, graph.swept[j, k], m)
