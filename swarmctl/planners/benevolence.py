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

import msgspec
import numpy as np
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.planners.kernels import information
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.large_field import spread_large
from swarmctl.planners.kernels.lattice import Floats

VIEWS_OF_A_CELL = 3.0
"""number of cells of a straight route from which the route sees a cell"""
MAX_CANDIDATES = 400
"""greatest number of candidate routes of a vehicle"""
MAX_W = 1.0 - 1e-6
"""w above this value is lowered to it, so that each step costs something and routes have no loops"""


class OtherVehicle(msgspec.Struct, frozen=True):
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
    seen = ndimage.correlate(values, np.ones((3, 3)), output=np.float64, mode="constant", cval=0.0)
    return seen / VIEWS_OF_A_CELL


def value_of_knowing(
    p_occupied: Floats,
    exposure: Floats,
    strength: FiringStrength,
    other: OtherVehicle,
    w: float,
    psi_per_cell: float,
) -> Floats:
    """Return V_u(j) of every cell j, shape (rows, cols), for one vehicle u."""
    w = min(w, MAX_W)
    if w == 0.0 or other.cell in other.goals:
        return np.zeros(exposure.shape)
    is_open = exposure.copy()
    is_open[other.cell] = 0.0  # the start is not entered; a vehicle may leave a wall
    to_goal, to_start = (
        spread_large(is_open, goals, w, psi_per_cell) for goals in (other.goals, (other.cell,))
    )
    if math.isinf(to_goal.cost_of(other.cell)):
        return np.zeros(exposure.shape)
    padded = np.zeros((to_goal.rows + 2, to_goal.width))
    padded[1:-1, 1:-1] = p_occupied
    values = compiled(information.value_of_knowing)(
        padded.ravel(), to_goal.label, to_start.label, to_goal.straight,
        np.array([strength.direct, strength.first_neighbour, strength.second_neighbour]),
        w, to_goal.step, to_goal.extra, to_goal.width, to_goal.index(other.cell), to_goal.goals,
        MAX_CANDIDATES,
    )  # fmt: skip
    return values.reshape(padded.shape)[1:-1, 1:-1]
