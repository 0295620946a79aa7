"""The greatest safety factor, and that the paper's route does not always have it."""

import math

import numpy as np
import pytest
from brute_force import TIE, all_routes, small_problems
from hypothesis import given, settings
from profiles import examples

from swarmctl.planners import Problem, Unreachable, dijkstra, survival
from swarmctl.planners.survival import CERTAIN_LOSS

PARAMS = survival.Params()


def test_the_route_of_least_exposure_need_not_have_the_greatest_safety_factor() -> None:
    # ERRATUM: "the path that minimizes the sum of probabilities would also be the one that gives the maximum
    # value of the safety factor". One way enters 0.50, the other 0.26 twice.
    field = np.array([[0.0, 0.50, 0.0], [0.0, np.inf, 0.0], [0.26, 0.26, 0.0]])
    problem = Problem(field, (0, 0), ((0, 2),), 1.0, 0.1)
    papers = dijkstra.plan(problem, dijkstra.Params())
    safest = survival.plan(problem, PARAMS)
    assert (papers.exposure_sum, papers.safety_factor) == pytest.approx((0.50, 0.500))
    assert (safest.exposure_sum, safest.safety_factor) == pytest.approx((0.52, 0.5476))
    assert safest.cost == pytest.approx(-math.log(0.5476))


@settings(max_examples=examples(150), deadline=None, derandomize=True)
@given(small_problems(walls=False))
def test_a_route_enters_the_fewest_certain_losses_and_is_then_the_safest(problem: Problem) -> None:
    found = all_routes(problem.exposure.shape, problem.start, frozenset(problem.goals))
    flat = problem.exposure.reshape(-1)
    certain = found.entered @ (flat >= 1.0)
    rest = found.entered @ -np.log1p(-np.where(flat >= 1.0, 0.0, flat))
    fewest = certain.min()
    route = survival.plan(problem, PARAMS)
    assert sum(problem.exposure[cell] >= 1.0 for cell in route.cells[1:]) == fewest
    assert route.cost == pytest.approx(
        CERTAIN_LOSS * fewest + rest[certain == fewest].min(), abs=TIE, rel=1e-11
    )
    if fewest == 0:
        assert route.safety_factor == pytest.approx(math.exp(-route.cost), rel=1e-9)


@pytest.mark.parametrize(
    ("certain", "cells"),
    [
        (1.0, ((0, 0), (0, 1), (0, 2))),  # the only route leads through the certain loss
        (7.5, ((0, 0), (0, 1), (0, 2))),
        (math.inf, None),  # a wall lets no route through
    ],
)
def test_a_certain_loss_is_entered_only_on_the_only_route(
    certain: float, cells: tuple[tuple[int, int], ...] | None
) -> None:
    problem = Problem(np.array([[0.0, certain, 0.2]]), (0, 0), ((0, 2),), 0.5, 0.1)
    if cells is None:
        with pytest.raises(Unreachable):
            survival.plan(problem, PARAMS)
        return
    route = survival.plan(problem, PARAMS)
    assert route.cells == cells
    assert route.safety_factor == 0.0
    assert route.cost == pytest.approx(CERTAIN_LOSS - math.log(0.8))


def test_a_route_of_any_length_around_a_certain_loss_is_taken() -> None:
    field = np.full((3, 40), 0.9)
    field[0, 20] = field[1, 20] = 1.0
    route = survival.plan(Problem(field, (0, 0), ((0, 39),), 0.0, 0.1), PARAMS)
    assert (2, 20) in route.cells
    assert route.cost < CERTAIN_LOSS
