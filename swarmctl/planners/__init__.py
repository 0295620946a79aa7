"""Planners: pure plug-ins that answer a `Problem` with a `Route`.

A planner is one module with a frozen dataclass `Params`, the functions `plan(problem, params)` and
`measure(problem, cells, params)`, and one line in `PLANNERS`. Imports core, numpy and numba, and nothing that
does I/O; all compiled code is in `kernels`.
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
from swarmctl.planners.front import Front, pareto_front

PLANNERS: Mapping[str, Planner] = {
    "dijkstra": dijkstra,
    "time_bound": time_bound,
    "constrained": constrained,
    "survival": survival,
}


def warm_up() -> None:
    """Compiles all kernels or loads them from the cache: no vehicle shall wait for a compiler in flight."""
    kernels.warm_up()
    kernels.warm_up_labels()


__all__ = [
    "PLANNERS",
    "BadProblem",
    "BoundTooTight",
    "Front",
    "Method",
    "Planner",
    "Problem",
    "Route",
    "Searched",
    "Unreachable",
    "method",
    "pareto_front",
    "warm_up",
]
