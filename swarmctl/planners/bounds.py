"""Whether a route keeps the bounds on length of a problem, and the errors where none does."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import BoundTooTight, Problem, Route


def window(problem: Problem) -> tuple[float, float]:
    """The least and the greatest length [cells], widened by what rounding may have taken off a bound: two
    lattice lengths differ by more on any real area."""
    return problem.min_length_cells - kernels.LENGTH_TIE, problem.max_length_cells + kernels.LENGTH_TIE


def keeps(problem: Problem, cells: Sequence[Cell]) -> bool:
    """Whether a route is as long as the problem asks for."""
    least, greatest = window(problem)
    return least <= measures.length_cells(cells) <= greatest


def shortest_too_long(problem: Problem, shortest: Route) -> BoundTooTight:
    """The error that not even the shortest route is short enough."""
    return BoundTooTight(
        f"no route is at most {problem.max_length_cells:.2f} cells long: the shortest one takes "
        f"{shortest.length_cells:.2f} cells; allow as much",
        shortest,
    )


def none_between(problem: Problem, what: str, nearest: Route) -> BoundTooTight:
    """The error that some routes are too short and the others too long; `what` says which were looked at."""
    asked = f"{problem.min_length_cells:.2f} or more cells"
    if not math.isinf(problem.max_length_cells):
        asked = f"{problem.min_length_cells:.2f} to {problem.max_length_cells:.2f} cells"
    return BoundTooTight(
        f"{what} is {asked} long: the nearest one takes {nearest.length_cells:.2f} cells; widen the window",
        nearest,
    )
