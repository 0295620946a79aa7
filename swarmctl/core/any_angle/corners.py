"""Which cells of a lattice route a track turns at: a search over all straight legs between them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from swarmctl.core.any_angle.legs import ENTERED, INTEGRAL, N_MEASURES, Bools, Ints, measure_legs
from swarmctl.core.any_angle.track import CrossedCells, Floats, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.any_angle.turns import arc

SPAN = 32
"""Legs over more steps of a route than this are looked for only between corners that shorter ones leave.
A route of no more steps gets the fewest legs there are."""

TIES = 1e-9
"""Share by which rounding may make equal sums differ."""

ROUNDS = 50
"""How often a track is chosen again because an arc of the last was bad."""


class ExposureMeasure(StrEnum):
    """By what a straight leg must not be more exposed than the lattice route it replaces."""

    ENTERED = "entered"
    """by each: ΣP_s and ∏(1 − P_s) over the cells entered, and ∫P_s ds and ∫−ln(1 − P_s) ds along the way.
    Strikes are drawn each time a cell is entered, and a skew leg enters more of them than diagonal steps do,
    so this never adds strikes; it pulls little where nothing is known"""
    INTEGRAL = "integral"
    """by ∫P_s ds and ∫−ln(1 − P_s) ds alone: pulls most, and enters about a quarter more cells"""

    @property
    def rows(self) -> slice:
        """Of a table of measures (`swarmctl.core.any_angle.legs`), those that must not become worse."""
        return slice(0, N_MEASURES if self is ExposureMeasure.ENTERED else 3)

    def of(self, threat: ThreatMap, under: CrossedCells) -> Floats:
        """Those of them that are exposures, of a track that begins in its first cell."""
        integral = threat.integral(under.cells, under.ways)
        if self is ExposureMeasure.INTEGRAL:
            return integral
        return np.concatenate((integral, threat.entered(under.cells[1:])))


TurnIndices = tuple[int, int, int]
"""indices of the cells before, at and after a turn"""


class Unflyable(ValueError):
    """No track over the cells of a route has turns as wide as the vehicle needs."""


@dataclass(frozen=True, slots=True)
class Weights:
    """Eq. 5, by which an unavoidable loss is kept small."""

    w: float
    psi_per_cell: float


def choose_corners(
    threat: ThreatMap, route: Ints, counting: ExposureMeasure, radius_cells: float, weights: Weights
) -> tuple[int, ...]:
    """Indices into `route`, (n, 2) rows and columns of neighbouring cells: both ends and where to turn.

    The fewest corners whose legs and arcs are no worse than the route; where turns need room and there are
    none such, those that cost least by `weights`. Raises Unflyable.
    """
    search = _Search(threat, route, counting, radius_cells)
    corners = search.no_worse()
    if corners is None:
        corners = search.least_bad(weights)
    if corners is None:
        begin, end = (tuple(cell) for cell in route[[0, -1]].tolist())
        raise Unflyable(
            f"no track over the {len(route)} cells from {begin} to {end} has turns of a radius of "
            f"{radius_cells:.3g} cells and keeps clear of walls"
        )
    return corners


class _Search:
    """Chooses corners among the cells of one route."""

    def __init__(self, threat: ThreatMap, route: Ints, counting: ExposureMeasure, radius: float) -> None:
        self._threat, self._route, self._counting, self._radius = threat, route, counting, radius
        steps = measure_legs(threat, route[:-1], route[1:]).measures
        self._so_far = np.concatenate((np.zeros((N_MEASURES, 1)), np.cumsum(steps, axis=1)), axis=1)
        self._forbidden: set[TurnIndices] = set()

    def no_worse(self) -> tuple[int, ...] | None:
        """The fewest corners whose legs and arcs are all no worse than the lattice route, if any."""
        corners = self._with_good_arcs(None)
        if corners is None or self._radius > 0.0:
            return corners
        # On a long route not all legs were looked at; the lattice route's own are good too.
        return min(corners, self._turns(), key=len)

    def least_bad(self, weights: Weights) -> tuple[int, ...] | None:
        """The corners whose legs cost least by Eq. 5, worse than the lattice route or not."""
        self._forbidden.clear()
        return self._with_good_arcs(weights)

    def _turns(self) -> tuple[int, ...]:
        steps = np.diff(self._route, axis=0)
        turns = 1 + np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1))
        return (0, *turns.tolist(), len(self._route) - 1)

    def _with_good_arcs(self, weights: Weights | None) -> tuple[int, ...] | None:
        for _ in range(ROUNDS):
            corners = self._corners(weights)
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
        return bool(
            _no_worse(self._counting.of(self._threat, inside), self._counting.of(self._threat, around))
        )

    def _corners(self, weights: Weights | None) -> tuple[int, ...] | None:
        nodes = np.arange(len(self._route))
        while True:
            chosen = self._best(nodes, self._costs(nodes, weights))
            if chosen is None:
                return None
            if len(nodes) <= SPAN + 1 or len(chosen) == len(nodes):
                return tuple(chosen.tolist())
            nodes = chosen

    def _costs(self, nodes: Ints, weights: Weights | None) -> Floats:
        """(nodes, span): of the legs from each node to the next ones, infinite where there may be none."""
        n = len(nodes)
        span = min(SPAN, n - 1)
        begins, ahead = (index.ravel() for index in np.indices((n, span)))
        ends = begins + ahead + 1
        there = ends < n
        first, last = nodes[begins[there]], nodes[ends[there]]
        costs = np.full((n, span), np.inf)
        costs[begins[there], ahead[there]] = self._cost(first, last, weights)
        return costs

    def _cost(self, first: Ints, last: Ints, weights: Weights | None) -> Floats:
        legs = measure_legs(self._threat, self._route[first], self._route[last])
        length = legs.measures[0]
        replaced = self._so_far[:, last] - self._so_far[:, first]
        # No other way of that length leads there. The planner has vouched for this one.
        on_lattice = replaced[0] <= length * (1.0 + TIES)
        if weights is None:
            rows = self._counting.rows
            good = _no_worse(legs.measures[rows], replaced[rows])
            cost = length + 2.0 * len(self._route)  # one leg less outweighs every length
        else:
            exposure = legs.measures[ENTERED if self._counting is ExposureMeasure.ENTERED else INTEGRAL]
            good = np.ones(len(first), dtype=bool)
            cost = (1.0 - weights.w) * weights.psi_per_cell * length + weights.w * exposure + TIES
        return np.where((length > 0.0) & (on_lattice | (legs.clear & good)), cost, np.inf)

    def _best(self, nodes: Ints, costs: Floats) -> Ints | None:
        """The cheapest chain of legs from the first node to the last: a shortest path over legs, because
        whether a leg may be flown depends on the one before it."""
        n, span = costs.shape
        total = np.full((n, span), np.inf)
        """[j, s]: of the best chain to node j whose last leg comes from node j − s − 1"""
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
        """(span, reach): whether a leg that comes from node i − 1 − row may go on to node i + 1 + column."""
        if self._radius == 0.0:
            return np.ones((span, reach), dtype=bool)
        before, after = np.maximum(i - 1 - np.arange(span), 0), i + 1 + np.arange(reach)
        here = self._route[nodes[i]]
        come, go = here - self._route[nodes[before]], self._route[nodes[after]] - here
        cross = np.outer(come[:, 0], go[:, 1]) - np.outer(come[:, 1], go[:, 0])
        dot = come @ go.T
        come_m, go_m = np.hypot(*come.T), np.hypot(*go.T)
        # Only the ends of the track may be taken up by one arc alone.
        room = np.minimum.outer(
            come_m * np.where(before == 0, 1.0, 0.5), go_m * np.where(after == len(nodes) - 1, 1.0, 0.5)
        )
        # tan(θ/2) = sin θ / (1 + cos θ)
        fits: Bools = self._radius * np.abs(cross) <= room * (np.outer(come_m, go_m) + dot)
        fits &= (cross != 0) | (dot > 0)
        for first, corner, last in self._forbidden:
            if corner == nodes[i]:
                fits[np.ix_(nodes[before] == first, nodes[after] == last)] = False
        return fits


def _no_worse(measures: Floats, others: Floats) -> Any:
    """Whether in no row one is worse: of one or of many."""
    return (measures <= others * (1.0 + TIES) + TIES).all(axis=0)
