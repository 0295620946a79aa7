"""The choice of a track's corners among the cells of a lattice route: a search over all straight legs."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec
import numpy as np

from swarmctl.core.any_angle.legs import ENTERED, INTEGRAL, N_MEASURES, Bools, Ints, measure_legs
from swarmctl.core.any_angle.track import CrossedCells, Floats, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.any_angle.turns import arc

MAX_FIRST_SPAN = 32
"""Longest leg in the first round of a search [steps of the route]. Each further round joins legs at the
corners found by the round before. For a route of at most this many steps the number of legs is minimal."""

TIE_TOLERANCE = 1e-9
"""relative difference below which sums count as equal, because of rounding"""

MAX_SEARCHES = 50
"""greatest number of searches; a search is repeated if an arc meets a wall or is worse than its corner"""


class ExposureMeasure(StrEnum):
    """Measures of exposure in which a leg must be no worse than the replaced part of the lattice route."""

    ENTERED = "entered"
    """ΣP_s and ∏(1 − P_s) over the cells entered, and ∫P_s ds and ∫−ln(1 − P_s) ds along the leg. Strikes are
    drawn at each entry into a cell, and a skew leg enters more cells than diagonal steps. So this measure
    does not raise the expected strikes, but straightens little before the first observations"""
    INTEGRAL = "integral"
    """∫P_s ds and ∫−ln(1 − P_s) ds alone. This measure straightens most; tracks enter 25 % more cells"""

    @property
    def rows(self) -> slice:
        """Rows of a table of measures (`swarmctl.core.any_angle.legs`) that must not become worse."""
        return slice(0, N_MEASURES if self is ExposureMeasure.ENTERED else 3)

    def of(self, threat: ThreatMap, under: CrossedCells) -> Floats:
        """Return the exposure of a track in these measures; its first cell does not count as entered."""
        integral = threat.integral(under.cells, under.lengths)
        if self is ExposureMeasure.INTEGRAL:
            return integral
        return np.concatenate((integral, threat.entered(under.cells[1:])))


TurnIndices = tuple[int, int, int]
"""indices, in the route, of three consecutive corners; the turn is at the second corner"""


class Unflyable(ValueError):
    """No track was found over the cells of a route with turns as wide as the vehicle needs."""


class CostWeights(msgspec.Struct, frozen=True):
    """Weights of Eq. 5, for the choice between tracks that are all worse than the route."""

    w: float
    psi_per_cell: float


def choose_corners(
    threat: ThreatMap, route: Ints, measure: ExposureMeasure, radius_cells: float, weights: CostWeights
) -> tuple[int, ...]:
    """Return the corners of a track, both ends included, as indices into `route`.

    `route` is (n, 2) rows and columns of neighbouring cells. The result has the fewest corners with legs and
    arcs no worse than the route (long routes: see MAX_FIRST_SPAN). If no such corners are found, the result
    has the least cost by `weights`. Raises Unflyable.
    """
    search = _Search(threat, route, measure, radius_cells)
    corners = search.no_worse()
    if corners is None:
        corners = search.least_cost(weights)
    if corners is None:
        begin, end = (tuple(cell) for cell in route[[0, -1]].tolist())
        raise Unflyable(
            f"no track over the {len(route)} cells from {begin} to {end} has turns of a radius of "
            f"{radius_cells:.3g} cells and keeps clear of walls"
        )
    return corners


class _Search:
    def __init__(self, threat: ThreatMap, route: Ints, measure: ExposureMeasure, radius: float) -> None:
        self._threat, self._route, self._measure, self._radius = threat, route, measure, radius
        steps = measure_legs(threat, route[:-1], route[1:]).measures
        self._so_far = np.concatenate((np.zeros((N_MEASURES, 1)), np.cumsum(steps, axis=1)), axis=1)
        self._forbidden: set[TurnIndices] = set()

    def no_worse(self) -> tuple[int, ...] | None:
        """Return the fewest corners with legs and arcs no worse than the route, or None."""
        corners = self._corners_with_good_arcs(None)
        if corners is None or self._radius > 0.0:
            return corners
        # On a long route the search skips some legs, so the lattice route may have fewer corners.
        return min(corners, self._lattice_corners(), key=len)

    def least_cost(self, weights: CostWeights) -> tuple[int, ...] | None:
        """Return the corners with the least cost of the legs by Eq. 5, or None."""
        self._forbidden.clear()
        return self._corners_with_good_arcs(weights)

    def _lattice_corners(self) -> tuple[int, ...]:
        steps = np.diff(self._route, axis=0)
        turns = 1 + np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1))
        return (0, *turns.tolist(), len(self._route) - 1)

    def _corners_with_good_arcs(self, weights: CostWeights | None) -> tuple[int, ...] | None:
        for _ in range(MAX_SEARCHES):
            corners = self._cheapest_corners(weights)
            if corners is None or self._radius == 0.0:
                return corners
            turns = zip(corners, corners[1:], corners[2:], strict=False)
            bad = {turn for turn in turns if not self._is_good_arc(turn, strict=weights is None)}
            if not bad:
                return corners
            self._forbidden |= bad
        return None

    def _is_good_arc(self, turn: TurnIndices, *, strict: bool) -> bool:
        before, corner, after = (centre((row, col)) for row, col in self._route[list(turn)].tolist())
        flown = arc(before, corner, after, self._radius)
        if not is_clear(self._threat, flown):
            return False
        around = crossed_cells((flown[0], corner, flown[-1]))
        inside = crossed_cells(flown)
        if not strict:
            return True
        return bool(_no_worse(self._measure.of(self._threat, inside), self._measure.of(self._threat, around)))

    def _cheapest_corners(self, weights: CostWeights | None) -> tuple[int, ...] | None:
        nodes = np.arange(len(self._route))
        while True:
            chosen = self._cheapest_chain(nodes, self._costs(nodes, weights))
            if chosen is None:
                return None
            if len(nodes) <= MAX_FIRST_SPAN + 1 or len(chosen) == len(nodes):
                return tuple(chosen.tolist())
            nodes = chosen

    def _costs(self, nodes: Ints, weights: CostWeights | None) -> Floats:
        """Return (nodes, span) costs of the legs from each node to the next nodes; infinite: forbidden."""
        n = len(nodes)
        span = min(MAX_FIRST_SPAN, n - 1)
        begins, ahead = (index.ravel() for index in np.indices((n, span)))
        ends = begins + ahead + 1
        exists = ends < n
        first, last = nodes[begins[exists]], nodes[ends[exists]]
        costs = np.full((n, span), np.inf)
        costs[begins[exists], ahead[exists]] = self._cost(first, last, weights)
        return costs

    def _cost(self, first: Ints, last: Ints, weights: CostWeights | None) -> Floats:
        legs = measure_legs(self._threat, self._route[first], self._route[last])
        length = legs.measures[0]
        replaced = self._so_far[:, last] - self._so_far[:, first]
        # A leg as long as the replaced cells lies on the lattice route, which the planner has chosen.
        on_lattice = replaced[0] <= length * (1.0 + TIE_TOLERANCE)
        if weights is None:
            rows = self._measure.rows
            good = _no_worse(legs.measures[rows], replaced[rows])
            cost = length + 2.0 * len(self._route)  # one leg less outweighs any length
        else:
            exposure = legs.measures[ENTERED if self._measure is ExposureMeasure.ENTERED else INTEGRAL]
            good = np.ones(len(first), dtype=bool)
            cost = (1.0 - weights.w) * weights.psi_per_cell * length + weights.w * exposure + TIE_TOLERANCE
        return np.where((length > 0.0) & (on_lattice | (legs.clear & good)), cost, np.inf)

    def _cheapest_chain(self, nodes: Ints, costs: Floats) -> Ints | None:
        """Return the nodes of the cheapest chain of legs from the first node to the last, or None.

        The search is over legs, not over nodes, because a leg must fit the previous leg.
        """
        n, span = costs.shape
        total = np.full((n, span), np.inf)
        """[j, s]: cost of the best chain to node j with a last leg from node j − s − 1"""
        leg_before = np.zeros((n, span), dtype=np.int64)
        for i in range(n - 1):
            reach = np.arange(min(span, n - 1 - i))
            if i == 0:
                total[1 + reach, reach] = costs[0, reach]
                continue
            chains = np.where(self._may_turn(nodes, i, span, len(reach)), total[i][:, None], np.inf)
            best = chains.argmin(axis=0)
            total[i + 1 + reach, reach] = chains[best, reach] + costs[i, reach]
            leg_before[i + 1 + reach, reach] = best
        s = int(total[n - 1].argmin())
        if not np.isfinite(total[n - 1, s]):
            return None
        chosen, j = [n - 1], n - 1
        while j > 0:
            j, s = j - s - 1, int(leg_before[j, s])
            chosen.append(j)
        return nodes[chosen[::-1]]

    def _may_turn(self, nodes: Ints, i: int, span: int, reach: int) -> Bools:
        """Return (span, reach) flags; [s, r]: a chain may turn at node i, from i − 1 − s to i + 1 + r."""
        if self._radius == 0.0:
            return np.ones((span, reach), dtype=bool)
        before, after = np.maximum(i - 1 - np.arange(span), 0), i + 1 + np.arange(reach)
        here = self._route[nodes[i]]
        leg_in, leg_out = here - self._route[nodes[before]], self._route[nodes[after]] - here
        cross = np.outer(leg_in[:, 0], leg_out[:, 1]) - np.outer(leg_in[:, 1], leg_out[:, 0])
        dot = leg_in @ leg_out.T
        length_in, length_out = np.hypot(*leg_in.T), np.hypot(*leg_out.T)
        # An arc may take a whole leg only at the ends of the track; elsewhere two arcs share a leg.
        room = np.minimum.outer(
            length_in * np.where(before == 0, 1.0, 0.5),
            length_out * np.where(after == len(nodes) - 1, 1.0, 0.5),
        )
        # tan(θ/2) = sin θ / (1 + cos θ)
        fits: Bools = self._radius * np.abs(cross) <= room * (np.outer(length_in, length_out) + dot)
        fits &= (cross != 0) | (dot > 0)
        for first, corner, last in self._forbidden:
            if corner == nodes[i]:
                fits[np.ix_(nodes[before] == first, nodes[after] == last)] = False
        return fits


def _no_worse(measures: Floats, reference: Floats) -> Any:
    """Return whether every row of `measures` is at most `reference`, for one leg or for many."""
    return (measures <= reference * (1.0 + TIE_TOLERANCE) + TIE_TOLERANCE).all(axis=0)
