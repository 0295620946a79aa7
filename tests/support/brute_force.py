"""Every route through a small area, by enumeration, as the reference for searches."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners import Problem

TIE = 1e-9
STEPS = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
Point = tuple[float, float]
"""(length, exposure)"""


@dataclass(frozen=True)
class EnumeratedRoutes:
    """All routes without a repeated cell from a start to the first reached goal."""

    lengths: NDArray[np.float64]
    entered: NDArray[np.float64]
    """(routes, cells), 1 for each cell that a route enters"""
    touched: NDArray[np.float64]
    """(routes, cells), 1 for each cell that a route enters or whose corner the route passes"""

    def points(self, exposure: NDArray[np.float64]) -> list[Point]:
        """Return length and exposure of every route that touches no wall."""
        walls = np.isinf(exposure).reshape(-1)
        is_open = self.touched @ walls == 0.0
        sums = self.entered[is_open] @ np.where(walls, 0.0, exposure.reshape(-1))
        return list(zip(self.lengths[is_open].tolist(), sums.tolist(), strict=True))


@functools.cache
def all_routes(shape: tuple[int, int], start: Cell, goals: frozenset[Cell]) -> EnumeratedRoutes:
    """Return all routes; the results hold for areas with no wall at the start."""
    found = list(_walk((start,), _neighbours(shape), goals))
    n_steps = [len(cells) - 1 for cells in found]
    route = np.repeat(np.arange(len(found)), n_steps)
    here = np.array([cell for cells in found for cell in cells[:-1]], dtype=int).reshape(-1, 2).T
    there = np.array([cell for cells in found for cell in cells[1:]], dtype=int).reshape(-1, 2).T
    entered = np.zeros((len(found), *shape))
    entered[route, *there] = 1.0
    touched = entered.copy()
    touched[route, here[0], there[1]] = touched[route, there[0], here[1]] = 1.0
    n_diagonal = np.bincount(route, (here != there).all(axis=0), minlength=len(found))
    lengths = n_steps - n_diagonal + n_diagonal * math.sqrt(2.0)
    flat = (len(found), -1)
    return EnumeratedRoutes(lengths, entered.reshape(flat), touched.reshape(flat))


def _neighbours(shape: tuple[int, int]) -> dict[Cell, list[Cell]]:
    inside = set(np.ndindex(shape))
    return {
        (row, col): [(row + r, col + c) for r, c in STEPS if (row + r, col + c) in inside]
        for row, col in inside
    }


def _walk(
    cells: tuple[Cell, ...], neighbours: dict[Cell, list[Cell]], goals: frozenset[Cell]
) -> Iterator[tuple[Cell, ...]]:
    if cells[-1] in goals:
        yield cells
        return
    for step in neighbours[cells[-1]]:
        if step not in cells:
            yield from _walk((*cells, step), neighbours, goals)


def all_points(problem: Problem) -> list[Point]:
    """Return (length, exposure) of every route."""
    found = all_routes(problem.exposure.shape, problem.start, frozenset(problem.goals))
    return found.points(problem.passable)


def front_of(points: list[Point]) -> list[Point]:
    """Return the non-dominated points, by length; points closer than TIE are one."""
    front: list[Point] = []
    for length, exposure in sorted((round(length, 9), exposure) for length, exposure in points):
        if not front or exposure < front[-1][1] - TIE:
            front.append((length, exposure))
    return front


def found_by_some_w(points: list[Point]) -> list[Point]:
    """Return the results of Eq. 5 over all w in (0, 1], the shortest of the cheapest.

    The search tries every price of length at which two points of the front cost the same, and one price
    between each two of these.
    """
    front = front_of(points)
    crossings = {(a[1] - b[1]) / (b[0] - a[0]) for i, a in enumerate(front) for b in front[i + 1 :]}
    prices = sorted({0.0, *crossings})
    prices += [(low + high) / 2.0 for low, high in pairwise(prices)] + [prices[-1] + 1.0]
    found = set()
    for price in prices:
        least = min(exposure + price * length for length, exposure in front)
        found.add(min(p for p in front if p[1] + price * p[0] <= least + TIE))
    return sorted(found)


@st.composite
def small_problems(draw: st.DrawFn, *, walls: bool = True) -> Problem:
    """Draw problems with few levels of exposure or with many.

    Sums of few levels tie, some exactly and some up to rounding. Sums of many levels do not tie.
    """
    shape = draw(st.sampled_from([(1, 5), (2, 2), (2, 4), (3, 3), (3, 3), (3, 4), (4, 3)]))
    n = shape[0] * shape[1]
    kind = draw(st.sampled_from(["exact", "rounded", "any", "any"]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    field = {
        "exact": rng.choice([0.0, 0.25, 0.5, 1.0], shape),
        "rounded": rng.choice([0.1, 0.2, 0.3, 0.7], shape),
        "any": rng.random(shape) ** 3,
    }[kind]
    first, *others = rng.permutation(n).tolist()
    n_goals = draw(st.sampled_from([1, 1, 2]))
    if walls and n > 4:
        field.reshape(-1)[others[n_goals : n_goals + draw(st.integers(0, 2))]] = np.inf
    return Problem(
        field,
        start=divmod(first, shape[1]),
        goals=tuple(divmod(goal, shape[1]) for goal in others[:n_goals]),
        w=0.5,
        psi_per_cell=draw(st.sampled_from([0.0, 0.132, 1.0])),
    )


def three_arms() -> Problem:
    """Return a problem with three routes between walls to three goals.

    (length, exposure) is (2, 2), (3, 1) and (4, 0): three points on one line.
    """
    field = np.full((4, 7), np.inf)
    field[0, :] = field[:, 2] = 0.0
    field[0, 0], field[3, 2] = 2.0, 1.0
    return Problem(field, (0, 2), ((0, 0), (3, 2), (0, 6)), w=0.5, psi_per_cell=1.0)
