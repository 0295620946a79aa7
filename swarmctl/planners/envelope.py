"""The lower envelope: the routes that are cheapest at some w in [0, 1], and the w at which the route changes.

Eq. 5 at w is w·(E + λ·L). L is the length of a route and E is its ΣP_s. λ = (1 − w)·ψ/w is the price of a
cell of length. The cost of a route over λ is a line. The routes that are cheapest at some w are the lines of
the lower envelope. Two of these routes cost the same at one price. A search at this price finds a route
between the two, or proves that the two are neighbours (Eisner and Severance 1976; with a bound on one of the
sums, Handler and Zang 1980).

The envelope has the routes that `dijkstra` returns at some w > 0: the shortest of the cheapest routes. A
longer route that is equally cheap at a single w is left out. At w = 0 all shortest routes cost the same; the
envelope has the least exposed of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec

from swarmctl.core import exposure as measures
from swarmctl.core.grid import Cell
from swarmctl.planners import kernels
from swarmctl.planners.base import Problem, Searched

COST_TIE = 1e-11
"""least relative saving at which a found route counts as cheaper than two known routes of equal cost"""
FIRST_PRICE_SHARE = 0.5
"""first price of length, as a share of the shortest route's ΣP_s per cell of length"""
PRICE_RATIO = 0.25
"""ratio of a price to the previous price"""
N_PRICES = 3
"""number of prices above 0 before the search at price 0, which takes the most time"""


class SummedRoute(msgspec.Struct, frozen=True):
    """A route and its two sums."""

    cells: tuple[Cell, ...]
    length_cells: float
    exposure_sum: float

    def cost(self, price: float) -> float:
        """Return E + λ·L."""
        return self.exposure_sum + price * self.length_cells


class Edge(msgspec.Struct, frozen=True):
    """Two neighbours of the envelope, the price at which both cost the same, and the field at that price."""

    short: SummedRoute
    long: SummedRoute
    price: float
    field: kernels.Field


class Bracket(msgspec.Struct, frozen=True):
    """A route of the envelope within a bound on length, and a longer route beyond the bound."""

    short: SummedRoute
    long: SummedRoute | None
    """None if the least exposed route of all is within the bound"""
    price: float
    """price of length in `field`"""
    field: kernels.Field | None
    """The field of the highest lower bound on exposure. The lower bound is cost − price · bound on length.
    None if `short` is the least exposed route of all."""


class Envelope:
    """The lower envelope of one problem, from searches at several prices of length."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.passable = problem.passable
        self.searched: list[Searched] = []

    def search(self, price: float) -> tuple[SummedRoute, kernels.Field]:
        """Return the cheapest route at a price of length, and the field; among equal routes the shortest.

        Price 0 gives the least exposed route, an infinite price the shortest. Raises Unreachable.
        """
        # With w = 1/2 and ψ = price, Eq. 5 has this price exactly, without rounding.
        w, psi = {math.inf: (0.0, 1.0), 0.0: (1.0, 0.0)}.get(price, (0.5, price))
        field = kernels.spread(self.passable, self.problem.goals, w, psi)
        if math.isinf(field.cost_of(self.problem.start)):
            raise self.problem.unreachable()
        found = self.summed(field.route_from(self.problem.start))
        self.searched.append(Searched(self.weight(price), found.length_cells, found.exposure_sum))
        return found, field

    def summed(self, cells: tuple[Cell, ...]) -> SummedRoute:
        """Return a route with its two sums, computed from the cells."""
        exposure_sum = measures.exposure_sum(self.problem.exposure, cells)
        return SummedRoute(cells, measures.length_cells(cells), exposure_sum)

    def weight(self, price: float) -> float:
        """Return the w at which Eq. 5 has this price of length; for ψ = 0 the limit of ψ → 0."""
        if price == 0.0:
            return 1.0
        return 0.0 if math.isinf(price) else self.problem.psi_per_cell / (self.problem.psi_per_cell + price)

    def bracket(self, short: SummedRoute, bound_cells: float, accepted_gap: float = 0.0) -> Bracket:
        """Return the routes on both sides of a bound on length.

        `short` is the shortest route, and within the bound. The search ends at two neighbours, or earlier if
        no route within the bound can be less exposed by more than the share `accepted_gap`.
        """
        short, long = self._lower_price(short, bound_cells)
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
            if short.exposure_sum - proved <= accepted_gap * short.exposure_sum:
                break
        return Bracket(short, long, *proof)

    def edges(self, short: SummedRoute, long: SummedRoute, window: tuple[float, float]) -> Iterator[Edge]:
        """Yield the pairs of neighbours that reach into a window of lengths [cells], by rising length."""
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

    def _lower_price(self, short: SummedRoute, bound_cells: float) -> tuple[SummedRoute, SummedRoute | None]:
        """Lower the price of length until a route is beyond the bound.

        Return the last route within the bound, and the route beyond the bound, or None.
        """
        price = FIRST_PRICE_SHARE * short.exposure_sum / max(short.length_cells, 1.0)
        prices = [price * PRICE_RATIO**k for k in range(N_PRICES)] if price > 0.0 else []
        for price in [*prices, 0.0]:
            found, _ = self.search(price)
            if found.length_cells > bound_cells:
                return short, found
            short = found
        return short, None


def _crossing(short: SummedRoute, long: SummedRoute) -> float:
    """Return the price of length at which two routes cost the same.

    The price is 0 or less if the second route is no longer, or not less exposed, than the first.
    """
    longer = long.length_cells - short.length_cells
    if longer <= kernels.LENGTH_TIE:
        return 0.0
    return (short.exposure_sum - long.exposure_sum) / longer


def _is_new(found: SummedRoute, known: SummedRoute, price: float) -> bool:
    """Return whether a found route is cheaper at a price than a known route."""
    return found.cost(price) < known.cost(price) * (1.0 - COST_TIE)
