"""The planners as a library: plain arrays in, routes out."""

import re
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from inspect import getdoc
from pathlib import Path

import numpy as np
import pytest
from profiles import examples

from swarmctl import planners
from swarmctl.planners import PLANNERS, Problem, Replanner, cost_to_go, dijkstra, plan, warm_up

PAGE = Path(__file__).parents[2] / "docs" / "planner-library.md"
FIELD = np.random.default_rng(1).random((12, 20)) * 0.3
PROBLEM = Problem(FIELD, (6, 0), ((6, 19),), 0.5, 0.13, max_length_cells=25.0)


@pytest.mark.parametrize("name", PLANNERS)
def test_plan_uses_the_planner_of_the_given_name(name: str) -> None:
    assert plan(PROBLEM, name) == PLANNERS[name].plan(PROBLEM, PLANNERS[name].Params())
    assert plan(PROBLEM) == plan(PROBLEM, "dijkstra")


def test_options_reach_the_planner() -> None:
    assert plan(PROBLEM, "time_bound", minimise="distance").length_cells == 19.0


@pytest.mark.parametrize(
    ("planner", "options", "named"),
    [
        ("astar", {}, ["astar", *PLANNERS]),
        ("dijkstra", {"w": 0.5}, ["dijkstra", "w"]),
        ("time_bound", {"minimize": "distance"}, ["time_bound", "minimize", "minimise"]),
        ("time_bound", {"minimise": "time"}, ["time_bound", "time"]),
        ("constrained", {"max_labels": -1}, ["constrained", "max_labels", "-1"]),
        ("constrained", {"max_labels": "many"}, ["constrained", "max_labels", "int"]),
    ],
)
def test_an_unknown_planner_or_option_is_refused_with_the_known_ones(
    planner: str, options: dict[str, object], named: list[str]
) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the message is checked below
        plan(PROBLEM, planner, **options)
    assert all(name in str(caught.value) for name in named)


def example_of(documented: object) -> str:
    """Return the indented lines of an object's documentation."""
    return "\n".join(line[4:] for line in (getdoc(documented) or "").splitlines() if line.startswith("    "))


def test_the_example_in_the_documentation_runs() -> None:
    example = example_of(planners)
    assert "pareto_front(problem)" in example
    exec(compile(example, "example", "exec"), {})


def test_the_examples_of_the_page_run_one_after_the_other() -> None:
    examples = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, str(PAGE), "exec"), names)
    assert {"pareto_front", "route"} <= set(names)


def test_the_example_of_the_replanner_runs() -> None:
    example = example_of(Replanner)
    assert "replanner.changed(" in example
    scope: dict[str, object] = {"np": np, "Replanner": Replanner}
    exec(compile(example, "example", "exec"), scope)
    exposure = scope["exposure"]
    assert isinstance(exposure, np.ndarray)
    problem = Problem(exposure, (250, 100), (250, 499), 0.5, 0.13)  # type: ignore[arg-type]
    replanner = scope["replanner"]
    assert isinstance(replanner, Replanner)
    assert replanner.route((250, 100)) == plan(problem).cells


@pytest.fixture
def hurried() -> Iterator[None]:
    """Let threads switch as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def in_threads(work: Callable[[int], list[bool]]) -> list[bool]:
    """Return the answers of four threads at once; raise the error of any of them."""
    with ThreadPoolExecutor(4) as threads:
        return [answer for answers in threads.map(work, range(4)) for answer in answers]


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("large", [1, 10**9])
def test_threads_that_plan_at_the_same_time_find_the_routes_of_single_threads(
    large: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dijkstra, "LARGE_AREA_CELLS", large)
    monkeypatch.setattr(dijkstra, "MAX_KEPT_CELLS", 3 * FIELD.size)
    warm_up()
    problems = [
        Problem(FIELD, (row, 0), ((goal, 19),), w, 0.13)
        for row in (0, 6)
        for goal in (3, 9)
        for w in (0.5, 0.9)
    ]
    alone = [plan(problem) for problem in problems]
    n_times = examples(60, 20)

    def work(thread: int) -> list[bool]:
        order = np.random.default_rng(thread).permutation(len(problems) * n_times) % len(problems)
        return [plan(problems[i]) == alone[i] for i in order]

    answers = in_threads(work)
    assert len(answers) == 4 * n_times * len(problems)
    assert all(answers)


@pytest.mark.usefixtures("hurried")
def test_threads_may_share_a_field() -> None:
    walled = np.where(np.random.default_rng(3).random((60, 80)) < 0.1, np.inf, 0.1)
    walled[30, 79] = walled[:, 0] = 0.1
    for w in (0.0, 1.0):  # many routes of equal cost, so that the length decides
        starts = [(row, 0) for row in range(60)]
        alone = [cost_to_go(walled, [(30, 79)], w, 0.1).cells_from(start) for start in starts]
        for _ in range(5):
            field = cost_to_go(walled, [(30, 79)], w, 0.1)
            assert all(in_threads(lambda _: [field.cells_from(s) == a for s, a in zip(starts, alone)]))  # noqa: B023, B905
