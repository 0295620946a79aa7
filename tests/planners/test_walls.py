"""Routes pass through no wall and past no corner of a wall, compared with a search over every edge."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.planners import Problem, Unreachable
from swarmctl.planners.dijkstra import Params, plan

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
