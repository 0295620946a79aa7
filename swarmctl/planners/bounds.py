"""The bounds of a problem on length: the check of a route, and the errors if no route keeps the bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import BoundTooTight, Problem, Route


def window(problem: Problem) -> tuple[float, float]:
    """Return the least and the greatest length [cells], widened by the rounding error of a length.

    Two different lengths on the grid differ by more than this error.
    """
    return problem.min_length_cells - kernels.LENGTH_TIE, problem.max_length_cells + kernels.LENGTH_TIE


def keeps(problem: Problem, cells: Sequence[Cell]) -> bool:
    """Return whether the length of a route is within the bounds."""
    least, greatest = window(problem)
    return least <= measures.length_cells(cells) <= greatest


def shortest_too_long(problem: Problem, shortest: Route) -> BoundTooTight:
    """Return the error that the shortest route is too long."""
    return BoundTooTight(
        f"no route is at most {problem.max_length_cells:.2f} cells long; raise the bound to the length of "
        f"the shortest route, {shortest.length_cells:.2f} cells",
        shortest,
    )


def none_between(problem: Problem, what: str, nearest: Route) -> BoundTooTight:
    """Return the error that all routes are too short or too long; `what` names the routes considered."""
    allowed = f"{problem.min_length_cells:.2f} or more cells"
    if not math.isinf(problem.max_length_cells):
        allowed = f"{problem.min_length_cells:.2f} to {problem.max_length_cells:.2f} cells"
    return BoundTooTight(
        f"{what} is {allowed} long; widen the bounds to the nearest length, {nearest.length_cells:.2f} cells",
        nearest,
    )
