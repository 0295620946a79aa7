"""The split of a group: the members fly alone to a place where they meet, or fly together from the start.

With cost(x) the group's cost to go from its state x, by the measure J of `formation`, and cost_i(a, b) the
cost of member i alone by Eq. 5,

    together = cost(start),
    apart    = min over states x of ( a · Σ_i cost_i(own cell of i, cell of i in x) + cost straight on(x) ).

The group meets in state x before the goal, and flies on in its heading. Both sums have the same unit. They
leave out time: members that arrive early wait.

A shape is a restriction, so with a = 1 flying apart is seldom dearer, and the group meets late. A factor a
above 1 is the price of flying alone: a split then saves at least the share 1 − 1/a of the cost of the part
that is flown apart, and the group meets as soon as its shape costs less than this share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import kernels
from swarmctl.planners.base import BadProblem, Problem
from swarmctl.planners.formation import Params, area_of
from swarmctl.planners.kernels import group_field
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.descent import REL_TIE
from swarmctl.planners.kernels.lattice import Floats
from swarmctl.planners.poses import HEADINGS_DEG


class Meeting(msgspec.Struct, frozen=True):
    """The state in which a group meets: the leader's cell, the heading and the shape."""

    cell: Cell
    heading_deg: float
    shape: int


class Split(msgspec.Struct, frozen=True):
    """The costs of flying together and apart.

    together: the group's cost from the start
    apart: least cost with a meeting; infinite if a member has no route of its own
    meeting: the state of this cost; of equal ones, the state that the members reach at the least cost
    routes: each member's own route to its place in the meeting
    onward: the leader's cells from the meeting to the goal; empty if the split is not cheaper
    """

    together: float
    apart: float
    meeting: Meeting | None
    routes: tuple[tuple[Cell, ...], ...]
    onward: tuple[Cell, ...] = ()

    @property
    def is_cheaper(self) -> bool:
        """True if the split saves more than the rounding of the sums."""
        return self.apart < self.together * (1.0 - REL_TIE * 1e3)


def split(
    problem: Problem,
    params: Params,
    starts: Sequence[Cell],
    alone_factor: float = 1.0,
    *,
    is_apart: bool = False,
) -> Split:
    """Return the comparison for a group in its state at the problem's start; `starts` are the members' cells.

    `alone_factor` is a. `is_apart`: the members are apart already, so the cost together counts as infinite.
    A member outside the area or in a wall has no route of its own. Raises BadProblem for
    another number of members, a factor below 1, and the measure `survival`, which is no sum over members.
    """
    if not 1.0 <= alone_factor < math.inf:
        raise BadProblem(f"a factor of {alone_factor} for flying alone: expected a finite number, 1 or more")
    if params.exposure != "sum":
        raise BadProblem("a split compares sums of exposure: set exposure: sum")
    if len(starts) != len(params.shapes[0]):
        raise BadProblem(f"{len(starts)} starts for {len(params.shapes[0])} members: expected one for each")
    area = area_of(problem, params)
    states = area.states(problem.start, params.start_poses())
    label, together = compiled(group_field.find_labels)(area.graph, states[:0] if is_apart else states)
    fields = [_field_to(problem, cell) for cell in starts]
    if None in fields:
        return Split(together, math.inf, None, ())
    found = [field for field in fields if field is not None]
    pad, (rows, cols) = area.pad, problem.exposure.shape
    own = [_costs_from_start(field, pad) for field in found]
    inner = np.s_[pad : pad + rows, pad : pad + cols]
    onward = compiled(group_field.costs_ahead)(area.graph, label)
    to_go = onward.reshape(-1, area.width, len(area.poses.cells))[inner]
    reached = np.empty(to_go.shape)
    for pose, cells in enumerate(area.poses.cells):
        reached[..., pose] = 0.0
        for costs, (north, east) in zip(own, cells.tolist(), strict=True):
            reached[..., pose] += costs[pad + north :, pad + east :][:rows, :cols]
    for row, col in problem.goals:
        reached[row, col] = math.inf
    reached *= alone_factor
    total = reached + to_go
    apart = float(total.min())
    if math.isinf(apart):
        return Split(together, apart, None, ())
    reached[total > apart * (1.0 + REL_TIE)] = math.inf
    row, col, pose = (int(i) for i in np.unravel_index(reached.argmin(), reached.shape))
    routes = [
        field.route_from((row + int(place[0]), col + int(place[1])))[::-1]
        for field, place in zip(found, area.poses.cells[pose], strict=True)
    ]
    meeting = Meeting((row, col), float(HEADINGS_DEG[pose % 8]), pose // 8)
    compared = Split(together, apart, meeting, tuple(routes))
    if not compared.is_cheaper:
        return compared
    ahead = area.flat(meeting.cell) + int(area.graph.ahead[pose])
    state = np.array([ahead * len(area.poses.cells) + pose])
    route = compiled(group_field.descend)(area.graph, label, state, float(label[state[0]]))
    return replace(compared, onward=(meeting.cell, *area.cells_of(route)))


def _field_to(problem: Problem, cell: Cell) -> kernels.Field | None:
    """Return the field with a member's start as its goal; None outside the area and in a wall."""
    rows, cols = problem.exposure.shape
    passable = problem.less_gain(problem.passable)
    if not (0 <= cell[0] < rows and 0 <= cell[1] < cols) or math.isinf(passable[cell]):
        return None
    return kernels.spread(passable, (cell,), problem.w, problem.psi_per_cell)


def _costs_from_start(field: kernels.Field, pad: int) -> Floats:
    """Return the cost by Eq. 5 from the start to each cell, infinite in a padding of `pad` cells.

    The field goes the other way: its labels have the exposure of each cell, and that of the start.
    """
    labels = field.label.reshape(field.rows + 2, field.width)
    at_start = labels[field.goals[0] // field.width, field.goals[0] % field.width]
    return np.pad(np.maximum(labels[1:-1, 1:-1] - at_start, 0.0), pad, constant_values=math.inf)
