"""The field of a small area, computed with scipy and numpy, without a compiler."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.descent import LENGTH_TIE, REL_TIE
from swarmctl.planners.kernels.field import Field
from swarmctl.planners.kernels.lattice import ROOT2, Floats, Int32s, Ints, offsets_of

LENGTHS = np.array([1.0] * 4 + [ROOT2] * 4)
"""lengths of the steps in the order of `offsets_of` [cells]"""


class SmallField(Field):
    """An immutable field."""

    def __init__(self, exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float) -> None:
        super().__init__(*exposure.shape)
        seeds = self._begin_search(exposure, goals, w, psi_per_cell)
        self.straight = self._write_straight(exposure, np.empty((self.rows + 2) * self.width))
        self._graph = _graph(self.rows, self.cols)
        walls = np.isinf(self.straight[self._graph.beside])
        self._closed: NDArray[np.bool_] = walls | walls[:, [1, 2, 3, 0]]
        """(cells, 4): True for a diagonal step past the corner of a wall"""
        self.label = self._labels(seeds)

    def cost(self) -> Floats:
        cost = self._costs.reshape(self.rows, self.cols).copy()
        cost[self.goals // self.width - 1, self.goals % self.width - 1] = 0.0
        cost.flags.writeable = False
        return cost

    def cost_of(self, cell: Cell) -> float:
        if self.index(cell) in self.goals:
            return 0.0
        return float(self._costs[cell[0] * self.cols + cell[1]])

    def path_from(self, start: Cell) -> Ints:
        goals, only_next_cells = set(self.goals.tolist()), self._only_next_cells
        path = [self.index(start)]
        while (cell := path[-1]) not in goals:
            path.append(only_next_cells[cell] or self._next_cells[cell])
        return np.stack(np.divmod(path, self.width), axis=1) - 1

    def _labels(self, seeds: Floats) -> Floats:
        """Return the labels of all cells, from the labels of the goals.

        Each cell has a node with its label, for straight steps, and a node with its label + `extra`, for
        diagonal steps. So the sums are rounded as in a large field. One more node is the source of the goals.
        """
        size = self.straight.size
        into = self.straight[self._graph.neighbours]
        across = np.full((len(into), 1), self.extra)
        diagonal = np.where(self._closed, np.inf, into[:, 4:])
        costs = np.concatenate((np.hstack((into[:, :4], across)), diagonal), axis=None)
        edges = (
            np.concatenate((costs, seeds)),
            np.concatenate((self._graph.heads, self.goals), dtype=np.int32),
            np.append(self._graph.first, np.int32(costs.size + seeds.size)),
        )
        source = np.array([2 * size])
        found: Floats = dijkstra(csr_array(edges, shape=(2 * size + 1, 2 * size + 1)), indices=source)
        return found[0, :size]

    @functools.cached_property
    def _neighbour_costs(self) -> Floats:
        """Cost from each cell through each neighbour, less `step`: (cells, 8)."""
        costs = self.label[self._graph.neighbours]
        costs[:, 4:] += self.extra
        leaves_wall = np.isinf(self.straight[self._graph.cells])
        costs[:, 4:][self._closed & ~leaves_wall[:, np.newaxis]] = np.inf
        return costs

    @functools.cached_property
    def _costs(self) -> Floats:
        """Least cost from each cell to a goal; for a goal, the cost of leaving and returning."""
        costs: Floats = self._neighbour_costs.min(axis=1) + self.step
        return costs

    @functools.cached_property
    def _is_cheapest(self) -> NDArray[np.bool_]:
        """(cells, 8): True for the steps of the cheapest routes."""
        costs, bound = self._neighbour_costs + self.step, self._costs * (1.0 + REL_TIE)
        return (costs <= bound[:, np.newaxis]) & np.isfinite(costs)

    @functools.cached_property
    def _only_next_cells(self) -> list[int]:
        """Flat index of the next cell from each cell with one cheapest step; 0 for the other cells.

        Most routes meet no tie, and need no lengths.
        """
        return self._ends(self._is_cheapest.argmax(axis=1), self._is_cheapest.sum(axis=1) == 1)

    @functools.cached_property
    def _next_cells(self) -> list[int]:
        """Flat index of the next cell on the route from each cell, by the rule of `descent`."""
        is_cheapest, neighbours = self._is_cheapest, self._graph.neighbours
        to_go = np.where(is_cheapest, self._lengths(is_cheapest)[neighbours] + LENGTHS, np.inf)
        best, least = is_cheapest.argmax(axis=1), np.full(len(neighbours), np.inf)
        for k in range(8):
            shorter = to_go[:, k] < least - LENGTH_TIE
            best[shorter], least[shorter] = k, to_go[shorter, k]
        return self._ends(best, True)

    def _ends(self, step: Ints, where: NDArray[np.bool_] | bool) -> list[int]:
        """Return the flat index of the cell after one step from each cell; 0 elsewhere and in the padding."""
        next_cells = np.zeros(self.label.size, dtype=np.int64)
        ends = self._graph.neighbours[np.arange(len(step)), step]
        next_cells[self._graph.cells] = np.where(where, ends, 0)
        return next_cells.tolist()

    def _lengths(self, is_cheapest: NDArray[np.bool_]) -> Floats:
        """Return the length of the shortest among the cheapest routes from each cell."""
        cell, k = np.nonzero(is_cheapest)
        ends = self._graph.neighbours[cell, k], self._graph.cells[cell]
        shape = (self.label.size, self.label.size)
        graph = coo_array((LENGTHS[k], ends), shape=shape).tocsr()
        lengths: Floats = dijkstra(graph, indices=self.goals, min_only=True)
        return lengths


class _Graph(NamedTuple):
    """The graph of an area of one shape; cells are flat padded indices."""

    cells: Ints
    neighbours: Ints
    """(cells, 8), in the order of `offsets_of`"""
    beside: Ints
    """(cells, 4): the neighbours at straight steps"""
    heads: Int32s
    """end of each edge in `SmallField._labels`, except the edges of the source"""
    first: Int32s
    """first edge of each node"""


@functools.lru_cache(maxsize=16)
def _graph(rows: int, cols: int) -> _Graph:
    width = cols + 2
    size = (rows + 2) * width
    cells = (np.arange(1, rows + 1)[:, np.newaxis] * width + np.arange(1, cols + 1)).reshape(-1)
    neighbours = cells[:, np.newaxis] + offsets_of(width)
    heads = np.concatenate(
        (np.column_stack((neighbours[:, :4], size + cells)), neighbours[:, 4:]), axis=None, dtype=np.int32
    )
    n_edges = np.zeros(2 * size + 1, dtype=np.int32)
    n_edges[1 + cells], n_edges[1 + size + cells] = 5, 4
    return _Graph(cells, neighbours, neighbours[:, :4], heads, np.cumsum(n_edges, dtype=np.int32))
