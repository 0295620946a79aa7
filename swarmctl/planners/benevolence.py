"""Benevolence: what the other vehicles would gain from the observations along a route. Pure.

A vehicle in cell n sees the 3 × 3 cells around n. The gain of n is the sum over these cells j

    g(n) = 1/3 Σ_j G_j,      G_j = Σ over the other vehicles u of V_u(j),

with V_u(j) the expected fall of u's route cost when j becomes known. A straight route sees each cell from
three of its own cells, hence the factor 1/3. V_u(j) is the value of information over candidate routes r, with
p = p_O(j), the present cost C_r (Eq. 5), and A_rj the firing strength from j summed over the cells of r:

    V_u(j) = min_r C_r − p · min_r (C_r + w (1 − p) A_rj) − (1 − p) · min_r (C_r − w p A_rj)

V is 0 for a cell that is known, and never below 0. The candidates are the cheapest routes of u over each
cell. The small change of p_O of all other cells, when j becomes known, is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import kernels
from swarmctl.planners.kernels.lattice import ROOT2, Floats

VIEWS_OF_A_CELL = 3.0
"""number of cells of a straight route from which the route sees a cell"""
MAX_CANDIDATES = 400
"""greatest number of candidate routes of a vehicle"""
MAX_ENTRIES = 10_000_000
"""greatest number of candidate routes × cells, which limits the candidates in large areas"""
BLOCK_ENTRIES = 2_000_000
"""candidate routes × cells computed at once, which limits the memory"""
MAX_W = 1.0 - 1e-6
"""w above this value is lowered to it, so that each step costs something and routes have no loops"""
STEPS = tuple((r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0))


@dataclass(frozen=True, slots=True)
class OtherVehicle:
    """Last known cell and goals of another vehicle."""

    cell: Cell
    goals: tuple[Cell, ...]


def cell_gains(
    p_occupied: Floats,
    exposure: Floats,
    strength: FiringStrength,
    others: Iterable[OtherVehicle],
    w: float,
    psi_per_cell: float,
) -> Floats:
    """Return g(n) of every cell, shape (rows, cols), in the unit of Eq. 5, 0 or more.

    `p_occupied` is p_O and `exposure` is P_s, both (rows, cols); P_s is infinite in walls.
    """
    values = np.zeros(exposure.shape)
    for other in others:
        values += value_of_knowing(p_occupied, exposure, strength, other, w, psi_per_cell)
    return seen_from(values) / VIEWS_OF_A_CELL


def seen_from(values: Floats) -> Floats:
    """Return for every cell the sum of `values` (rows, cols) over the 3 × 3 cells around the cell."""
    return ndimage.correlate(values, np.ones((3, 3)), output=np.float64, mode="constant", cval=0.0)


def value_of_knowing(
    p_occupied: Floats,
    exposure: Floats,
    strength: FiringStrength,
    other: OtherVehicle,
    w: float,
    psi_per_cell: float,
) -> Floats:
    """Return V_u(j) of every cell j, shape (rows, cols), for one vehicle u."""
    value = np.zeros(exposure.shape)
    w = min(w, MAX_W)
    if w == 0.0 or other.cell in other.goals:
        return value
    routes = _candidates(p_occupied, exposure, strength, other, w, psi_per_cell)
    if not routes.cells:
        return value
    best, p = routes.costs[0], p_occupied
    if_occupied, if_clear = np.full(p.shape, math.inf), np.full(p.shape, math.inf)
    n_at_once = max(BLOCK_ENTRIES // p.size, 1)
    for first in range(0, len(routes.cells), n_at_once):
        block = slice(first, first + n_at_once)
        costs = routes.costs[block, np.newaxis, np.newaxis]
        weights = w * _firing_sums(routes.cells[block], strength, p.shape)
        np.minimum(if_occupied, (costs + (1.0 - p) * weights).min(axis=0), out=if_occupied)
        np.minimum(if_clear, (costs - p * weights).min(axis=0), out=if_clear)
    np.maximum(best - p * if_occupied - (1.0 - p) * if_clear, 0.0, out=value)
    value[(p <= 0.0) | (p >= 1.0)] = 0.0  # without the rounding
    return value


@dataclass(frozen=True, slots=True)
class _Routes:
    """Routes without their start cells, the best first."""

    cells: list[list[int]]
    """row · cols + col of the cells of each route"""
    costs: Floats


def _candidates(
    p: Floats, exposure: Floats, strength: FiringStrength, other: OtherVehicle, w: float, psi: float
) -> _Routes:
    """Return the cheapest routes of a vehicle over each cell that may become part of its best route."""
    start, cols = other.cell, exposure.shape[1]
    is_open = exposure.copy()
    is_open[start] = 0.0  # the start is not entered; a vehicle may leave a wall
    to_goal, to_start = (kernels.spread(is_open, goals, w, psi).cost() for goals in (other.goals, (start,)))
    best = to_goal[start]
    if math.isinf(best):
        return _Routes([], np.zeros(0))
    # The field to the start has the exposure of the start in place of the cell's own.
    over = (to_goal + to_start + np.where(np.isinf(is_open), math.inf, w * is_open)).ravel()
    onward = _next_cells(is_open, to_goal, other.goals, w, psi)
    back = _next_cells(is_open, to_start, (start,), w, psi)
    cells, costs = [_followed(onward, start[0] * cols + start[1])[1:]], [best]
    # No observation favours a dearer route than this over the best route.
    sums = _firing_sums(cells, strength, exposure.shape)[0]
    reach = w * max(
        float(((1.0 - p) * sums).max()), float(p[p < 1.0].max(initial=0.0) * strength.kernel.sum())
    )
    found = np.flatnonzero(over < best + reach)
    n_candidates = max(min(MAX_CANDIDATES, MAX_ENTRIES // exposure.size), 1)
    if found.size > n_candidates:
        found = found[np.linspace(0, found.size - 1, n_candidates).astype(np.int64)]
    for cell in found.tolist():
        to_cell = _followed(back, cell)[-2::-1]
        cells.append(to_cell + _followed(onward, cell)[1:])
        costs.append(float(over[cell]))
    return _Routes(cells, np.array(costs))


def _followed(next_cells: list[int], cell: int) -> list[int]:
    """Return the cells from `cell` to the end of its way, both included."""
    path = [cell]
    while (cell := next_cells[cell]) >= 0 and len(path) < len(next_cells):
        path.append(cell)
    return path


def _next_cells(exposure: Floats, cost: Floats, ends: tuple[Cell, ...], w: float, psi: float) -> list[int]:
    """Return the next cell on the way from each cell to `ends`, as row · cols + col; −1 at the ends."""
    rows, cols = exposure.shape
    entered = np.pad(cost + w * exposure, 1, constant_values=math.inf)
    least, best = np.full(cost.shape, math.inf), np.full(cost.shape, -1)
    index = np.arange(cost.size).reshape(cost.shape)
    for row, col in STEPS:
        step = (1.0 - w) * psi * (ROOT2 if row and col else 1.0)
        beyond = entered[1 + row : 1 + row + rows, 1 + col : 1 + col + cols] + step
        with np.errstate(invalid="ignore"):
            # A step past the corner of a wall may seem cheaper than the field says, so the nearest is taken.
            off = np.abs(beyond - cost)
        closer = off < least
        least[closer], best[closer] = off[closer], (index + row * cols + col)[closer]
    for end in ends:
        best[end] = -1
    return best.ravel().tolist()


def _firing_sums(
    routes: list[list[int]], strength: FiringStrength, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return A_rj of the routes and cells, (routes, rows, cols): firing strength from j on the cells of r."""
    size = shape[0] * shape[1]
    flat = np.concatenate([np.array(path, dtype=np.int64) + k * size for k, path in enumerate(routes)])
    visits = np.bincount(flat, minlength=len(routes) * size).reshape(len(routes), *shape)
    kernel = strength.kernel[np.newaxis]
    return ndimage.correlate(visits, kernel, output=np.float64, mode="constant", cval=0.0)
