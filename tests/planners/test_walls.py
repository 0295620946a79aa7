"""Routes pass through no wall and past no corner of a wall, compared with a search over every edge."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

from swarmctl.core.grid import Cell
from swarmctl.planners import Problem, Unreachable
from swarmctl.planners.dijkstra import Params, cost_to_go, plan

ROOT2 = math.sqrt(2.0)


@pytest.mark.parametrize("quarter_turns", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("area", "length"),
    [
        (["S.", ".G"], ROOT2),
        (["S#", ".G"], 2.0),  # a wall beside the diagonal: the route leads around it
        (["S.", "#G"], 2.0),
        (["S#", "#G"], None),  # two walls that touch at a corner let no route through
        (["S.#..", ".#..G"], None),
        (["S..", ".G.", "..#"], ROOT2),  # a wall ahead does not block a diagonal
        (["S..", "##.", "G.."], 6.0),  # a route cuts no corner at either end of a wall
        (["S...", ".##.", ".##.", "...G"], 6.0),
        (["S....", "..#..", "....G"], 4.0 + ROOT2),
        (["s..", "...", "..G"], 2.0 * ROOT2),  # a small s is a start in a wall: the route may leave it,
        ([".#G", "#s#", ".#."], ROOT2),  # also where there are walls on all four sides,
        (["s#.", "#.#", ".#G"], None),  # but walls stop it after that
        (["###", "#s#", "##G"], ROOT2),
        (["###.", "#s#.", "###G"], None),  # and no route leads from wall to wall
    ],
)
def test_the_shortest_route_leads_around_walls(
    area: list[str], length: float | None, quarter_turns: int
) -> None:
    drawn = np.rot90(np.array([list(row) for row in area]), quarter_turns)
    p_s = np.where((drawn == "#") | (drawn == "s"), math.inf, 0.1)
    (start,), (goal,) = cells_where(np.char.upper(drawn) == "S"), cells_where(drawn == "G")
    problem = Problem(p_s, start, (goal,), 0.0, 0.1)
    if length is None:
        with pytest.raises(Unreachable):
            plan(problem, Params())
    else:
        assert plan(problem, Params()).length_cells == pytest.approx(length)


def cells_where(mask: NDArray[np.bool_]) -> list[Cell]:
    return [(int(row), int(col)) for row, col in np.argwhere(mask)]


def is_edge(p_s: NDArray[np.float64], here: Cell, there: Cell) -> bool:
    """Return true if a step leads from `here` to `there`.

    All cells that touch the middle of the step must be free. For a step out of a wall, only the cell
    entered must be free.
    """
    touched = itertools.product({here[0], there[0]}, {here[1], there[1]})
    needed = touched if math.isfinite(p_s[here]) else [there]
    return here != there and all(math.isfinite(p_s[cell]) for cell in needed)


def least_costs(
    p_s: NDArray[np.float64], goals: tuple[Cell, ...], w: float, psi: float
) -> dict[Cell, tuple[float, float]]:
    """Return the least (cost by Eq. 5, length) from every cell to a goal, by Bellman and Ford."""
    cells = list(np.ndindex(*p_s.shape))
    edges = [
        (m, n, math.dist(m, n), w * p_s[n])
        for m, n in itertools.product(cells, cells)
        if max(abs(m[0] - n[0]), abs(m[1] - n[1])) == 1 and is_edge(p_s, m, n)
    ]
    best = dict.fromkeys(cells, (math.inf, math.inf)) | dict.fromkeys(goals, (0.0, 0.0))
    while True:
        before = dict(best)
        for m, n, d, threat in edges:
            best[m] = min(best[m], (best[n][0] + (1.0 - w) * psi * d + threat, best[n][1] + d))
        if best == before:
            return best


@st.composite
def walled_areas(draw: st.DrawFn) -> NDArray[np.float64]:
    rows, cols = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    # Sums of these values have no rounding: equal costs are exactly equal, and the length decides.
    level = st.sampled_from([0.0, 0.25, 0.5, 0.5, math.inf, math.inf])
    return np.array(draw(st.lists(level, min_size=rows * cols, max_size=rows * cols))).reshape(rows, cols)


@settings(max_examples=examples(80), deadline=None, derandomize=True)
@given(p_s=walled_areas(), w=st.sampled_from([0.0, 0.5, 1.0]), data=st.data())
def test_the_route_between_walls_is_the_best_of_all_open_routes(
    p_s: NDArray[np.float64], w: float, data: st.DataObject
) -> None:
    cells = list(np.ndindex(*p_s.shape))
    goals = tuple(data.draw(st.lists(st.sampled_from(cells), min_size=1, max_size=2)))
    best = least_costs(p_s, goals, w, 0.25)
    field = cost_to_go(p_s, goals, w, 0.25)
    for start in cells:
        cost, length = best[start]
        assert field.cost[start] == pytest.approx(cost, rel=1e-12)
        problem = Problem(p_s, start, goals, w, 0.25)
        if math.isinf(cost):
            with pytest.raises(Unreachable):
                plan(problem, Params())
            continue
        route = plan(problem, Params())
        assert all(is_edge(p_s, here, there) for here, there in itertools.pairwise(route.cells))
        assert route.cost == pytest.approx(cost, rel=1e-12)
        if w != 0.5:
            assert route.length_cells == pytest.approx(length)
        assert route.cells == field.cells_from(start)
        for k in range(1, len(route.cells)):
            assert field.cells_from(route.cells[k]) == route.cells[k:]
