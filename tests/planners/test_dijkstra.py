"""Eq. 5 compared with the model's numbers, with scipy and with all routes; stored fields change no result."""

import contextlib
import math

import numpy as np
import pytest
from brute_force import all_routes
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra as scipy_dijkstra

from swarmctl.core.exposure import exposure, exposure_sum, length_cells
from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import BadProblem, Problem, Route, Unreachable, dijkstra
from swarmctl.planners.dijkstra import Params, cost_to_go, plan

STEPS = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
ROOT2 = math.sqrt(2.0)
FIRING = FiringStrength(0.6, 0.3, 0.1)


def route(p_s: NDArray[np.float64], start: Cell, goals: tuple[Cell, ...], w: float, psi: float) -> Route:
    return plan(Problem(p_s, start, goals, w, psi), Params())


def eq5(p_s: NDArray[np.float64], cells: tuple[Cell, ...], w: float, psi: float) -> float:
    return (1.0 - w) * psi * length_cells(cells) + w * exposure_sum(p_s, cells)


# ERRATUM: a paragraph of the paper's results swaps w = 0, the shortest route, and w = 1. Eq. 5 decides.
@pytest.mark.parametrize(
    ("w", "cost", "length", "total", "safety"),
    [(0.0, 0.4, 4.0, 1.7, 0.0756), (0.5, 0.391421356, 6.828427, 0.1, 0.9), (1.0, 0.1, None, 0.1, 0.9)],
)
def test_routes_on_five_by_five_cells_equal_those_of_the_model(
    w: float, cost: float, length: float | None, total: float, safety: float
) -> None:
    occupied = np.zeros((5, 5))
    occupied[2, 2] = occupied[1, 3] = 1.0
    found = route(exposure(occupied, FiringStrength(0.6, 0.3, 0.1)), (2, 0), ((2, 4),), w, 0.1)
    assert found.cost == pytest.approx(cost, abs=5e-10)
    assert found.exposure_sum == pytest.approx(total, abs=1e-12)
    assert found.safety_factor == pytest.approx(safety, abs=1e-12)
    if length is not None:
        assert found.length_cells == pytest.approx(length, abs=5e-7)


def is_open(p_s: NDArray[np.float64], here: Cell, there: Cell) -> bool:
    """Return whether a step enters no wall and passes no corner of a wall; a step out of a wall may."""
    beside = p_s[here[0], there[1]], p_s[there[0], here[1]]
    return math.isfinite(p_s[there]) and (math.isinf(p_s[here]) or max(beside) < math.inf)


def scipy_costs(
    p_s: NDArray[np.float64], goals: tuple[Cell, ...], w: float, psi: float
) -> NDArray[np.float64]:
    """Return the least cost from every cell to the nearest goal, by scipy on an explicit graph."""
    rows, cols = p_s.shape
    tails, heads, costs = [], [], []
    for row in range(rows):
        for col in range(cols):
            for d_row, d_col in STEPS:
                r, c = row + d_row, col + d_col
                if 0 <= r < rows and 0 <= c < cols and is_open(p_s, (row, col), (r, c)):
                    d = ROOT2 if d_row and d_col else 1.0
                    # backwards: scipy searches from the goals. It drops edges of cost 0, hence the tiny one.
                    tails.append(r * cols + c)
                    heads.append(row * cols + col)
                    costs.append(max((1.0 - w) * psi * d + w * p_s[r, c], 1e-300))
    graph = csr_array((costs, (tails, heads)), shape=(rows * cols, rows * cols))
    indices = sorted({r * cols + c for r, c in goals})
    return np.asarray(scipy_dijkstra(graph, indices=indices)).min(axis=0).reshape(rows, cols)


def field_of(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float64]:
    if kind == "belief":
        occupied = np.where(rng.random(shape) < 0.3, rng.random(shape) < 0.1, 0.06)
        return exposure(occupied.astype(float), FIRING)
    if kind == "few levels":
        return rng.choice([0.1, 0.2, 0.3], shape)
    values = rng.random(shape)
    if kind == "zero":
        values *= 0.0
    if kind == "mostly zero":
        values[rng.random(shape) < 0.8] = 0.0
    if kind == "ridges":  # long routes with many reversals
        values *= 0.01
        values[::4, :-1] = 5.0
        values[2::4, 1:] = 5.0
    if kind == "soft walls":
        return np.where(rng.random(shape) < 0.3, 10.0 ** rng.integers(1, 9), values)
    if kind == "walls":
        values[rng.random(shape) < 0.15] = math.inf
    if kind == "maze":
        values[rng.random(shape) < 0.35] = math.inf
    return values


KINDS = ("random", "belief", "few levels", "zero", "mostly zero", "ridges", "soft walls", "walls", "maze")


