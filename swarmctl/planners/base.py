"""The interface of a planner: the problem, and the route as its answer."""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Protocol

import msgspec
import numpy as np
from msgspec.structs import force_setattr
from numpy.typing import NDArray

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.core.split import SplitPlan

MAX_FINITE = 1e200
"""greatest finite exposure, and greatest ψ; their sums over any route are finite too"""


class BadProblem(ValueError):
    """An invalid problem, for example with a negative exposure."""


class Unreachable(ValueError):
    """A problem without a route from the start to a goal."""


class BoundTooTight(Unreachable):
    """A problem without a route within the bounds; `nearest` is the found route with the nearest length."""

    def __init__(self, text: str, nearest: Route) -> None:
        super().__init__(text)
        self.nearest = nearest


class Problem(msgspec.Struct, frozen=True, eq=False):
    """A search for the best route from `start` to one of `goals`. Raises BadProblem for invalid values.

    exposure: P_s, shape (rows, cols), 0 or more, infinite in walls; an array of float64 is not copied
    start: a cell (row, col)
    goals: a cell or several cells
    w: distance anxiety in [0, 1]; 0 gives the shortest route, 1 the least exposed route
    psi_per_cell: ψ, the cost of one cell of length
    max_exposure: greatest P_s that a route enters; a cell of greater P_s is a wall too
    gain: gain of each cell that a route enters, (rows, cols), 0 or more, taken off the cell's w·P_s in Eq. 5
        (`benevolence`); None: no gains
    min_length_cells, max_length_cells: bounds on the route's length [cells], for planners that keep bounds;
        at the vehicle's speed these are a time bound or an arrival window

    No route enters a wall or passes a wall's corner diagonally. A route that starts in a wall may leave the
    wall in any direction. Planners that do not follow Eq. 5 ignore `w`, `psi_per_cell` and `gain`.
    """

    exposure: NDArray[np.float64]
    start: Cell
    goals: tuple[Cell, ...]
    w: float
    # ERRATUM: a paragraph of the paper's results swaps the two ends ("for w = 0 the paths with least ...
    # probability sums, but with maximum distances"). Eq. 5 and section 3 decide.
    psi_per_cell: float
    max_exposure: float = math.inf
    min_length_cells: float = 0.0
    max_length_cells: float = math.inf
    gain: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        exposure, goals = checked_field(self.exposure, self.goals, self.w, self.psi_per_cell)
        for name, value in (
            ("exposure", exposure),
            ("goals", goals),
            ("start", checked_cell("start", self.start, exposure)),
        ):
            force_setattr(self, name, value)
        if not _number("maximum exposure", self.max_exposure) >= 0.0:
            raise BadProblem(f"maximum exposure {self.max_exposure}: expected 0 or more")
        least = _number("least length", self.min_length_cells)
        if not 0.0 <= least <= _number("greatest length", self.max_length_cells):
            raise BadProblem(
                f"a route of {self.min_length_cells} to {self.max_length_cells} cells: expected two lengths "
                "of 0 or more, the shorter first"
            )
        if self.gain is not None and not (self.gain.shape == exposure.shape and self.gain.min() >= 0.0):
            raise BadProblem(f"gain of shape {self.gain.shape}: expected {exposure.shape}, each 0 or more")

    @property
    def passable(self) -> NDArray[np.float64]:
        """P_s for searches, also infinite in cells above `max_exposure`."""
        if math.isinf(self.max_exposure):
            return self.exposure
        return np.where(self.exposure > self.max_exposure, math.inf, self.exposure)

    def less_gain(self, exposure: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return max(0, P_s − gain / w), the exposure that gives Eq. 5 with the gains. No gains: the same.

        DEVIATION: a gain pays for exposure at most, never for distance, so every step costs its distance.
        """
        if self.gain is None or self.w == 0.0:
            return exposure
        return np.maximum(exposure - self.gain / self.w, 0.0)

    def unreachable(self) -> Unreachable:
        """Return the error of a search that found no route."""
        walls = "walls of infinite exposure"
        if not math.isinf(self.max_exposure):
            walls = f"walls, or cells above the maximum exposure of {self.max_exposure:g},"
        return Unreachable(f"no route leads from {self.start} to a goal: {walls} lie between")


class Searched(msgspec.Struct, frozen=True):
    """A search of a planner: its w, and the sums of the route found."""

    w: float
    length_cells: float
    exposure_sum: float


class Route(msgspec.Struct, frozen=True):
    """Neighbouring cells from the start to a goal, both included, and their sums.

    cost: measure that the planner minimises; for `dijkstra` the sum of Eq. 5 over the route
    length_cells: length, √2 for a diagonal step [cells]
    exposure_sum: ΣP_s without the start cell; not a probability
    safety_factor: ∏(1 − P_s) without the start cell; not the probability to survive
    searched: the searches of a planner that searches over w, in order
    lower_bound: proved lower bound on the cost of every route, equal to `cost` if the route is proved
        optimal; None: not computed
    split: the members' own ways of a group that splits at the start; None: it flies together
    """

    cells: tuple[Cell, ...]
    cost: float
    length_cells: float
    exposure_sum: float
    safety_factor: float
    searched: tuple[Searched, ...] = ()
    lower_bound: float | None = None
    split: SplitPlan | None = None


class Planner(Protocol):
    """The interface of a module in `PLANNERS`."""

    @property
    def USES_W(self) -> bool:  # noqa: N802 - a constant of a module
        """True if the routes depend on the problem's w."""

    @property
    def NEEDS_MACHINE_CODE(self) -> bool:  # noqa: N802 - a constant of a module
        """True if the planner needs compiled kernels on small areas, too."""

    @property
    def KEEPS_LONGEST(self) -> bool:  # noqa: N802 - a constant of a module
        """True if the planner keeps `max_length_cells`."""

    @property
    def KEEPS_SHORTEST(self) -> bool:  # noqa: N802 - a constant of a module
        """True if the planner keeps `min_length_cells`."""

    @property
    def Params(self) -> Any:  # noqa: N802 - it is a class, found in a module
        """A frozen `msgspec.Struct` with a default for each field."""

    def plan(self, problem: Problem, params: Any, /) -> Route:
        """Return the best route by this planner's measure. Raises Unreachable and BadProblem."""

    def measure(self, problem: Problem, cells: Sequence[Cell], params: Any, /) -> float:
        """Return the measure that `plan` minimises, for any route from the start to a goal.

        The measure is infinite through a wall, and out of the bounds for planners that keep bounds.
        """


class Method(msgspec.Struct, frozen=True):
    """A planner with its parameters."""

    name: str
    planner: Planner
    params: Any

    def plan(self, problem: Problem) -> Route:
        """Return the best route. Raises Unreachable and BadProblem."""
        return self.planner.plan(problem, self.params)

    def measure(self, problem: Problem, cells: Sequence[Cell]) -> float:
        """Return the measure that `plan` minimises; infinite if the route does not solve the problem."""
        return self.planner.measure(problem, cells, self.params)


def method(name: str, planner: Planner, options: Mapping[str, object]) -> Method:
    """Return a planner with the parameters in `options`. Raises ValueError for an invalid option."""
    known = sorted(planner.Params.__struct_fields__)
    for option in options:
        if option not in known:
            expected = f"its options are {', '.join(known)}" if known else "it has no options"
            raise ValueError(f"planner {name} has no option {option!r}; {expected}")
    try:
        return Method(name, planner, msgspec.convert(dict(options), planner.Params))
    except msgspec.ValidationError as error:
        raise ValueError(f"options of planner {name}: {str(error)[:1].lower()}{str(error)[1:]}") from error


def route_of(problem: Problem, cells: Sequence[Cell], cost: float | None = None) -> Route:
    """Return a route with its sums; `cost` is its planner's measure, None for Eq. 5."""
    # One array serves all sums: converting a thousand tuples holds the interpreter lock.
    path = np.asarray(cells, dtype=np.int64)
    if cost is None:
        cost = eq5_cost(problem, path)
    length, total = measures.length_cells(path), measures.exposure_sum(problem.exposure, path)
    return Route(tuple(cells), cost, length, total, measures.safety_factor(problem.exposure, path))


def eq5_cost(problem: Problem, cells: measures.RouteCells) -> float:
    """Return Σ C_mn over a route (Eq. 5), less the gains."""
    cells = np.asarray(cells, dtype=np.int64)  # once for both sums
    distance = (1.0 - problem.w) * problem.psi_per_cell * measures.length_cells(cells)
    if problem.w == 0.0:
        return distance
    return distance + problem.w * measures.exposure_sum(problem.less_gain(problem.exposure), cells)


def is_open(problem: Problem, cells: Sequence[Cell]) -> bool:
    """Return whether a route over neighbouring cells enters no wall and passes no wall's corner.

    A route that starts in a wall may leave the wall in any direction.
    """
    field, limit = problem.exposure, min(problem.max_exposure, sys.float_info.max)
    for here, there in pairwise(cells):
        touched = [there] if field[here] > limit else [there, (here[0], there[1]), (there[0], here[1])]
        if any(field[cell] > limit for cell in touched if cell != here):
            return False
    return True


def checked_field(
    exposure: object, goals: object, w: float, psi_per_cell: float
) -> tuple[NDArray[np.float64], tuple[Cell, ...]]:
    """Return P_s as an array of floats (rows, cols), and the goals as cells.

    An array of float64 is not copied. Raises BadProblem for values that Eq. 5 does not allow.
    """
    if isinstance(exposure, np.ma.MaskedArray):
        raise BadProblem("exposure is a masked array: expected a plain one, such as exposure.filled(np.inf)")
    array = np.asarray(exposure)
    if array.dtype.kind not in "fiu":
        raise BadProblem(f"exposure of type {array.dtype}: expected an array of numbers")
    array = array.astype(np.float64, copy=False)
    if array.ndim != 2 or array.size == 0:
        raise BadProblem(f"exposure of shape {array.shape}: expected (rows, cols), both at least 1")
    if not (array.min() >= 0.0 and array.max() <= MAX_FINITE):  # quicker than a test of each cell
        unsound = np.argwhere(~((array >= 0.0) & ((array <= MAX_FINITE) | (array == math.inf))))
        if unsound.size:
            row, col = unsound[0].tolist()
            found = float(array[row, col])
            expected = f"at most {MAX_FINITE:g}, or infinite for a wall" if found >= 0.0 else "0 or more"
            raise BadProblem(f"exposure of cell ({row}, {col}) is {found}: expected {expected}")
    if not 0.0 <= _number("distance anxiety w", w) <= 1.0:
        raise BadProblem(f"distance anxiety w = {w}: expected 0 (shortest route) to 1 (least exposed)")
    if not 0.0 <= _number("ψ per cell", psi_per_cell) <= MAX_FINITE:
        raise BadProblem(f"ψ = {psi_per_cell} per cell: expected a finite number, 0 or more")
    return array, _goals(goals, array)


def _goals(goals: object, exposure: NDArray[np.float64]) -> tuple[Cell, ...]:
    several = list(goals) if isinstance(goals, Iterable) else [goals]
    if len(several) == 2 and not any(isinstance(part, Iterable) for part in several):
        several = [goals]  # a single cell
    if not several:
        raise BadProblem("no goal: expected at least one cell")
    return tuple(checked_cell("goal", goal, exposure) for goal in several)


def checked_cell(what: str, cell: object, exposure: NDArray[np.float64]) -> Cell:
    """Return a cell of the area as (row, col). Raises BadProblem; `what` names the cell in the message."""
    try:
        row, col = (operator.index(part) for part in cell)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise BadProblem(f"{what} {cell!r}: expected (row, col), two whole numbers") from None
    rows, cols = exposure.shape
    if not (0 <= row < rows and 0 <= col < cols):
        raise BadProblem(
            f"{what} {(row, col)} is outside the area: expected row 0..{rows - 1} and column 0..{cols - 1}"
        )
    return row, col


def checked_count(what: str, value: object) -> int:
    """Return a whole number, 0 or more. Raises BadProblem; `what` names the number in the message."""
    try:
        count = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        count = -1
    if count < 0:
        raise BadProblem(f"{what} = {value!r}: expected a whole number, 0 or more")
    return count


def _number(what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise BadProblem(f"{what} is {value!r}: expected a number")
    return float(value)
