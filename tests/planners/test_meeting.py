"""The split of a group, compared with every meeting."""

import math

import numpy as np
import pytest
from group_brute_force import Group
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import BadProblem, Problem, dijkstra
from swarmctl.planners.formation import Params
from swarmctl.planners.meeting import split

PAIR = ((0.0, 0.0), (0.0, 1.0))
COLUMN = ((0.0, 0.0), (-1.0, 0.0))


@st.composite
def cases(draw: st.DrawFn) -> tuple[Problem, Params, list[Cell]]:
    rows, cols = draw(st.integers(2, 4)), draw(st.integers(2, 5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    exposure = rng.choice([0.0, 0.2, 0.5, 3.0], (rows, cols))
    exposure[rng.random((rows, cols)) < draw(st.sampled_from([0.0, 0.15]))] = np.inf
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1))
    problem = Problem(
        exposure, draw(cell), (draw(cell),), w=draw(st.sampled_from([0.0, 0.25, 0.5, 1.0])), psi_per_cell=0.3
    )
    params = Params(
        draw(st.sampled_from([(PAIR,), (COLUMN,), (PAIR, COLUMN)])),
        start_heading_deg=draw(st.sampled_from([None, 90.0])),
    )
    return problem, params, [draw(cell), draw(cell)]


@settings(max_examples=examples(200, 30), deadline=None, derandomize=True)
@given(cases(), st.sampled_from([1.0, 1.25]))
def test_apart_is_the_least_sum_over_all_meetings(
    case: tuple[Problem, Params, list[Cell]], factor: float
) -> None:
    problem, params, starts = case
    group = Group(problem, params)
    to_go = group.costs_to_go()
    together = min(to_go[problem.start, pose] for pose in group.start_poses())
    alone = Group(problem, Params())
    own: list[dict[Cell, float]] = []
    for start in starts:
        costs: dict[Cell, float] = {}
        if group.is_open(start):
            for (cell, _), cost in alone.least_costs([(start, pose) for pose in alone.poses]).items():
                costs[cell] = min(cost, costs.get(cell, math.inf))
        own.append(costs)
    onward = {
        (cell, pose): group.step_cost(cell, pose) + to_go.get((group.ahead(cell, pose), pose), math.inf)
        for cell, pose in to_go
        if cell not in problem.goals
    }
    apart = (
        min(
            cost
            + factor * sum(costs.get(c, math.inf) for costs, c in zip(own, group.cells(*state), strict=True))
            for state, cost in onward.items()
        )
        if onward
        else math.inf
    )
    found = split(problem, params, starts, factor)
    assert found.together == pytest.approx(together, rel=1e-12, abs=1e-12)
    # Beyond the group's own cost a meeting is of no interest, and its cost is an upper bound only.
    if apart <= together:
        assert found.apart == pytest.approx(apart, rel=1e-9, abs=1e-12)
    else:
        assert found.apart >= together or found.apart == pytest.approx(together)
    assert found.is_cheaper == (apart < together - 1e-9)
    if found.meeting is None:
        assert math.isinf(apart)
        return
    pose = int(found.meeting.heading_deg), found.meeting.shape
    meeting_cells = group.cells(found.meeting.cell, pose)
    flown = 0.0
    for start, route, cell in zip(starts, found.routes, meeting_cells, strict=True):
        assert (route[0], route[-1]) == (start, cell)
        to_cell = replace(problem, start=start, goals=(cell,))
        flown += dijkstra.measure(to_cell, route, dijkstra.Params())
    if apart <= together:
        assert factor * flown + onward[found.meeting.cell, pose] == pytest.approx(apart, rel=1e-9, abs=1e-12)


def test_a_pair_splits_around_a_threat_and_meets_behind_it() -> None:
    """A threat fills the middle of a corridor; the pair would pass it on one side, with a long way round."""
    field = np.zeros((7, 15))
    field[1:6, 6:9] = np.inf
    problem = Problem(field, (2, 1), ((2, 14),), 0.5, 1.0)
    wide = Params((((0.0, 0.0), (0.0, -2.0)),), start_heading_deg=90.0)
    found = split(problem, wide, [(2, 1), (4, 1)])
    assert math.isinf(found.together)
    assert found.is_cheaper
    assert found.meeting is not None
    assert found.meeting.cell[1] >= 8
    assert {row for row, _ in found.routes[0]} == {0, 1, 2}
    assert {row for row, _ in found.routes[1]} == {4, 5, 6}


@pytest.mark.parametrize("start", [(5, 1), (-1, 1), (0, 0)])
def test_a_member_outside_the_area_or_in_a_wall_keeps_the_group_together(start: Cell) -> None:
    field = np.full((5, 9), 0.1)
    field[0, 0] = np.inf
    found = split(Problem(field, (2, 1), ((2, 8),), 0.5, 0.2), Params((PAIR,)), [(2, 1), start])
    assert (found.apart, found.is_cheaper, found.routes) == (math.inf, False, ())


def test_starts_for_other_members_and_the_measure_of_survival_are_refused() -> None:
    problem = Problem(np.zeros((3, 3)), (1, 1), ((1, 2),), 0.5, 0.2)
    with pytest.raises(BadProblem):
        split(problem, Params((PAIR,)), [(1, 1)])
    with pytest.raises(BadProblem):
        split(problem, Params((PAIR,)), [(1, 1), (0, 1)], alone_factor=0.9)
    with pytest.raises(BadProblem):
        split(problem, Params((PAIR,), exposure="survival"), [(1, 1), (0, 1)])
