"""Replanning is exact: after any observations its route equals that of a search of the whole area."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from scipy import ndimage

from swarmctl.core.grid import Cell
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import BadProblem, Problem, Route, Unreachable, cost_to_go, dijkstra, replan
from swarmctl.planners.replan import Layers, Replanner

KERNEL = FiringStrength(0.6, 0.3, 0.1).kernel


class World:
    """Hostiles found cell by cell, and the layers of exposure from them (Eq. 3 over Eq. 4)."""

    def __init__(self, rng: np.random.Generator, shape: tuple[int, int], walls: float) -> None:
        self.truth = rng.random(shape) < 0.08
        self.seen = np.zeros(shape, dtype=bool)
        self.walls = rng.random(shape) < walls
        self.layers = Layers(np.empty(shape), np.empty(shape), 0.0)
        self.refresh()

    def look(self, cell: Cell) -> list[Cell]:
        """Observe the 3 × 3 cells around a cell and return the cells with changed layers."""
        self.seen[tuple(slice(max(i - 1, 0), i + 2) for i in cell)] = True
        self.refresh()
        rows, cols = self.truth.shape
        return [
            (r, c)
            for r in range(max(cell[0] - 2, 0), min(cell[0] + 3, rows))
            for c in range(max(cell[1] - 2, 0), min(cell[1] + 3, cols))
        ]

    def refresh(self) -> None:
        def around(cells: NDArray[np.bool_]) -> NDArray[np.float64]:
            return ndimage.correlate(cells.astype(float), KERNEL, mode="constant")

        self.layers.known[...] = np.where(self.walls, math.inf, around(self.truth & self.seen))
        self.layers.unseen[...] = around(~self.seen)
        left = int((self.truth & ~self.seen).sum())
        self.layers.p_unseen = left / max(int((~self.seen).sum()), 1)

    def exposure(self) -> NDArray[np.float64]:
        return self.layers.known + self.layers.p_unseen * self.layers.unseen


def agree(
    planner: Replanner, exposure: NDArray[np.float64], start: Cell, w: float, psi: float
) -> Route | None:
    """Check that the replanner and a new search find the same route, or both none; return the route."""
    problem = Problem(exposure, start, planner.goals, w, psi)
    try:
        expected = dijkstra.plan(problem, dijkstra.Params())
    except Unreachable:
        with pytest.raises(Unreachable):
            planner.route(start)
        return None
    assert planner.route(start) == expected.cells
    return expected


@pytest.fixture
def boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set small boxes and no limit on large ones, so that small areas behave as large ones."""
    monkeypatch.setattr(replan, "FIRST_MARGIN_CELLS", 1)
    monkeypatch.setattr(replan, "LARGEST_BOX_SHARE", 0.9)
    monkeypatch.setattr(replan, "SAMPLE_STRIDE", 3)


@pytest.mark.usefixtures("boxes")
@pytest.mark.parametrize("walls", [0.0, 0.1])
@settings(max_examples=examples(25), deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), w=st.sampled_from([0.0, 0.3, 0.5, 0.9, 1.0]))
def test_every_replanned_route_equals_that_of_a_new_search(walls: float, seed: int, w: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(3, 28)), int(rng.integers(3, 40)))
    world = World(rng, shape, walls)
    goals = tuple((int(rng.integers(shape[0])), shape[1] - 1) for _ in range(int(rng.choice([1, 1, 3]))))
    start = (int(rng.integers(shape[0])), 0)
    planner = Replanner(world.layers, goals, w, 0.13)
    for _ in range(25):
        peer = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        planner.changed(world.look(start if rng.random() < 0.6 else peer))
        expected = agree(planner, world.exposure(), start, w, 0.13)
        if expected is None:
            return
        if len(expected.cells) > 1 and rng.random() < 0.5:
            start = expected.cells[1]
        elif rng.random() < 0.1:
            start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))


def test_a_long_flight_over_a_large_area_searches_little_of_it() -> None:
    rng = np.random.default_rng(1)
    world = World(rng, (150, 300), 0.0)
    start, goal = (75, 0), (75, 299)
    planner = Replanner(world.layers, (goal,), 0.5, 0.13)
    searched = []
    for step in range(200):
        peer = (int(rng.integers(150)), int(rng.integers(300)))
        planner.changed(world.look(peer if step % 10 == 9 else start))
        route = planner.route(start)
        searched.append(planner.searched_cells)
        if step % 20 == 0:
            problem = Problem(world.exposure(), start, (goal,), 0.5, 0.13)
            assert route == dijkstra.plan(problem, dijkstra.Params()).cells
        start = route[1]
    assert np.median(searched) < 0.2 * world.truth.size