@pytest.mark.parametrize("w", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 12), (33, 18)])
@pytest.mark.parametrize("kind", KINDS)
def test_the_field_equals_that_of_scipy(shape: tuple[int, int], w: float, kind: str) -> None:
    rng = np.random.default_rng([*shape, KINDS.index(kind), int(10 * w)])
    p_s = field_of(kind, shape, rng)
    psi = float(rng.choice([0.0, 0.132, 1.0]))
    goals = tuple(
        (int(rng.integers(shape[0])), int(rng.integers(shape[1]))) for _ in range(rng.integers(1, 4))
    )
    field = cost_to_go(p_s, goals, w, psi)
    np.testing.assert_allclose(field.cost, scipy_costs(p_s, goals, w, psi), rtol=1e-11, atol=1e-250)
    for _ in range(5):
        start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        if math.isinf(field.cost[start]):
            with pytest.raises(Unreachable):
                route(p_s, start, goals, w, psi)
            continue
        found = route(p_s, start, goals, w, psi)
        assert found.cost == pytest.approx(field.cost[start], rel=1e-11, abs=1e-250)
        assert found.cost == pytest.approx(eq5(p_s, found.cells, w, psi), rel=1e-14)
        assert found.cells == field.cells_from(start)


@pytest.mark.parametrize("shape", [(1, 3), (2, 2), (2, 3), (3, 3), (2, 4)])
def test_a_route_has_the_least_cost_of_all_routes_and_then_the_least_length(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(shape)
    start, goal = (0, 0), (shape[0] - 1, shape[1] - 1)
    every = all_routes(shape, start, frozenset([goal]))
    for w in (0.0, 0.5, 1.0, float(rng.random())):
        for p_s in (rng.random(shape), rng.choice([0.0, 0.5], shape), np.zeros(shape)):
            points = [((1.0 - w) * 0.3 * length + w * total, length) for length, total in every.points(p_s)]
            least = min(points)[0]
            found = route(p_s, start, (goal,), w, 0.3)
            assert found.cost == pytest.approx(least, rel=1e-12, abs=1e-15)
            lengths = [length for cost, length in points if cost <= least + 1e-12]
            assert found.length_cells == pytest.approx(min(lengths))


@settings(max_examples=examples(40), deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.5, 1.0]), st.sampled_from(["prior", *KINDS]))
def test_a_replan_without_changes_gives_the_rest_of_the_route(seed: int, w: float, kind: str) -> None:
    rng = np.random.default_rng(seed)
    p_s = exposure(np.full((12, 15), 0.06), FIRING) if kind == "prior" else field_of(kind, (12, 15), rng)
    start, goal = (int(rng.integers(12)), 0), (int(rng.integers(12)), 14)
    p_s[start] = p_s[goal] = 0.0
    with contextlib.suppress(Unreachable):
        cells = route(p_s, start, (goal,), w, 0.132).cells
        for k in range(1, len(cells)):
            assert route(p_s, cells[k], (goal,), w, 0.132).cells == cells[k:]


def test_a_plan_for_a_swarm_has_the_routes_of_its_single_vehicles() -> None:
    field = cost_to_go(np.random.default_rng(2).random((30, 40)), ((3, 39), (25, 38)), 0.5, 0.132)
    starts = [(0, 0), (29, 0), (3, 39)]
    paths = [tuple(map(tuple, path.tolist())) for path in field.paths_from(starts)]
    assert paths == [field.cells_from(start) for start in starts]
    with pytest.raises(BadProblem, match=r"\(30, 0\)"):
        field.paths_from([(0, 0), (30, 0)])


def test_rounding_errors_do_not_change_a_route() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        # few levels, so that many routes cost the same and only rounding could tell them apart
        p_s = rng.choice([0.1, 0.2, 0.3], (15, 15))
        jittered = p_s * (1.0 + rng.choice([-1.0, 0.0, 1.0], p_s.shape) * np.finfo(float).eps)
        for w in (0.25, 0.5):
            assert (
                route(p_s, (7, 0), ((7, 14),), w, 0.2).cells
                == route(jittered, (7, 0), ((7, 14),), w, 0.2).cells
            )


@pytest.mark.parametrize("large", [1, 10**9])
def test_an_exposure_changed_in_place_changes_the_field(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dijkstra, "LARGE_AREA_CELLS", large)
    p_s = np.full((5, 5), 0.1)
    problem = Problem(p_s, (2, 0), ((2, 4),), 0.9, 0.01)
    straight = plan(problem, Params())
    assert straight.cells == tuple((2, col) for col in range(5))
    p_s[2, 2] = 5.0
    assert (2, 2) not in plan(problem, Params()).cells
    p_s[2, 2] = 0.1
    assert plan(problem, Params()) == straight


@pytest.mark.parametrize("large", [1, 10**9])
def test_earlier_plans_do_not_change_a_field(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dijkstra, "LARGE_AREA_CELLS", large)
    monkeypatch.setattr(dijkstra, "MAX_KEPT_CELLS", 500)
    rng = np.random.default_rng(3)
    fields = [field_of(kind, (12, 17), rng) for kind in ("random", "belief", "random")]
    problems = [
        Problem(p_s, (start, 0), goals, w, 0.13)
        for p_s in fields
        for start in (0, 5, 11)
        for goals in (((4, 16),), ((0, 16), (11, 16)))
        for w in (0.0, 0.5)
    ]
    alone = [plan(problem, Params()) for problem in problems]
    for index in rng.permutation(np.repeat(np.arange(len(problems)), 3)):
        assert plan(problems[index], Params()) == alone[index]
