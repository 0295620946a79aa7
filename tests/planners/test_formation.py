"""The route of a group, compared with a plain search over every cell, heading and shape."""

import math

import numpy as np
import pytest
from group_brute_force import Group
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.exposure import length_cells
from swarmctl.core.records import replace
from swarmctl.planners import PLANNERS, Problem, Route, Unreachable, dijkstra, formation, method
from swarmctl.planners.formation import Params, measure, members_along, plan, shapes_along

SEARCHES = settings(max_examples=examples(300, 40), deadline=None, derandomize=True)
WEDGE = ((0.0, 0.0), (-1.0, 1.0), (-1.0, -1.0))
LINE = ((0.0, 0.0), (0.0, 1.0), (0.0, -1.0))
COLUMN = ((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0))
SHAPES = st.sampled_from(
    [
        (WEDGE,),
        (WEDGE, COLUMN),
        (COLUMN, LINE),
        (((0.0, 0.0), (-0.7, 1.3)), ((0.0, 0.0), (-1.5, 0.0))),
        (((0.0, 0.0), (-1.5, 0.5), (0.5, -1.5)),),
        (((0.0, 0.0),), ((0.0, 0.0),)),
    ]
)


@st.composite
def fields(draw: st.DrawFn, *, walls: bool = True, largest: int = 6) -> Problem:
    rows, cols = draw(st.integers(1, largest)), draw(st.integers(1, largest))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["zero", "exact", "any"]))
    exposure = {
        "zero": np.zeros((rows, cols)),
        "exact": rng.choice([0.0, 0.25, 0.5, 1.5], (rows, cols)),
        "any": rng.random((rows, cols)),
    }[kind]
    if walls:
        exposure[rng.random((rows, cols)) < draw(st.sampled_from([0.0, 0.1, 0.3]))] = np.inf
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, cols - 1))
    return Problem(
        exposure,
        start=draw(cell),
        goals=tuple(draw(st.lists(cell, min_size=1, max_size=2))),
        w=draw(st.sampled_from([0.0, 0.25, 0.5, 1.0])),
        psi_per_cell=draw(st.sampled_from([0.0, 0.132, 1.0])),
        max_exposure=draw(st.sampled_from([math.inf, math.inf, 1.0])),
    )


groups = st.builds(
    Params,
    shapes=SHAPES,
    exposure=st.sampled_from(["sum", "survival"]),
    change_cost=st.sampled_from([0.0, 0.1]),
    other_shape_cost=st.sampled_from([0.0, 0.05]),
    max_turn_deg=st.sampled_from([45, 90, 180]),
    start_heading_deg=st.sampled_from([None, None, 0, 90, 135]),
    start_shape=st.sampled_from([None, 0]),
)


def found(problem: Problem, params: Params) -> Route | None:
    try:
        return plan(problem, params)
    except Unreachable:
        return None


@SEARCHES
@given(fields(), st.booleans())
def test_a_group_of_one_gets_the_route_of_eq_5(problem: Problem, gains: bool) -> None:
    if gains:
        gain = np.random.default_rng(1).random(problem.exposure.shape) * 0.3
        problem = replace(problem, gain=gain)
    route = found(problem, Params())
    try:
        own = dijkstra.plan(problem, dijkstra.Params())
    except Unreachable:
        assert route is None
        return
    assert route is not None
    assert route.cost == pytest.approx(own.cost, rel=1e-12)
    assert route.length_cells == pytest.approx(own.length_cells)
    assert measure(problem, own.cells, Params()) == pytest.approx(own.cost, rel=1e-12)


@SEARCHES
@given(fields(), groups)
def test_the_route_of_a_group_is_the_cheapest_over_all_cells_headings_and_shapes(
    problem: Problem, params: Params
) -> None:
    group = Group(problem, params)
    least = group.cost_to_go([(problem.start, pose) for pose in group.start_poses()])
    route = found(problem, params)
    if route is None:
        assert math.isinf(least)
        return
    assert route.cost == pytest.approx(least, rel=1e-9, abs=1e-12)
    assert group.cost_along(route.cells) == pytest.approx(least, rel=1e-9, abs=1e-12)
    assert measure(problem, route.cells, params) == route.cost
    assert route.length_cells == length_cells(route.cells)


