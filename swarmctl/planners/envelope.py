"""The lower envelope: which routes some w in [0, 1] finds, and where between 0 and 1 they change.

Eq. 5 at w is w·(E + λ·L), with L the length of a route, E its ΣP_s and λ = (1 − w)·ψ/w the price of a cell of
length. Over λ each route is a line, and the routes that some w finds are the corners of the lower envelope of
all lines. They come from each other: where two of them cost the same, one search finds either that nothing
costs less there, so that they are neighbours, or a route between them (Eisner and Severance 1976; for a bound
on one of the two sums Handler and Zang 1980).

Which routes count: those that `dijkstra` gives at some w > 0, the shortest of the cheapest. A route that
costs as much as a shorter one at the only w at which it is the cheapest does not count. Of the shortest
routes of all, equal at w = 0, the least exposed counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import Problem, Searched

COST_TIE = 1e-11
"""A route between two others is new if it costs less than they do by more than this, relatively."""
FIRST_PRICE = 0.5
"""of the shortest route's mean exposure a cell: what length is first tried at"""
PRICE_STEP = 0.25
N_PRICES = 3
"""tried before the search of the least exposed route, which is the hardest of all"""


@dataclass(frozen=True, slots=True)
class Summed:
    """A route and what decides between routes here."""

    cells: tuple[Cell, ...]
    length_cells: float
    exposure_sum: float

    def cost(self, price: float) -> float:
        """E + λ·L"""
        return self.exposure_sum + price * self.length_cells


@dataclass(frozen=True, slots=True)
class Edge:
    """Two routes that cost the same at `price`, and the field of the search there."""

    short: Summed
    long: Summed
    price: float
    field: kernels.Field


@dataclass(frozen=True, slots=True)
class Bracket:
    """The last route within a bound on length, and the first beyond it."""

    short: Summed
    long: Summed | None
    """None if the least exposed route of all is within the bound"""
    price: float
    field: kernels.Field | None
    """of the searches where two routes cross, the one that proves most: no route within the bound is less
    exposed than its cost − price · bound. None if there was none, for `short` is the least exposed."""


class Sweep:
    """Searches for one problem at one price of length after the other."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.passable = problem.passable
        self.searched: list[Searched] = []

    def search(self, price: float) -> tuple[Summed, kernels.Field]:
        """The cheapest route at a price of length, from 0 (the least exposed route) to infinite (the
        shortest).

        Of equally cheap ones it is the shortest. Raises Unreachable.
        """
        # At w = 1/2 ψ is the price, without the rounding that w itself would bring.
        w, psi = {math.inf: (0.0, 1.0), 0.0: (1.0, 0.0)}.get(price, (0.5, price))
        field = kernels.spread(self.passable, self.problem.goals, w, psi)
        if math.isinf(field.cost_of(self.problem.start)):
            raise self.problem.unreachable()
        found = self.summed(field.run_down(self.problem.start))
        self.searched.append(Searched(self.weight(price), found.length_cells, found.exposure_sum))
        return found, field

    def summed(self, cells: tuple[Cell, ...]) -> Summed:
        """A route with its two sums, exactly, not from a field."""
        exposure_sum = measures.exposure_sum(self.problem.exposure, cells)
        return Summed(cells, measures.length_cells(cells), exposure_sum)

    def weight(self, price: float) -> float:
        """w at which Eq. 5 has this price of length; where ψ = 0, the limit for a ψ that vanishes."""
        if price == 0.0:
            return 1.0
        return 0.0 if math.isinf(price) else self.problem.psi_per_cell / (self.problem.psi_per_cell + price)

    def bracket(self, short: Summed, bound_cells: float, enough: float = 0.0) -> Bracket:
        """The two neighbours with a bound on length between them; `short` is a shortest route, within it.

        With `enough` it ends early, where at most this share of the exposure of `short` is still to be gained
        within the bound: then there may be others between the two.
        """
        short, long = self._spread_out(short, bound_cells)
        proof: tuple[float, kernels.Field | None] = (0.0, None)
        proved = -math.inf
        while long is not None and (price := _crossing(short, long)) > 0.0:
            found, field = self.search(price)
            least = found.cost(price) - price * bound_cells
            if least > proved:
                proved, proof = least, (price, field)
            if not _is_new(found, short, price):
                break
            if found.length_cells <= bound_cells:
                short = found
            else:
                long = found
            if short.exposure_sum - proved <= enough * short.exposure_sum:
                break
        return Bracket(short, long, *proof)

    def edges(self, short: Summed, long: Summed, window: tuple[float, float]) -> Iterator[Edge]:
        """All neighbours from the shortest to the least exposed route, as far as they reach into a window of
        lengths [cells]. Nothing costs less where they cross."""
        ahead = [long]
        while ahead and short.length_cells <= window[1]:
            long = ahead[-1]
            price = _crossing(short, long)
            if not price > 0.0 or long.length_cells < window[0]:
                short = ahead.pop()
                continue
            found, field = self.search(price)
            if _is_new(found, short, price):
                ahead.append(found)
                continue
            yield Edge(short, long, price, field)
            short = ahead.pop()

    def _spread_out(self, short: Summed, bound_cells: float) -> tuple[Summed, Summed | None]:
        """Cheaper and cheaper length until the route is too long; the last one before that, and this one."""
        price = FIRST_PRICE * short.exposure_sum / max(short.length_cells, 1.0)
        prices = [price * PRICE_STEP**k for k in range(N_PRICES)] if price > 0.0 else []
        for price in [*prices, 0.0]:
            found, _ = self.search(price)
            if found.length_cells > bound_cells:
                return short, found
            short = found
        return short, None


def _crossing(short: Summed, long: Summed) -> float:
    """The price of length at which two routes cost the same; 0 or less, or infinite, if the first one is
    dominated or there is none."""
    longer = long.length_cells - short.length_cells
    if longer <= kernels.LENGTH_TIE:
        return 0.0
    return (short.exposure_sum - long.exposure_sum) / longer


def _is_new(found: Summed, crossing: Summed, price: float) -> bool:
    """Whether it costs less than the two that cross at the price where it was found."""
    return found.cost(price) < crossing.cost(price) * (1.0 - COST_TIE)
