"""Planners: pure plug-ins that answer a `Problem` with a `Route`.

A planner is one module with a frozen dataclass `Params` and a function `plan(problem, params)`, and one line
in `PLANNERS`. Imports core, numpy and numba, and nothing that does I/O; all compiled code is in `kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.planners import dijkstra
from swarmctl.planners.base import BadProblem, Planner, Problem, Route, Unreachable
from swarmctl.planners.kernels import warm_up

PLANNERS: Mapping[str, Planner] = {
    "dijkstra": dijkstra,
}

__all__ = ["PLANNERS", "BadProblem", "Planner", "Problem", "Route", "Unreachable", "warm_up"]
