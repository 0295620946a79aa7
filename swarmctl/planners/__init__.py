"""Planners: pure plug-ins that answer a `Problem` with a `Route`; of use without the rest of the package.

    import numpy as np
    from swarmctl.planners import Problem, cost_to_go, pareto_front, plan

    exposure = np.random.default_rng(1).random((200, 300)) * 0.3   # P_s, (rows, cols), no unit
    problem = Problem(exposure, start=(100, 0), goals=((100, 299),), w=0.5, psi_per_cell=0.13)
    plan(problem)                                                  # Eq. 5: a Route of (row, col) cells
    plan(Problem(exposure, (100, 0), ((100, 299),), 0.5, 0.13, max_length_cells=310), "constrained")
    pareto_front(problem)                                          # all of length against exposure
    cost_to_go(exposure, [(100, 299)], w=0.5, psi_per_cell=0.13)   # for every start at once

Rows and columns are indices of plain arrays, lengths are in cells (√2 for a diagonal step), ψ is what a cell
of length costs. A cell that must not be entered has an infinite exposure. `Replanner` plans again and again
while the area becomes known. All of it holds no interpreter lock while it searches.

A planner is one module with a frozen dataclass `Params`, the constant `USES_W`, the functions
`plan(problem, params)` and `measure(problem, cells, params)`, and one line in `PLANNERS`. Imports core, numpy
and numba, and nothing that does I/O; all compiled code is in `kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.planners import constrained, dijkstra, kernels, survival, time_bound
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
from swarmctl.planners.replan import Layers, Replanner

PLANNERS: Mapping[str, Planner] = {
    "dijkstra": dijkstra,
    "time_bound": time_bound,
    "constrained": constrained,
    "survival": survival,
}


def plan(problem: Problem, planner: str = "dijkstra", **options: object) -> Route:
    """The best route by the planner of this name and its options (the fields of its `Params`).

    Raises Unreachable, and BoundTooTight where the bounds of the problem allow none; ValueError for a planner
    or an option that is not there.
    """
    if planner not in PLANNERS:
        raise ValueError(f"no planner {planner!r}; there is {', '.join(sorted(PLANNERS))}")
    return method(planner, PLANNERS[planner], options).plan(problem)


def warm_up() -> None:
    """Compiles all kernels or loads them from the cache: no vehicle shall wait for a compiler in flight."""
    kernels.warm_up()
    kernels.warm_up_bounds()
    kernels.warm_up_labels()


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
    "pareto_front",
    "plan",
    "warm_up",
]
