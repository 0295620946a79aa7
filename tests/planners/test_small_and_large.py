"""Searches with and without compiled code give equal results, bit for bit."""

import contextlib
import inspect
import math
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.planners import (
    PLANNERS,
    BoundTooTight,
    Front,
    Problem,
    Replanner,
    Route,
    Unreachable,
    cost_to_go,
    dijkstra,
    pareto_front,
    plan,
    warm_up,
    window,
)
from swarmctl.planners.kernels import bounds, buckets, descent, field, group_field, labels, lattice, spread
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.large_field import LargeField
from swarmctl.planners.kernels.small_field import SmallField
from swarmctl.planners.pool import Pool

FEW = settings(max_examples=examples(100), deadline=None, derandomize=True)
LEVELS = {
    "any": tuple(np.random.default_rng(1).random(40).tolist()),
    "ties": (0.1, 0.2, 0.3),
    "zero": (0.0,),
    "walls": (0.1, 0.2, 0.3, math.inf),
    "free between walls": (0.0, 0.0, math.inf),
    "extreme": (1e-300, 1e-20, 0.1, 1e17, 1e200),
}


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    rows, cols = draw(st.sampled_from([(1, 1), (1, 9), (7, 1), (2, 5), (6, 7), (14, 16)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    exposure = rng.choice(LEVELS[draw(st.sampled_from(sorted(LEVELS)))], (rows, cols))
    cells = [
        (int(rng.integers(rows)), int(rng.integers(cols))) for _ in range(draw(st.sampled_from([2, 2, 3, 7])))
    ]
    shortest = max(rows, cols) * draw(st.floats(0.5, 2.0))
    return Problem(
        exposure,
        start=cells[0],
        goals=tuple(cells[1:]),
        w=draw(st.sampled_from([0.0, 0.5, 1.0, 0.3, 0.9])),
        psi_per_cell=draw(st.sampled_from([0.0, 0.132, 1.0])),
        max_length_cells=draw(st.sampled_from([math.inf, shortest])),
    )


@contextlib.contextmanager
def areas_up_to(n_cells: int) -> Iterator[None]:
    """Treat areas up to this size as small, without stored fields of earlier searches."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(field, "SMALL_CELLS", n_cells)
        patch.setattr(dijkstra, "_fields", Pool())
        yield


@FEW
@given(problem=problems())
def test_fields_and_routes_are_equal_with_and_without_compiled_code(problem: Problem) -> None:
    asked = problem.exposure, problem.goals, problem.w, problem.psi_per_cell
    small = spread(*asked)
    with areas_up_to(0):
        large = spread(*asked)
    assert isinstance(small, SmallField)
    assert isinstance(large, LargeField)
    assert small.label.tobytes() == large.label.tobytes()
    assert small.cost().tobytes() == large.cost().tobytes()
    assert small.matches(*asked)
    assert large.matches(*asked)
    cells = list(np.ndindex(*problem.exposure.shape))
    assert [small.cost_of(cell) for cell in cells] == [large.cost_of(cell) for cell in cells]
    starts = [cell for cell in cells if math.isfinite(small.cost_of(cell))]
    for start in starts:
        assert small.route_from(start) == large.route_from(start)


def by(name: str) -> Callable[[Problem], Route]:
    return lambda problem: plan(problem, name)


SEARCHES: dict[str, Callable[[Problem], Route | Front]] = {
    **{name: by(name) for name in PLANNERS},
    "window": lambda problem: window.plan(problem, window.Params()),
    "front": pareto_front,
}


def answer(search: Callable[[Problem], Route | Front], problem: Problem) -> object:
    """Return the result of a search, or its error with the error's content."""
    try:
        return search(problem)
    except BoundTooTight as error:
        return type(error), error.nearest
    except Unreachable as error:
        return type(error)


def content(answered: object) -> object:
    return (
        tuple(getattr(answered, name) for name in Front.__struct_fields__)
        if isinstance(answered, Front)
        else answered
    )


@pytest.mark.parametrize("search", SEARCHES.values(), ids=SEARCHES.keys())
@FEW
@given(problem=problems())
def test_every_planner_gives_equal_results_with_and_without_compiled_code(
    search: Callable[[Problem], Route | Front], problem: Problem
) -> None:
    small = answer(search, problem)
    with areas_up_to(0):
        large = answer(search, problem)
    assert content(small) == content(large)


FOREIGN = ("pymavlink", "zenoh", "mavsdk", "pydantic", "matplotlib", "typer", "rich", "mcap", "serial")


def test_planning_of_a_small_area_loads_no_compiler_and_nothing_for_vehicles_or_people() -> None:
    program = f"""
import sys
import numpy as np
from swarmctl.planners import PLANNERS, Problem, cost_to_go, pareto_front, plan, window
area = np.random.default_rng(1).random((50, 50))
problem = Problem(area, (25, 0), ((25, 49),), 0.5, 0.1, max_length_cells=60.0)
small = [name for name, planner in PLANNERS.items() if not planner.NEEDS_MACHINE_CODE]
found = [plan(problem, name) for name in small] + [window.plan(problem, window.Params())]
cost_to_go(area, [(25, 49)], 0.5, 0.1).cells_from((0, 0))
pareto_front(problem)
print(len(found), [name for name in ("numba", "llvmlite", *{FOREIGN}) if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    n_planners = sum(not planner.NEEDS_MACHINE_CODE for planner in PLANNERS.values())
    assert done.stdout == f"{n_planners + 1} []\n"


def machine_code() -> dict[str, int]:
    """Return the number of compiled versions of each kernel in this process."""
    modules = (bounds, buckets, descent, group_field, labels, lattice)
    return {
        f"{module.__name__}.{name}": len(compiled(kernel).signatures)  # type: ignore[attr-defined]
        for module in modules
        for name, kernel in inspect.getmembers(module, inspect.isfunction)
        if kernel.__module__ == module.__name__ and kernel is not labels.label_search
    }


def test_a_large_area_needs_no_compiler_after_the_warm_up() -> None:
    reports: list[tuple[int, int]] = []
    warm_up(lambda done, total: reports.append((done, total)))
    assert [done for done, _ in reports] == list(range(len(reports)))
    assert {total for _, total in reports} == {len(reports) - 1}
    before = machine_code()
    rng = np.random.default_rng(2)
    with areas_up_to(0):
        for walls in (0.0, 0.1):
            area = np.where(rng.random((20, 30)) < walls, math.inf, rng.choice([0.1, 0.2, 0.7], (20, 30)))
            area[10, 0] = area[10, 29] = 0.1
            problem = Problem(area, (10, 0), ((10, 29), (0, 29)), 0.5, 0.13, max_length_cells=35.0)
            for search in SEARCHES.values():
                answer(search, problem)
            cost_to_go(area, [(10, 29)], 1.0, 0.13).cells_from((10, 0))
            replanner = Replanner(area, [(10, 29)], 0.5, 0.13)
            replanner.route((10, 0))
            replanner.renew(area * 0.9)
            replanner.route((10, 1))
    assert machine_code() == before


def test_the_queue_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    area = np.random.default_rng(3).random((300, 300))
    cost = cost_to_go(area, [(150, 299)], 0.9, 0.13).cost
    monkeypatch.setattr(buckets, "FREE_BLOCKS", buckets.MOST_PUSHED)
    np.testing.assert_array_equal(cost_to_go(area, [(150, 299)], 0.9, 0.13).cost, cost)
