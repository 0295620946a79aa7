"""Exact replanning in a large area that becomes known cell by cell, by a search of a small part.

An observation changes P_s much in a few cells, and a little everywhere, because the cells not seen share the
remaining hostiles. The new route is nearly always near the old route. A replan has these steps:

1. Take a rough route by an older field of the whole area. Search a box around the route with the new costs.
2. Prove that no route that leaves the box is cheaper. A search gives the cost from the start to each cell of
   the box's rim. The older field gives a lower bound from the rim to a goal. This bound is scaled by the
   least ratio of new to old costs, and lowered where cells have become cheaper.
3. If there is no proof, enlarge the box. If the box is too large, search the whole area. The next replans use
   the new field as their older field.

The route equals the route of a search of the whole area, ties included.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners.base import BadProblem, Unreachable, checked_cell, checked_field
from swarmctl.planners.kernels import bounds
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.large_field import LargeField, compilable, spread_large
from swarmctl.planners.kernels.lattice import Floats

FIRST_MARGIN_CELLS = 12
"""distance from the rough route to the edge of the first box"""
LARGEST_BOX_SHARE = 0.25
"""largest box, as a share of the area; above this share the whole area is searched"""
SAMPLE_STRIDE = 997
"""distance between two cells sampled for a common change of all costs [cells]"""
WHOLE = slice(None)
MAX_LABEL_RATIO = 4096.0
"""greatest ratio of an old label to the lowered label; a greater ratio leaves too few digits for a bound"""
PROOF_RATIO = 1.0 + 1e-9
"""least ratio of the cost of leaving the box to the cost inside, above 1 because sums are rounded"""


@dataclass(slots=True, eq=False)
class Layers:
    """P_s in two layers, `known + p_unseen · unseen`, each of shape (rows, cols).

    The sum is Eq. 3 with p_O by Eq. 4. `known` is the exposure to the cells seen. `unseen` is the kernel's
    weight of the cells not seen, and `p_unseen` the p_O of each of them. An infinite `known` is a wall. The
    owner of the layers changes them in place and calls `Replanner.changed` with the cells.
    """

    known: NDArray[np.float64]
    unseen: NDArray[np.float64]
    p_unseen: float

    @classmethod
    def of(cls, exposure: Floats) -> Layers:
        """Return layers in which all cells are seen."""
        return cls(exposure, np.broadcast_to(0.0, exposure.shape), 0.0)

    def within(self, rows: slice, cols: slice, p_unseen: float | None = None) -> Floats:
        """Return P_s of a part of the area."""
        p = self.p_unseen if p_unseen is None else p_unseen
        return self.known[rows, cols] + p * self.unseen[rows, cols]


class Replanner:
    """Routes to one set of goals by Eq. 5, from any start, in a large area that changes.

        exposure = np.full((500, 500), 0.13)             # P_s, (rows, cols)
        replanner = Replanner(exposure, (250, 499), w=0.5, psi_per_cell=0.13)
        replanner.route((250, 0))                        # cells, both ends included
        exposure[250, 200:203] = 0.6                     # an observation
        replanner.changed([(250, 200), (250, 201), (250, 202)])
        replanner.route((250, 100))                      # searches a small part of the area

    The routes are those of `dijkstra` without a maximum exposure, ties included. `exposure` is an array, or
    `Layers` if all cells not seen have the same p_O. The array is not copied: change it in place and call
    `changed`, or pass another array to `renew`. Raises BadProblem as a Problem does, and for an array that is
    not of native float64, because only a copy of it could be searched.
    """

    def __init__(
        self, exposure: Layers | NDArray[np.float64], goals: Sequence[Cell], w: float, psi_per_cell: float
    ) -> None:
        _require_float64(exposure.known if isinstance(exposure, Layers) else exposure)
        if not isinstance(exposure, Layers):
            exposure = Layers.of(checked_field(exposure, goals, w, psi_per_cell)[0])
        if exposure.known.shape != exposure.unseen.shape:
            raise BadProblem(
                f"layers of shape {exposure.known.shape} and {exposure.unseen.shape}: expected the same"
            )
        self._layers = exposure
        self._w = w
        self._psi = psi_per_cell
        whole, self.goals = checked_field(exposure.within(WHOLE, WHOLE), goals, w, psi_per_cell)
        self._field = LargeField(*whole.shape)
        """older field of the whole area"""
        self._margin = FIRST_MARGIN_CELLS
        self._outdated = False
        self._begin_from(whole)

    @property
    def problem_key(self) -> tuple[tuple[int, ...], tuple[Cell, ...], float, float]:
        """Shape, goals, w and ψ per cell: equal for all problems that this replanner can solve."""
        return self._layers.known.shape, self.goals, self._w, self._psi

    def size(self) -> int:
        """Return the number of cells of the area."""
        return self._layers.known.size

    def changed(self, cells: Iterable[Cell]) -> None:
        """Update the bounds for `cells` whose P_s has changed; a change of p_unseen needs no call.

        Raises BadProblem for a cell outside the area, and for NaN or negative exposure.
        """
        field, p = self._field, self._p_unseen
        for cell in cells:
            row, col = checked_cell("changed cell", cell, self._layers.known)
            m = field.index((row, col))
            exposure = float(self._layers.within(slice(row, row + 1), slice(col, col + 1), p)[0, 0])
            if not exposure >= 0.0:
                raise BadProblem(f"exposure of cell ({row}, {col}) is {exposure}: expected 0 or more")
            straight = self._w * exposure + field.step if math.isfinite(exposure) else math.inf
            if straight < field.straight[m]:  # for a dearer cell the old label is still a lower bound
                self._lower(np.array([m]), np.array([straight]))

    def renew(self, exposure: NDArray[np.float64]) -> None:
        """Replace P_s, shape (rows, cols); the cost of every cell is compared with the older field.

        The array is not copied. Raises BadProblem for a wrong shape, type or value.
        """
        _require_float64(exposure)
        checked_field(exposure, self.goals, self._w, self._psi)
        if exposure.shape != self._layers.known.shape:
            raise BadProblem(
                f"exposure of shape {exposure.shape}: expected {self._layers.known.shape}, as before"
            )
        self._layers = Layers.of(exposure)
        self._p_unseen = 0.0
        self._sampled_ratio, cells, costs = compiled(bounds.compare)(
            compilable(exposure),
            self._w,
            self._field.step,
            self._field.straight,
            SAMPLE_STRIDE,
            exposure.size // 50 + 50,
        )
        self._outdated = self._outdated or self._sampled_ratio == 0.0
        if not self._outdated:
            self._lower(cells, costs)

    def route(self, start: Cell) -> tuple[Cell, ...]:
        """Return the route from `start` after all changes, both ends included.

        Raises Unreachable. Raises BadProblem for a start outside the area, and for an invalid p_unseen or
        exposure.
        """
        start = checked_cell("start", start, self._layers.known)
        if not 0.0 <= self._layers.p_unseen < math.inf:
            raise BadProblem(f"p_unseen is {self._layers.p_unseen}: expected a finite number, 0 or more")
        if start in self.goals:
            self.searched_cells = 0
            return (start,)
        if not self._outdated and math.isfinite(self._layers.known[start]):
            rough = self._rough_route(start)
            margin = self._margin
            while rough.size > 0:
                box = self._box(rough, margin)
                if (box[1] - box[0]) * (box[3] - box[2]) > LARGEST_BOX_SHARE * self._layers.known.size:
                    break
                found = self._route_in_box(box, start)
                if found:
                    self._margin = margin
                    return found
                margin *= 2
        self._search_all()
        if math.isinf(self._field.cost_of(start)):
            raise Unreachable(f"no route leads from {start} to a goal: walls lie between")
        return self._field.route_from(start)

    def _lower(self, cells: NDArray[np.int64], costs: Floats) -> None:
        """Lower the old field's labels of `cells`; `costs` are the new costs of a straight step."""
        if self._outdated:
            return
        old, straight = self._field, np.minimum(costs / self._sampled_ratio, self._field.straight[cells])
        with np.errstate(invalid="ignore"):
            label = old.label[cells] - (old.straight[cells] - straight)
        if not (old.label[cells] <= MAX_LABEL_RATIO * label).all():
            # A wall or a very dear cell has become cheap: the lowered label would be mostly rounding error.
            self._outdated = True
            return
        old.label[cells], old.straight[cells] = label, straight
        self._lowered += cells.tolist()

    def _search_all(self) -> None:
        exposure, _ = checked_field(self._layers.within(WHOLE, WHOLE), self.goals, self._w, self._psi)
        self._begin_from(exposure)

    def _begin_from(self, exposure: Floats) -> None:
        self._field = spread_large(exposure, self.goals, self._w, self._psi, into=self._field)
        self._p_unseen = self._layers.p_unseen
        self._lowered: list[int] = []
        """cells whose lowered label has not been spread to their neighbours yet"""
        self._outdated, self._sampled_ratio = False, 1.0
        self.searched_cells = self._layers.known.size
        """number of cells in the last searched box or area; 0 if the last start was a goal"""

    def _rough_route(self, start: Cell) -> NDArray[np.int64]:
        """Spread lowered labels up to the start; return flat indices of a rough route, empty if none."""
        old, m = self._field, self._field.index(start)
        waiting = np.unique(np.array(self._lowered, dtype=np.int64))
        self._lowered = old.spread_lowered(waiting, float(old.label[m]) * PROOF_RATIO).tolist()
        most = 4 * (old.rows + old.cols)
        path, arrived = compiled(bounds.descend_roughly)(old.label, old.extra, old.width, old.goals, m, most)
        return path if arrived else path[:0]

    def _box(self, route: NDArray[np.int64], margin: int) -> tuple[int, int, int, int]:
        """Return (first row, end row, first column, end column) of the cells within `margin` of a route."""
        rows, cols = route // self._field.width - 1, route % self._field.width - 1
        return (
            max(int(rows.min()) - margin, 0),
            min(int(rows.max()) + margin + 1, self._field.rows),
            max(int(cols.min()) - margin, 0),
            min(int(cols.max()) + margin + 1, self._field.cols),
        )

    def _route_in_box(self, box: tuple[int, int, int, int], start: Cell) -> tuple[Cell, ...]:
        """Return the route in the box; empty unless every route that leaves the box is proved dearer."""
        top, bottom, left, right = box
        goals = [(r - top, c - left) for r, c in self.goals if top <= r < bottom and left <= c < right]
        exposure = self._layers.within(slice(top, bottom), slice(left, right))
        checked_field(exposure, goals, self._w, self._psi)
        field = spread_large(exposure, goals, self._w, self._psi)
        self.searched_cells = exposure.size
        inside = (start[0] - top, start[1] - left)
        cost, old = field.cost_of(inside), self._field
        outside = compiled(bounds.least_cost_outside)(
            field.labels_from(inside), field.rows, field.cols,
            old.label, old.straight, old.width, top, left, old.rows,
            self._valid_below(), self._cost_ratio(),
        )  # fmt: skip
        if not outside > cost * PROOF_RATIO:
            return ()
        return tuple((r + top, c + left) for r, c in field.route_from(inside))

    def _valid_below(self) -> float:
        """Return the label up to which the old labels are lower bounds."""
        return float(self._field.label[self._lowered].min()) if self._lowered else math.inf

    def _cost_ratio(self) -> float:
        """Return a lower bound of new cost / old cost, valid for all cells."""
        if self._layers.p_unseen >= self._p_unseen:
            return self._sampled_ratio
        # The ratio of the costs s + w(K + pU) is least for K = 0 and the greatest pU of the area.
        step, greatest = self._field.step, self._field.greatest
        fallen = step + (greatest - step) * self._layers.p_unseen / self._p_unseen
        return self._sampled_ratio * (fallen / greatest if greatest > 0.0 else 1.0)


def _require_float64(exposure: object) -> None:
    """Raise BadProblem for anything but an array of native float64, because only a copy could be searched."""
    if not isinstance(exposure, np.ndarray) or exposure.dtype != np.float64:
        kind = getattr(exposure, "dtype", None)
        found = f"a {type(exposure).__name__}" if kind is None else f"an array of {kind}"
        raise BadProblem(
            f"exposure is {found}: expected an array of float64, as the planner keeps it without a copy; "
            "give np.array(exposure, dtype=np.float64)"
        )
