"""The route of the greatest safety factor ∏(1 − P_s), by the least Σ −ln(1 − P_s)."""

# ERRATUM: the paper holds that the route of least ΣP_s "would also be the one that gives the maximum value of
# the safety factor". Counterexample: one cell of 0.50 has a smaller sum than two cells of 0.26, but a smaller
# safety factor too (0.500 against 0.548). The correct sum is Σ −ln(1 − P_s), which is close to ΣP_s for small
# P_s. The paper's planner is `dijkstra` at w = 1.

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import Problem, Route, is_open, route_of

CERTAIN_LOSS = 1e6
"""Cost of a cell of P_s ≥ 1, instead of −ln(0) = ∞. The other cells of a usual route cost less together, so
the route enters as few such cells as possible. A cell of infinite P_s is a wall."""

USES_W = False
NEEDS_MACHINE_CODE = False
KEEPS_LONGEST = False
KEEPS_SHORTEST = False


class Params(msgspec.Struct, frozen=True):
    """No parameters."""


def plan(problem: Problem, _params: Params) -> Route:
    """Return the route of least cost Σ −ln(1 − P_s); among equal routes the shortest.

    `w`, ψ and bounds on length have no influence. Raises Unreachable.
    """
    field = kernels.spread(_losses(problem.passable), problem.goals, 1.0, 0.0)
    if math.isinf(field.cost_of(problem.start)):
        raise problem.unreachable()
    cells = field.route_from(problem.start)
    return route_of(problem, cells, _sum(problem, cells))


def measure(problem: Problem, cells: Sequence[Cell], _params: Params) -> float:
    """Return Σ −ln(1 − P_s), with CERTAIN_LOSS for a cell of P_s ≥ 1; infinite through a wall."""
    return _sum(problem, cells) if is_open(problem, cells) else math.inf


def _losses(exposure: NDArray[np.float64]) -> NDArray[np.float64]:
    losses = np.where(np.isinf(exposure), math.inf, CERTAIN_LOSS)
    survivable = exposure < 1.0
    losses[survivable] = -np.log1p(-exposure[survivable])
    return losses


def _sum(problem: Problem, cells: Sequence[Cell]) -> float:
    entered = np.array([problem.exposure[cell] for cell in cells[1:]])
    return math.fsum(_losses(entered))
