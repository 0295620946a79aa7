"""Planners: pure plug-ins that answer a `Problem` with a `Route`.

A planner is one module with a frozen dataclass `Params`, the functions `plan(problem, params)` and
`measure(problem, cells, params)`, and one line in `PLANNERS`. Imports core, numpy and numba, and nothing that
does I/O; all compiled code is in `kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.planners import dijkstra
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
from swarmctl.planners.kernels import warm_up

PLANNERS: Mapping[str, Planner] = {
    "dijkstra": dijkstra,
}

__all__ = [
    "PLANNERS",
    "BadProblem",
    "BoundTooTight",
    "Method",
    "Planner",
    "Problem",
    "Route",
    "Searched",
    "Unreachable",
    "method",
    "warm_up",
]
