"""Properties of every planner in the registry."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.exposure import exposure_sum, length_cells, safety_factor
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.planners import PLANNERS, BadProblem, Planner, Problem, Route, Unreachable

QUICK = settings(max_examples=examples(30), deadline=None, derandomize=True)
every_planner = pytest.mark.parametrize("planner", PLANNERS.values(), ids=PLANNERS.keys())


def solve(planner: Planner, problem: Problem) -> Route:
    return planner.plan(problem, planner.Params())


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    rows, cols = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    levels = draw(st.sampled_from([(0.0,), (0.0, 0.25, 0.5), tuple(np.linspace(0.0, 1.2, 50).tolist())]))
    n = rows * cols
    values = draw(st.lists(st.sampled_from(levels), min_size=n, max_size=n))
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1))
    return Problem(
        exposure=np.array(values).reshape(rows, cols),
        start=draw(cell),
        goals=tuple(draw(st.lists(cell, min_size=1, max_size=3))),
        w=draw(st.sampled_from([0.0, 0.5, 1.0]) | st.floats(0.0, 1.0)),
        psi_per_cell=draw(st.sampled_from([0.0, 0.132]) | st.floats(0.0, 2.0)),
    )


@every_planner
@QUICK
@given(problem=problems())
def test_a_route_leads_from_the_start_to_a_goal_with_the_measures_of_its_cells(
    planner: Planner, problem: Problem
) -> None:
    before = problem.exposure.copy()
    problem.exposure.flags.writeable = False
    route = solve(planner, problem)
    np.testing.assert_array_equal(problem.exposure, before)
    assert solve(planner, replace(problem, exposure=before)) == route
    assert route.cells[0] == problem.start
    assert route.cells[-1] in problem.goals
    assert not set(route.cells[:-1]) & set(problem.goals)
    assert len(set(route.cells)) == len(route.cells)
    assert all(type(index) is int for cell in route.cells for index in cell)
    assert route.length_cells == length_cells(route.cells)
    assert route.exposure_sum == exposure_sum(problem.exposure, route.cells)
    assert route.safety_factor == safety_factor(problem.exposure, route.cells)
    assert planner.measure(problem, route.cells, planner.Params()) == pytest.approx(route.cost, rel=1e-12)


@every_planner
def test_the_measure_of_a_route_through_a_wall_is_infinite(planner: Planner) -> None:
    field = np.full((2, 3), 0.1)
    field[0, 1] = 0.5
    problem = Problem(field, (0, 0), ((0, 2),), 0.5, 0.1)
    for limit, walled in ((0.4, True), (0.5, False)):
        limited = replace(problem, max_exposure=limit)
        for cells in (((0, 0), (0, 1), (0, 2)), ((0, 0), (1, 1), (0, 2))):
            assert math.isinf(planner.measure(limited, cells, planner.Params())) == walled


@every_planner
@QUICK
@given(problem=problems(), limit=st.sampled_from([0.0, 0.3, 0.6]))
def test_a_maximum_exposure_makes_walls(planner: Planner, problem: Problem, limit: float) -> None:
    limited = replace(problem, max_exposure=limit)
    walls = np.where(problem.exposure > limit, math.inf, problem.exposure)
    try:
        cells = solve(planner, replace(problem, exposure=walls)).cells
    except Unreachable:
        with pytest.raises(Unreachable):
            solve(planner, limited)
        return
    assert solve(planner, limited).cells == cells


@every_planner
def test_only_a_planner_that_declares_w_uses_w(planner: Planner) -> None:
    field = np.random.default_rng(4).random((9, 15))
    problem = Problem(field, (4, 0), ((4, 14),), 0.0, 0.3)
    routes = {solve(planner, replace(problem, w=w)).cells for w in (0.0, 0.5, 1.0)}
    assert (len(routes) > 1) == planner.USES_W


@every_planner
def test_only_a_planner_that_declares_a_bound_keeps_it(planner: Planner) -> None:
    cells = ((0, 0), (0, 1))
    free = Problem(np.zeros((1, 2)), cells[0], cells[1:], 0.5, 1.0)

    def keeps(**bound: float) -> bool:
        return math.isinf(planner.measure(replace(free, **bound), cells, planner.Params()))

    assert keeps(max_length_cells=0.5) == planner.KEEPS_LONGEST
    try:
        is_accepted = bool(solve(planner, replace(free, min_length_cells=0.5)))
    except BadProblem:
        is_accepted = False
    assert (is_accepted and keeps(min_length_cells=2.0)) == planner.KEEPS_SHORTEST


@every_planner
def test_a_start_at_the_goal_gives_a_route_of_one_cell(planner: Planner) -> None:
    route = solve(planner, Problem(np.full((3, 3), 0.5), (1, 1), ((0, 0), (1, 1)), 0.5, 0.1))
    assert replace(route, lower_bound=None) == Route(((1, 1),), 0.0, 0.0, 0.0, 1.0)


@every_planner
@QUICK
@given(problem=problems(), data=st.data())
def test_no_route_enters_a_wall_or_passes_the_corner_of_one(
    planner: Planner, problem: Problem, data: st.DataObject
) -> None:
    cells = set(np.ndindex(*problem.exposure.shape)) - {problem.start}
    walls = data.draw(st.sets(st.sampled_from(sorted(cells)))) if cells else set()
    for wall in walls:
        problem.exposure[wall] = math.inf
    try:
        route = solve(planner, problem)
    except Unreachable:
        return
    for here, there in pairwise(route.cells):
        assert not walls & {here, there, (here[0], there[1]), (there[0], here[1])}


@every_planner
@pytest.mark.parametrize("w", [0.0, 0.5, 1.0])
def test_a_goal_behind_walls_is_unreachable(planner: Planner, w: float) -> None:
    walled = np.zeros((3, 5))
    walled[:, 2] = math.inf
    with pytest.raises(Unreachable):
        solve(planner, Problem(walled, (0, 0), ((0, 4),), w, 0.1))
    with pytest.raises(Unreachable):
        solve(planner, Problem(walled, (0, 0), ((1, 2),), w, 0.1))


FIELD = np.full((4, 5), 0.1)
NAN_FIELD, NEGATIVE_FIELD = FIELD.copy(), FIELD.copy()
NAN_FIELD[2, 3], NEGATIVE_FIELD[1, 4] = math.nan, -0.1


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"exposure": NAN_FIELD}, "(2, 3)"),
        ({"exposure": NEGATIVE_FIELD}, "(1, 4)"),
        ({"exposure": FIELD[0]}, "(5,)"),
        ({"exposure": FIELD[:0]}, "(0, 5)"),
        ({"start": (4, 0)}, "(4, 0)"),
        ({"start": (0, -1)}, "(0, -1)"),
        ({"goals": ((0, 0), (0, 5))}, "(0, 5)"),
        ({"goals": ()}, "goal"),
        ({"exposure": "many"}, "<U4"),
        ({"exposure": np.ma.masked_array(FIELD, np.eye(4, 5))}, "masked"),
        ({"exposure": FIELD.astype(complex)}, "complex128"),
        ({"exposure": FIELD * 1e300}, "1e+299"),
        ({"start": (1.5, 0)}, "(1.5, 0)"),
        ({"start": (1, 0, 0)}, "(1, 0, 0)"),
        ({"start": 3}, "3"),
        ({"goals": ((1, 2), (0.5, 1))}, "(0.5, 1)"),
        ({"goals": 7}, "7"),
        ({"w": "0.5"}, "'0.5'"),
        ({"max_length_cells": None}, "None"),
        ({"psi_per_cell": True}, "True"),
        ({"w": -0.1}, "-0.1"),
        ({"w": 1.1}, "1.1"),
        ({"w": math.nan}, "nan"),
        ({"max_exposure": -0.5}, "-0.5"),
        ({"max_exposure": math.nan}, "nan"),
        ({"max_length_cells": -1.0}, "-1.0"),
        ({"min_length_cells": 5.0, "max_length_cells": 4.0}, "5.0"),
        ({"min_length_cells": math.nan}, "nan"),
        ({"psi_per_cell": -1.0}, "-1.0"),
        ({"psi_per_cell": math.inf}, "inf"),
        ({"psi_per_cell": math.nan}, "nan"),
    ],
)
def test_an_invalid_problem_is_refused_with_the_found_value(change: dict[str, object], found: str) -> None:
    start: Cell = (0, 0)
    sound = Problem(FIELD, start, ((3, 4),), 0.5, 0.1)
    with pytest.raises(BadProblem) as caught:
        replace(sound, **change)
    assert found in str(caught.value)


def test_lists_arrays_and_a_single_goal_are_accepted() -> None:
    sound = Problem(FIELD, (0, 0), ((3, 4),), 0.5, 0.1)
    for exposure in (FIELD.tolist(), FIELD.astype(np.float32), FIELD.T.copy().T):
        for start in ([0, 0], np.array([0, 0])):
            for goals in ((3, 4), [3, 4], [[3, 4]], np.array([[3, 4]]), [(3, 4), (3, 4)]):
                asked = Problem(exposure, start, goals, 0.5, 0.1)  # type: ignore[arg-type]
                assert asked.start == (0, 0)
                assert set(asked.goals) == {(3, 4)}
                np.testing.assert_allclose(asked.exposure, sound.exposure, rtol=1e-6)
    assert sound.exposure is FIELD
