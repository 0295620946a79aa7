"""The planners as a library: plain arrays in, routes out, and nothing else of the package is loaded."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from swarmctl import planners
from swarmctl.planners import PLANNERS, Problem, plan, warm_up

FIELD = np.random.default_rng(1).random((12, 20)) * 0.3
PROBLEM = Problem(FIELD, (6, 0), ((6, 19),), 0.5, 0.13, max_length_cells=25.0)


@pytest.mark.parametrize("name", PLANNERS)
def test_plan_asks_the_planner_of_that_name(name: str) -> None:
    assert plan(PROBLEM, name) == PLANNERS[name].plan(PROBLEM, PLANNERS[name].Params())


def test_plan_without_a_name_is_the_papers() -> None:
    assert plan(PROBLEM) == plan(PROBLEM, "dijkstra")


def test_options_reach_the_planner() -> None:
    assert plan(PROBLEM, "time_bound", minimise="distance").length_cells == 19.0


@pytest.mark.parametrize(
    ("planner", "options", "says"),
    [
        ("astar", {}, "no planner 'astar'; there is constrained, dijkstra, survival, time_bound"),
        ("dijkstra", {"w": 0.5}, "planner dijkstra has no option 'w'; it has none"),
        ("time_bound", {"minimize": "distance"}, "has no option 'minimize'; there is minimise"),
        ("time_bound", {"minimise": "time"}, "options of planner time_bound: invalid enum value 'time'"),
        ("constrained", {"max_labels": -1}, "max_labels = -1: expected 0 or more"),
        ("constrained", {"max_labels": "many"}, "options of planner constrained: expected `int | null`"),
    ],
)
def test_what_there_is_not_is_said(planner: str, options: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says.replace("|", r"\|")):
        plan(PROBLEM, planner, **options)


def test_the_example_in_the_documentation_runs() -> None:
    example = [line[4:] for line in (planners.__doc__ or "").splitlines() if line.startswith("    ")]
    assert "pareto_front(problem)" in "\n".join(example)
    exec(compile("\n".join(example), "example", "exec"), {})


def test_planning_loads_nothing_that_talks_to_vehicles_or_people() -> None:
    foreign = ("pymavlink", "zenoh", "mavsdk", "pydantic", "matplotlib", "typer", "rich", "mcap", "serial")
    program = f"""
import sys
import numpy as np
from swarmctl.planners import Problem, plan
print(len(plan(Problem(np.zeros((3, 3)), (0, 0), ((2, 2),), 0.5, 0.1)).cells))
print([name for name in {foreign} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "3\n[]\n"


def test_threads_that_plan_at_once_find_what_each_would_find_alone() -> None:
    warm_up()
    problems = [
        Problem(FIELD, (row, 0), ((goal, 19),), w, 0.13)
        for row in (0, 6)
        for goal in (3, 9)
        for w in (0.5, 0.9)
    ]
    alone = [plan(problem) for problem in problems]
    found: dict[int, list[object]] = {}

    def work(thread: int) -> None:
        order = np.random.default_rng(thread).permutation(len(problems) * 20) % len(problems)
        found[thread] = [plan(problems[i]) == alone[i] for i in order]

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(all(answers) for answers in found.values())
    assert len(found) == 4
