"""Planners: pure plug-ins that answer a `Problem` with a `Route`.

    import numpy as np
    from swarmctl.planners import Problem, cost_to_go, pareto_front, plan

    exposure = np.random.default_rng(1).random((200, 300)) * 0.3   # P_s, (rows, cols), no unit
    problem = Problem(exposure, start=(100, 0), goals=((100, 299),), w=0.5, psi_per_cell=0.13)
    plan(problem)                                                  # Eq. 5: a Route of (row, col) cells
    plan(Problem(exposure, (100, 0), ((100, 299),), 0.5, 0.13, max_length_cells=310), "constrained")
    pareto_front(problem)                                          # all trade-offs of length and exposure
    cost_to_go(exposure, [(100, 299)], w=0.5, psi_per_cell=0.13)   # from every start at once

Rows and columns are indices of plain arrays. Lengths are in cells, √2 for a diagonal step, and ψ is the cost
of one cell of length. A cell of infinite exposure is a wall. `Replanner` plans again while the area becomes
known.

Small areas need no compiler. Large areas are searched by numba's machine code, without the interpreter lock.
Benevolence and `formation` need the machine code on any area.
`warm_up` compiles this code once (about 10 s) for this and all later processes. `kernels` has all searches.

A planner is one module with a frozen `msgspec.Struct` named `Params`, the constants of `base.Planner`, the
functions `plan(problem, params)` and `measure(problem, cells, params)`, and one line in `PLANNERS`. Of
`swarmctl` the planners import only `core`. `meeting.split` compares a group with its members alone, and
`split_route` plans for a group that may split.
"""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.planners import constrained, dijkstra, formation, survival, time_bound
from swarmctl.planners.base import (
    BadProblem,
    BoundTooTight,
    Method,
    Planner,
    Problem,
    Route,
    Searched,
    Unreachable,
    method,
)
from swarmctl.planners.dijkstra import CostToGo, cost_to_go
from swarmctl.planners.front import Front, pareto_front
from swarmctl.planners.kernels import is_small
from swarmctl.planners.kernels.warm_up import warm_up
from swarmctl.planners.replan import Layers, Replanner

PLANNERS: Mapping[str, Planner] = {
    "dijkstra": dijkstra,
    "time_bound": time_bound,
    "constrained": constrained,
    "survival": survival,
    "formation": formation,
}


def needs_machine_code(n_cells: int, planner: str, benevolence: float) -> bool:
    """Return whether vehicles over an area of this size plan by machine code."""
    return not is_small(n_cells) or PLANNERS[planner].NEEDS_MACHINE_CODE or benevolence > 0.0


def plan(problem: Problem, planner: str = "dijkstra", **options: object) -> Route:
    """Return the best route by the planner of this name; `options` are fields of its `Params`.

    Raises Unreachable, BoundTooTight if the planner finds no route within the bounds, and BadProblem. Raises
    ValueError for an unknown planner or an invalid option.
    """
    if planner not in PLANNERS:
        raise ValueError(f"no planner {planner!r}; the planners are {', '.join(sorted(PLANNERS))}")
    return method(planner, PLANNERS[planner], options).plan(problem)


__all__ = [
    "PLANNERS",
    "BadProblem",
    "BoundTooTight",
    "CostToGo",
    "Front",
    "Layers",
    "Method",
    "Planner",
    "Problem",
    "Replanner",
    "Route",
    "Searched",
    "Unreachable",
    "cost_to_go",
    "method",
    "needs_machine_code",
    "pareto_front",
    "plan",
    "warm_up",
]