VALUES = {
    "levels": (0.0, 0.1, 0.2, 0.3, 0.7),
    "zero": (0.0, 0.0, 0.0, 1.0, math.inf),
    "walls": (0.05, 0.3, 0.6, 0.9, math.inf),
    "soft walls": (0.1, 0.2, 0.3, 1e9, 1e17),
    "tiny": (1e-300, 1e-150, 1e-20, 1e-3, 1.0),
}


@pytest.mark.usefixtures("boxes")
@pytest.mark.parametrize("kind", VALUES)
@settings(max_examples=examples(30), deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 100_000),
    w=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
    psi=st.sampled_from([0.0, 0.05, 1.0]),
)
def test_any_cell_may_take_any_value_at_any_time(kind: str, seed: int, w: float, psi: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(2, 26)), int(rng.integers(8, 40)))
    layers = Layers(rng.choice(VALUES[kind], shape), rng.choice([0.0, 1.0], shape), 0.1)
    goals = [(int(rng.integers(shape[0])), int(rng.integers(shape[1]))) for _ in range(rng.choice([1, 2, 6]))]
    planner = Replanner(layers, goals, w, psi)
    start = (int(rng.integers(shape[0])), 0)
    for _ in range(12):
        cells = [
            (int(rng.integers(shape[0])), int(rng.integers(shape[1]))) for _ in range(rng.integers(0, 6))
        ]
        for cell in cells:
            layers.known[cell] = rng.choice(VALUES[kind])
            layers.unseen[cell] = rng.choice([0.0, 1.0, 3.0])
        layers.p_unseen *= float(rng.choice([0.5, 0.9, 1.0, 1.1]))
        planner.changed(cells)
        if rng.random() < 0.3:
            start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        agree(planner, layers.known + layers.p_unseen * layers.unseen, start, w, psi)


