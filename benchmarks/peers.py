"""Searches of other libraries from one goal, with costs as near to Eq. 5 as each library allows.

Each function here prepares the graph of a field, and returns the call to be timed.
"""

from __future__ import annotations

import ctypes
import functools
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import dijkstra3d
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
TimedCall = Callable[[], object]

MOVES = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0)]


def reversed_moves(shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return all moves between neighbour cells: destination cells, origin cells and lengths [cells].

    The searches start at the goal, so each graph has an edge from the destination to the origin.
    """
    rows, cols = shape
    index = np.arange(rows * cols).reshape(shape)
    destinations, origins, lengths = [], [], []
    for dr, dc in MOVES:
        origin = index[max(0, -dr) : rows - max(0, dr), max(0, -dc) : cols - max(0, dc)].ravel()
        destinations.append(origin + dr * cols + dc)
        origins.append(origin)
        lengths.append(np.full(origin.size, math.hypot(dr, dc)))
    return np.concatenate(destinations), np.concatenate(origins), np.concatenate(lengths)


class ScipyGraph:
    """A graph for scipy whose weights can be refreshed in place."""

    def __init__(self, exposure: Floats, w: float, psi: float) -> None:
        destination, origin, length = reversed_moves(exposure.shape)
        size = exposure.size
        # The first weights number the moves, to learn their order in the matrix for the refreshes.
        self.graph = csr_array((np.arange(1.0, length.size + 1.0), (destination, origin)), shape=(size, size))
        order = self.graph.data.astype(np.int64) - 1
        self._destination, self._length = destination[order], (1.0 - w) * psi * length[order]
        self._w = w
        self.refresh(exposure)

    def refresh(self, exposure: Floats) -> None:
        np.take(exposure.ravel(), self._destination, out=self.graph.data)
        self.graph.data *= self._w
        self.graph.data += self._length


def scipy_built(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    prepared, source = ScipyGraph(exposure, w, psi), goal[0] * exposure.shape[1] + goal[1]
    return lambda: dijkstra(prepared.graph, indices=source)


def scipy_refreshed(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    prepared, source = ScipyGraph(exposure, w, psi), goal[0] * exposure.shape[1] + goal[1]

    def run() -> object:
        prepared.refresh(exposure)
        return dijkstra(prepared.graph, indices=source)

    return run


def skimage_mcp(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    """Prepare scikit-image, where a move costs its length times the mean of both cells' costs.

    Eq. 5 takes the exposure of the destination; this library offers no such cost.
    """
    costs = (1.0 - w) * psi + w * exposure
    return lambda: MCP_Geometric(costs).find_costs([goal])


def tcod_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    """Prepare tcod, where costs are integers and a diagonal move costs 3/2 of a straight move."""
    costs = np.maximum(1000.0 * ((1.0 - w) * psi + w * exposure) / 2.0, 1.0).astype(np.int32)

    def run() -> object:
        distance = tcod.path.maxarray(exposure.shape, dtype=np.int32)
        distance[goal] = 0
        return tcod.path.dijkstra2d(distance, costs, 2, 3, out=distance)

    return run


def dijkstra3d_field(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    """Prepare dijkstra3d, where a diagonal move costs as much as a straight move."""
    costs = (1.0 - w) * psi + w * exposure
    return lambda: dijkstra3d.distance_field(costs, source=goal, connectivity=8)


COMPILER = shutil.which("g++") or shutil.which("clang++")


@functools.cache
def _bucket_queue() -> ctypes.CDLL:
    """Return `bucket_queue.cpp` as machine code for this machine."""
    source = Path(__file__).with_name("bucket_queue.cpp")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, "bucket_queue.so")
        options = ["-O3", "-march=native", "-shared", "-fPIC"]
        subprocess.run([COMPILER or "c++", *options, str(source), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library))


def bucket_queue(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    """Prepare the queue of buckets in C++; the call includes the memory, as that of `cost_to_go` does."""
    search = _bucket_queue().cost_to_go
    sizes = [ctypes.c_long(number) for number in (*exposure.shape, *goal)]

    def run() -> Floats:
        cost = np.empty(exposure.shape)
        weights = ctypes.c_double(w), ctypes.c_double(psi)
        search(ctypes.c_void_p(exposure.ctypes.data), *sizes, *weights, ctypes.c_void_p(cost.ctypes.data))
        return cost

    return run


def rustworkx_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    destination, origin, length = reversed_moves(exposure.shape)
    weights = (1.0 - w) * psi * length + w * exposure.ravel()[destination]
    graph = rustworkx.PyDiGraph()
    graph.add_nodes_from(range(exposure.size))
    graph.add_edges_from(list(zip(destination.tolist(), origin.tolist(), weights.tolist(), strict=True)))
    source = goal[0] * exposure.shape[1] + goal[1]
    return lambda: rustworkx.digraph_dijkstra_shortest_path_lengths(graph, source, float)


def networkx_dijkstra(exposure: Floats, goal: Goal, w: float, psi: float) -> TimedCall:
    destination, origin, length = reversed_moves(exposure.shape)
    weights = (1.0 - w) * psi * length + w * exposure.ravel()[destination]
    graph = networkx.DiGraph()
    graph.add_weighted_edges_from(zip(destination.tolist(), origin.tolist(), weights.tolist(), strict=True))
    source = goal[0] * exposure.shape[1] + goal[1]
    return lambda: networkx.single_source_dijkstra_path_length(graph, source)


PEERS: dict[str, tuple[Callable[[Floats, Goal, float, float], TimedCall], int]] = {
    "scipy, graph built": (scipy_built, 2000),
    "scipy, weights refreshed": (scipy_refreshed, 2000),
    "scikit-image MCP": (skimage_mcp, 2000),
    "tcod dijkstra2d": (tcod_dijkstra, 2000),
    "dijkstra3d": (dijkstra3d_field, 2000),
    "rustworkx": (rustworkx_dijkstra, 300),
    "networkx": (networkx_dijkstra, 300),
}
if COMPILER:
    PEERS["bucket queue in C++"] = bucket_queue, 4000
"""name -> preparation, and greatest side of the area [cells]; a larger graph takes minutes to build"""
