"""Problems without a route, or with an evident route, for every search."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from swarmctl.core.records import replace
from swarmctl.planners import PLANNERS, BadProblem, BoundTooTight, Problem, Route, Unreachable, pareto_front

Search = Callable[[Problem], Route]


def by(name: str) -> Search:
    return lambda problem: PLANNERS[name].plan(problem, PLANNERS[name].Params())


def least_exposed_of_the_front(problem: Problem) -> Route:
    return pareto_front(problem).routes[-1]


SEARCHES: dict[str, Search] = {name: by(name) for name in PLANNERS} | {"front": least_exposed_of_the_front}
every_search = pytest.mark.parametrize("search", SEARCHES.values(), ids=SEARCHES.keys())
bounded_search = pytest.mark.parametrize(
    "search", [SEARCHES[name] for name in ("time_bound", "constrained", "front")]
)

ROW = Problem(np.array([[0.1, 0.2, 0.3, 0.4]]), (0, 0), ((0, 3),), 0.5, 0.1)


@bounded_search
def test_an_unreachable_goal_with_a_bound_is_unreachable_and_not_too_far(search: Search) -> None:
    limited = replace(ROW, max_exposure=0.25, max_length_cells=2.0)
    with pytest.raises(Unreachable) as caught:
        search(limited)
    assert not isinstance(caught.value, BoundTooTight)


@bounded_search
def test_a_bound_below_the_shortest_route_is_an_error_with_that_route(search: Search) -> None:
    field = np.vstack([ROW.exposure, np.zeros((1, 4))])  # a longer route has no exposure
    with pytest.raises(BoundTooTight) as caught:
        search(replace(ROW, exposure=field, max_length_cells=2.9))
    assert caught.value.nearest.cells == ((0, 0), (0, 1), (0, 2), (0, 3))


@every_search
@pytest.mark.parametrize("scale", [1e-12, 1e150])
def test_exposures_of_any_size_are_weighed(search: Search, scale: float) -> None:
    field = np.array([[9.0, 9.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.25]]) * scale
    route = search(Problem(field, (1, 0), ((1, 2),), 1.0, 0.1))
    assert route.cells in (((1, 0), (2, 1), (1, 2)), ((1, 0), (2, 1), (2, 2), (1, 2)))
    assert route.exposure_sum == 0.0


@every_search
def test_the_route_over_a_field_without_exposure_is_the_shortest(search: Search) -> None:
    route = search(Problem(np.zeros((4, 6)), (0, 0), ((3, 5),), 1.0, 0.1))
    assert route.length_cells == pytest.approx(2.0 + 3.0 * math.sqrt(2.0))


@every_search
def test_a_route_may_leave_a_wall_that_it_starts_in(search: Search) -> None:
    field = np.array([[0.0, 0.1, 0.0], [np.inf, np.inf, 0.0], [0.0, 0.3, 0.0]])
    route = search(Problem(field, (1, 0), ((1, 2),), 1.0, 0.1))
    assert route.cells == ((1, 0), (0, 1), (0, 2), (1, 2))


@pytest.mark.parametrize("max_labels", ["5", 2.5, -1])
def test_an_invalid_number_of_labels_is_refused(max_labels: Any) -> None:
    with pytest.raises(BadProblem):
        pareto_front(ROW, max_labels=max_labels)
    with pytest.raises(BadProblem):
        PLANNERS["constrained"].Params(max_labels=max_labels)


def test_a_start_at_the_goal_is_proved_least_exposed() -> None:
    assert by("constrained")(Problem(np.ones((2, 2)), (0, 0), ((0, 0),), 0.5, 0.1)).lower_bound == 0.0
