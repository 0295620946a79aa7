"""Searches in w for the least exposed route within a bound on length (Figure 7), one Dijkstra a try. Pure.

The paper searches "in the space of w" without a method, and describes methods of search in its section 2.
Each method here proposes values of w, and receives the fitness of the route at this w. `search` counts the
tries and keeps the best route. No vehicle flies by these methods: planner `time_bound` finds the best route
of all w, and planner `constrained` the best route of all. A new method is a function here and a line in
`METHODS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping

import msgspec
import numpy as np

from swarmctl.core.records import replace
from swarmctl.planners import BoundTooTight, Problem, Route, plan
from swarmctl.planners.kernels import LENGTH_TIE

Proposals = Generator[float, float, None]
"""a method at work: yields a w, receives the fitness of its route; it ends when it has nothing to try"""

HOTTEST, COLDEST = 0.3, 0.003
"""first and last temperature of simulated annealing, in units of fitness"""


class Found(msgspec.Struct, frozen=True):
    """The routes of a search in w, in the order of the tries."""

    tried: tuple[Route, ...]
    """the first is the shortest route, w = 0"""
    max_length_cells: float

    @property
    def best(self) -> Route:
        """The least exposed of the tried routes within the bound; among equal routes the shortest."""
        within = [route for route in self.tried if route.length_cells <= self.max_length_cells + LENGTH_TIE]
        return min(within, key=lambda route: (route.exposure_sum, route.length_cells))


def search(problem: Problem, method: str, searches: int, step: float, rng: np.random.Generator) -> Found:
    """Return the routes that a method tries with at most this many searches.

    Every method begins with the shortest route, w = 0: it shows whether any route keeps the bound, and it is
    the answer until a better route is found. `step` is the distance of neighbours in w.

    Raises Unreachable, and BoundTooTight if the shortest route is too long.
    """
    tried = [plan(replace(problem, w=0.0))]
    shortest = tried[0]
    if shortest.length_cells > problem.max_length_cells + LENGTH_TIE:
        raise BoundTooTight("the shortest route is longer than the bound", shortest)

    def fitness(route: Route) -> float:
        """Return 1 minus the share of the shortest route's ΣP_s; below 0 for a route beyond the bound."""
        excess = route.length_cells - problem.max_length_cells
        if excess > LENGTH_TIE:
            return -excess / max(shortest.length_cells, 1.0)
        return 1.0 - route.exposure_sum / (shortest.exposure_sum or 1.0)

    proposals = METHODS[method](searches, step, rng)
    w = next(proposals, None)
    while w is not None and len(tried) < searches:
        tried.append(plan(replace(problem, w=w)))
        try:
            w = proposals.send(fitness(tried[-1]))
        except StopIteration:
            break
    return Found(tuple(tried), problem.max_length_cells)


def _fixed_grid(searches: int, _step: float, _rng: np.random.Generator) -> Proposals:
    """Propose values of w in equal steps up to 1."""
    for k in range(1, searches):
        yield k / (searches - 1)


def _hill_climbing(_searches: int, step: float, _rng: np.random.Generator) -> Proposals:
    """Climb once, from the middle: w = 0.5."""
    yield from _climb(0.5, step)


def _iterated_hill_climbing(_searches: int, step: float, rng: np.random.Generator) -> Proposals:
    """Climb again and again, from random values of w."""
    while True:
        yield from _climb(float(rng.random()), step)


def _stochastic_hill_climbing(_searches: int, step: float, rng: np.random.Generator) -> Proposals:
    """Go from a random w to random neighbours that are better."""
    here = float(rng.random())
    best = yield here
    while True:
        neighbour = _random_neighbour(here, step, rng)
        found = yield neighbour
        if found > best:
            here, best = neighbour, found


def _simulated_annealing(searches: int, step: float, rng: np.random.Generator) -> Proposals:
    """Go from a random w to random neighbours: better ones, and with a falling chance worse ones."""
    here = float(rng.random())
    fitness = yield here
    for k in range(searches):
        temperature = HOTTEST * (COLDEST / HOTTEST) ** (k / max(searches - 1, 1))
        neighbour = _random_neighbour(here, step, rng)
        found = yield neighbour
        if found >= fitness or rng.random() < math.exp((found - fitness) / temperature):
            here, fitness = neighbour, found


def _climb(here: float, step: float) -> Proposals:
    """Climb by steepest ascent until neither neighbour is better."""
    fitness = yield here
    directions = [-step, step]
    while directions:
        found = {}
        for direction in directions:
            if 0.0 <= here + direction <= 1.0:
                found[direction] = yield here + direction
        if not found or max(found.values()) <= fitness:
            return
        # The neighbour behind is known and worse: only the direction of the best neighbour is left.
        directions = [max(found, key=found.__getitem__)]
        here, fitness = here + directions[0], found[directions[0]]


def _random_neighbour(here: float, step: float, rng: np.random.Generator) -> float:
    """Return a w at most one step away, reflected at 0 and 1."""
    w = abs(here + step * float(rng.uniform(-1.0, 1.0)))
    return 2.0 - w if w > 1.0 else w


METHODS: Mapping[str, Callable[[int, float, np.random.Generator], Proposals]] = {
    "fixed_grid": _fixed_grid,
    "hill_climbing": _hill_climbing,
    "iterated_hill_climbing": _iterated_hill_climbing,
    "stochastic_hill_climbing": _stochastic_hill_climbing,
    "simulated_annealing": _simulated_annealing,
}