@pytest.mark.usefixtures("boxes")
@pytest.mark.parametrize("walls", [0.0, 0.05])
@settings(max_examples=examples(40), deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), w=st.sampled_from([0.5, 0.9, 1.0]))
def test_the_changes_of_a_new_exposure_are_found(walls: float, seed: int, w: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (25, 40)
    base = rng.random(shape) * rng.choice([0.05, 1.0])
    base[3::4] += 2.0
    base[rng.random(shape) < walls] = math.inf
    goal, start = (int(rng.integers(25)), 39), (int(rng.integers(25)), 3)
    planner = Replanner(Layers(base, np.zeros(shape), 0.0), (goal,), w, 0.05)
    for _ in range(15):
        base = base * rng.uniform(0.9, 1.1)
        for _ in range(int(rng.integers(4))):
            gate = (int(rng.integers(25)), int(rng.integers(40)))
            base[gate] = rng.choice([0.0, 0.01, 3.0, math.inf], p=[0.4, 0.3, 0.2, 0.1])
        planner.renew(base)
        agree(planner, base, start, w, 0.05)
        start = (int(rng.integers(25)), int(rng.integers(40)))


@pytest.mark.usefixtures("boxes")
def test_a_removed_cell_of_huge_exposure_leaves_no_rounding_error() -> None:
    wall, start, goal = 1e17, (30, 0), (30, 79)
    for share in np.linspace(0.05, 0.95, 19):
        known = np.full((40, 80), 0.38)
        known[5, 1:79] = 0.0  # a free route to one side, which the wall closes
        known[:28, 40] = 0.0
        by_side = float(cost_to_go(known, goal, 1.0, 0.1).cost[start])
        known[:28, 40] = wall
        # The straight route costs more, by less than the precision of a sum that includes the wall.
        known[30] = (by_side + share * np.spacing(wall)) / 79
        planner = Replanner(known, goal, 1.0, 0.1)
        planner.route(start)
        known[5, 40] = 0.0
        planner.changed([(5, 40)])
        agree(planner, known, start, 1.0, 0.1)


@pytest.mark.usefixtures("boxes")
def test_a_gate_that_opened_far_away_counts_when_the_route_becomes_dearer() -> None:
    """The gate's way to the goal cost more than the route when the gate opened."""
    known, start, goal, gate = np.full((21, 40), 3.0), (20, 0), (20, 39), (0, 1)
    known[20], known[:, 0] = 0.1, 0.1  # the route, and a side way to the gate
    known[0, 1:], known[:, 39] = 0.075, 0.075  # from the gate to the goal
    known[gate] = 100.0
    planner = Replanner(known, goal, 1.0, 0.0)
    planner.route(start)
    known[gate], known[20, 20] = 0.075, 3.2
    planner.changed([gate, (20, 20)])
    route = agree(planner, known, start, 1.0, 0.0)
    assert route is not None
    assert gate in route.cells


def test_the_route_of_a_start_at_the_goal_is_one_cell() -> None:
    planner = Replanner(Layers(np.ones((3, 3)), np.ones((3, 3)), 0.1), ((1, 1),), 0.5, 0.1)
    assert planner.route((1, 1)) == ((1, 1),)


@pytest.mark.parametrize(
    "exposure",
    [
        np.ones((3, 4), dtype=np.float32),
        np.ones((3, 4), dtype=">f8"),
        np.ma.masked_array(np.ones((3, 4)), np.eye(3, 4)),
        [[1.0, 1.0, 1.0, 1.0]] * 3,
    ],
    ids=["float32", "big-endian", "masked", "a list"],
)
def test_an_exposure_that_only_a_copy_could_hold_is_refused(exposure: Any) -> None:
    with pytest.raises(BadProblem):
        Replanner(exposure, (2, 3), 0.5, 0.1)
    planner = Replanner(np.ones((3, 4)), (2, 3), 0.5, 0.1)
    with pytest.raises(BadProblem):
        planner.renew(exposure)


@pytest.mark.parametrize("renewed", [False, True])
def test_changes_of_a_strided_exposure_are_seen(renewed: bool) -> None:
    exposure = np.full((6, 40), 0.1)[::2, ::2]
    planner = Replanner(np.ones((3, 20)) if renewed else exposure, (1, 19), 1.0, 0.1)
    if renewed:
        planner.renew(exposure)
    assert (1, 10) in planner.route((1, 0))
    exposure[1, 10] = math.inf
    planner.changed([(1, 10)])
    assert (1, 10) not in planner.route((1, 0))


def test_bad_layers_are_refused() -> None:
    known, unseen = np.zeros((3, 4)), np.ones((3, 4))
    with pytest.raises(BadProblem, match=r"\(3, 4\) .* \(3, 3\)"):
        Replanner(Layers(known, unseen[:, :3], 0.1), ((0, 0),), 0.5, 0.1)
    with pytest.raises(BadProblem, match=r"\(0, 0\) is -1.0"):
        Replanner(Layers(known, -unseen, 1.0), ((0, 0),), 0.5, 0.1)
    with pytest.raises(BadProblem, match=r"w = 1\.5"):
        Replanner(Layers(known, unseen, 0.1), ((0, 0),), 1.5, 0.1)
    planner = Replanner(Layers(known, unseen, 0.1), ((0, 0),), 0.5, 0.1)
    with pytest.raises(BadProblem, match=r"\(3, 0\)"):
        planner.route((3, 0))
    with pytest.raises(BadProblem, match=r"\(3, 5\)"):
        planner.renew(np.zeros((3, 5)))
    with pytest.raises(BadProblem, match=r"\(0, 0\) is -1.0"):
        planner.renew(np.full((3, 4), -1.0))
    with pytest.raises(BadProblem, match=r"\(3, 0\)"):
        planner.changed([(3, 0)])
    with pytest.raises(BadProblem, match=r"\(0.5, 0\)"):
        planner.changed([(0.5, 0)])  # type: ignore[list-item]
    known[1, 2] = math.nan
    with pytest.raises(BadProblem, match=r"\(1, 2\)"):
        planner.changed([(1, 2)])


@pytest.mark.parametrize("p_unseen", [math.nan, -1.0, math.inf])
def test_an_invalid_p_unseen_is_refused(p_unseen: float) -> None:
    layers = Layers(np.full((9, 9), 0.1), np.ones((9, 9)), 0.1)
    planner = Replanner(layers, ((4, 8),), 0.5, 0.1)
    layers.p_unseen = p_unseen
    with pytest.raises(BadProblem, match="p_unseen"):
        planner.route((4, 0))


@pytest.mark.usefixtures("boxes")
@pytest.mark.parametrize("value", [-5.0, math.nan])
def test_an_invalid_exposure_gives_no_route_even_without_a_call_of_changed(value: float) -> None:
    layers = Layers(np.full((9, 60), 0.1), np.zeros((9, 60)), 0.0)
    planner = Replanner(layers, ((4, 59),), 0.5, 0.1)
    layers.known[4, 30] = value
    with pytest.raises(BadProblem, match=r"\(\d+, \d+\)"):
        planner.route((4, 0))