@SEARCHES
@given(fields(largest=5), groups, st.lists(st.integers(0, 7), max_size=6))
def test_the_measure_of_any_route_is_the_least_over_headings_and_shapes(
    problem: Problem, params: Params, directions: list[int]
) -> None:
    cells = [problem.start]
    for k in directions:
        row, col = (
            cells[-1][0] + round(math.sin(k * math.pi / 4)),
            cells[-1][1] + round(math.cos(k * math.pi / 4)),
        )
        if 0 <= row < problem.exposure.shape[0] and 0 <= col < problem.exposure.shape[1]:
            cells.append((row, col))
    assert measure(problem, cells, params) == pytest.approx(
        Group(problem, params).cost_along(cells), rel=1e-12
    )


@SEARCHES
@given(fields(), groups)
def test_members_fly_over_no_wall_and_never_leave_the_area(problem: Problem, params: Params) -> None:
    route = found(problem, params)
    if route is None:
        return
    tracks = members_along(problem, route.cells, params)
    shapes = shapes_along(problem, route.cells, params)
    assert tracks.shape == (len(route.cells), len(params.shapes[0]), 2)
    assert [tuple(cell) for cell in tracks[:, 0].tolist()] == list(route.cells)
    assert len(shapes) == len(route.cells)
    for member in tracks.swapaxes(0, 1).tolist():
        inside = [
            0 <= row < problem.exposure.shape[0] and 0 <= col < problem.exposure.shape[1]
            for row, col in member
        ]
        assert sorted(inside[1:]) == inside[1:]
        assert not any(
            math.isinf(problem.passable[row, col])
            for (row, col), is_in in list(zip(member, inside, strict=True))[1:]
            if is_in
        )


def passage(width: int) -> Problem:
    """Return an area of 9 × 20 cells; a passage of `width` cells leads through the wall in its middle."""
    field = np.full((9, 20), 0.1)
    field[:, 9:12] = np.inf
    field[4 - width // 2 : 4 - width // 2 + width, 9:12] = 0.1
    return Problem(field, (4, 2), ((4, 19),), 0.5, 0.13)


@pytest.mark.parametrize(("width", "changes"), [(3, False), (1, True)])
def test_a_wedge_becomes_a_column_only_where_the_passage_is_too_narrow(width: int, changes: bool) -> None:
    params = Params((WEDGE, COLUMN), start_shape=0)
    problem = passage(width)
    cells = plan(problem, params).cells
    shapes = shapes_along(problem, cells, params)
    assert shapes[0] == 0
    assert (1 in shapes) == changes
    with pytest.raises(Unreachable) if changes else pytest.MonkeyPatch.context():
        plan(problem, Params((WEDGE,)))


def test_a_change_cost_is_paid_for_a_change_to_another_shape_than_the_first() -> None:
    problem = passage(1)

    def cost(change_cost: float) -> float:
        options = Params((WEDGE, COLUMN), start_shape=0, change_cost=change_cost, other_shape_cost=0.3)
        return plan(problem, options).cost  # it changes, and changes back

    assert cost(0.25) == pytest.approx(cost(0.0) + 0.25)


def test_a_group_returns_to_its_first_shape_if_other_shapes_cost_more() -> None:
    problem = passage(1)
    dear, free = (Params((WEDGE, COLUMN), start_shape=0, other_shape_cost=cost) for cost in (0.3, 0.0))
    assert shapes_along(problem, plan(problem, free).cells, free)[-1] == 1
    assert shapes_along(problem, plan(problem, dear).cells, dear)[-1] == 0


@pytest.mark.parametrize(
    "options",
    [
        {"shapes": []},
        {"shapes": [[]]},
        {"shapes": [[[0, 0], [1, 1]], [[0, 0]]]},
        {"shapes": [[[1, 0]]]},
        {"shapes": [[[0, 0], [math.nan, 0]]]},
        {"shapes": [[[0, 0], [0, 1e6]]]},
        {"shapes": [[[0, 0, 0]]]},
        {"exposure": "mean"},
        {"change_cost": -1.0},
        {"other_shape_cost": -1.0},
        {"change_cost": math.inf},
        {"max_turn_deg": 30},
        {"start_heading_deg": math.nan},
        {"start_shape": 1},
        {"start_shape": -1},
    ],
)
def test_invalid_options_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="formation"):
        method("formation", PLANNERS["formation"], options)


def test_options_of_a_configuration_are_accepted() -> None:
    options = {"shapes": [[[0, 0], [-1, 1.5]], [[0, 0], [-2, 0]]], "exposure": "survival", "max_turn_deg": 45}
    chosen = method("formation", formation, options)
    assert chosen.params.shapes == (((0.0, 0.0), (-1.0, 1.5)), ((0.0, 0.0), (-2.0, 0.0)))
