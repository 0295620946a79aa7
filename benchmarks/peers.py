"""Other libraries, each solving Eq. 5 from one goal as nearly as it can.

Every peer is a function that prepares a field and returns the function to be timed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import networkx
import numpy as np
import rustworkx
import tcod.path
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from skimage.graph import MCP_Geometric

Floats = NDArray[np.float64]
Goal = tuple[int, int]
Run = Callable[[], object]

STEPS = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0)]


def edges(shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return every edge backwards (the cell entered, the cell left) and its length."""
    rows, cols = shape
    index = np.arange(rows * cols).reshape(shape)
    tails, heads, lengths = [], [], []
    for dr, dc in STEPS:
        left = index[max(0, -dr) : rows - max(0, dr), max(0, -dc) : cols - max(0, dc)].ravel()
        tails.append(left + dr * cols + dc)
        heads.append(left)
        lengths.append(np.full(left.size, math.hypot(dr, dc)))
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(lengths)


class Csr:
    """Return the graph for scipy, and the cell and the length of each stored weight."""

    def __init__(self, exposure: Floats, w: float, psi: float) -> None:
        entered, left, length = edges(exposure.shape)
        size = exposure.size
        # The place of each edge in the matrix, so that a refresh writes nothing but the weights.
        self.graph = csr_array((np.arange(1.0, length.size + 1.0), (entered, left)), shape=(size, size))
        order = self.graph.data.astype(np.int64) - 1
        self._entered, self._length = entered[order], (1.0 - w) * psi * length[order]
        self._w = w
        self.refresh(exposure)

    def refresh(self, exposure: Floats) -> None:
        np.take(exposure.ravel(), self._entered, out=self.graph.data)
        self.graph.data *= self._w
        self.graph.data += self._length


def scipy_built(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    csr, source = Csr(exposure, w, psi), goal[0] * exposure.shape[1] + goal[1]
    return lambda: dijkstra(csr.graph, indices=source)


def scipy_refreshed(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    csr, source = Csr(exposure, w, psi), goal[0] * exposure.shape[1] + goal[1]

    def run() -> object:
        csr.refresh(exposure)
        return dijkstra(csr.graph, indices=source)

    return run


def skimage_mcp(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    """A step costs its length times the mean of both cells' costs: not Eq. 5, but as near as it comes."""
    costs = (1.0 - w) * psi + w * exposure
    return lambda: MCP_Geometric(costs).find_costs([goal])


def tcod_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    """Whole numbers, and a diagonal step costs 3/2 of a straight one."""
    costs = np.maximum(1000.0 * ((1.0 - w) * psi + w * exposure) / 2.0, 1.0).astype(np.int32)

    def run() -> object:
        distance = tcod.path.maxarray(exposure.shape, dtype=np.int32)
        distance[goal] = 0
        return tcod.path.dijkstra2d(distance, costs, 2, 3, out=distance)

    return run


def rustworkx_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    entered, left, length = edges(exposure.shape)
    weights = (1.0 - w) * psi * length + w * exposure.ravel()[entered]
    graph = rustworkx.PyDiGraph()
    graph.add_nodes_from(range(exposure.size))
    graph.add_edges_from(list(zip(entered.tolist(), left.tolist(), weights.tolist(), strict=True)))
    source = goal[0] * exposure.shape[1] + goal[1]
    return lambda: rustworkx.digraph_dijkstra_shortest_path_lengths(graph, source, float)


def networkx_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> Run:
    entered, left, length = edges(exposure.shape)
    weights = (1.0 - w) * psi * length + w * exposure.ravel()[entered]
    graph = networkx.DiGraph()
    graph.add_weighted_edges_from(zip(entered.tolist(), left.tolist(), weights.tolist(), strict=True))
    source = goal[0] * exposure.shape[1] + goal[1]
    return lambda: networkx.single_source_dijkstra_path_length(graph, source)


PEERS: dict[str, tuple[Callable[[Floats, Goal, float, float], Run], int]] = {
    "scipy, graph built": (scipy_built, 2000),
    "scipy, weights refreshed": (scipy_refreshed, 2000),
    "scikit-image MCP": (skimage_mcp, 2000),
    "tcod dijkstra2d": (tcod_dijkstra, 2000),
    "rustworkx": (rustworkx_dijkstra, 300),
    "networkx": (networkx_dijkstra, 300),
}
"""name -> its preparation, and the largest side to try: beyond it, building the graph takes minutes"""
