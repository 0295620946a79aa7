"""Planning times on one core, as ratios to the times of other libraries in the same run.

First `pip install -e '.[bench]'`. The run takes some minutes. Times are medians of CPU time on this machine
at this moment. Compared functions run alternately, so that noise affects all of them.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import psutil
from echo import round_trips_s
from numpy.typing import NDArray
from peers import PEERS
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from scenes import Crossing, observed_field, random_field
from tables import make_table

from swarmctl.core.grid import Cell
from swarmctl.planners import Problem, constrained, formation, plan, time_bound, warm_up
from swarmctl.planners.dijkstra import CostToGo, cost_to_go
from swarmctl.planners.kernels import spread
from swarmctl.planners.replan import Replanner

PSI = 0.132
"""prior P_s of an inner cell: 6 hostiles in 100 cells with firing strengths 0.6, 0.3 and 0.1"""
Floats = NDArray[np.float64]
console = Console(width=130)


def call_s(run: Callable[[], object], clock: Callable[[], float] = time.thread_time) -> float:
    """Return the time of one call [s]: CPU time of this thread, so that a busy machine matters less."""
    began_s = clock()
    run()
    return clock() - began_s


def medians_s(
    runs: dict[str, Callable[[], object]], n_times: int, clock: Callable[[], float] = time.thread_time
) -> dict[str, float]:
    """Return the median time of each function [s]; the functions run alternately."""
    times_s: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(n_times):
        for name, run in runs.items():
            times_s[name].append(call_s(run, clock))
    return {name: float(np.median(each_s)) for name, each_s in times_s.items()}


def field_tables(sides: tuple[int, ...]) -> Iterator[Table]:
    """Compare the time for the cost-to-go field of the whole area with the times of other libraries."""
    for kind, make in (("after observations", observed_field), ("random in [0, 0.3]", random_field)):
        table = make_table(
            f"Cost-to-go field, P_s {kind}, w = 0.5: times in multiples of the time of cost_to_go",
            "search",
            *(f"{side}²" for side in sides),
            left=["search"],
        )
        ratios: dict[str, list[str]] = {name: [] for name in PEERS}
        own = []
        for side in sides:
            exposure, goal = make(side), (side // 2, side - 1)
            runs: dict[str, Callable[[], object]] = {}
            runs["swarmctl"] = lambda: cost_to_go(exposure, [goal], 0.5, PSI)  # noqa: B023
            for name, (prepare, largest) in PEERS.items():
                if side <= largest:
                    runs[name] = prepare(exposure, goal, 0.5, PSI)
            found = medians_s(runs, 3 if side >= 1000 else 7)
            own.append(found["swarmctl"] / side**2)
            for name in PEERS:
                ratios[name].append(f"{found[name] / found['swarmctl']:.1f}" if name in found else "–")
            del runs
            gc.collect()
        for name, row in ratios.items():
            table.add_row(name, *row)
        table.add_section()
        table.add_row(escape("cost_to_go [ns a cell]"), *(f"{1e9 * s:.1f}" for s in own))
        yield table


def queue_table(sides: tuple[int, ...]) -> Table:
    """Compare with the queue of buckets in C++, at several weights."""
    weights = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)
    table = make_table(
        "Cost-to-go field: time of a bucket queue in C++ / time of cost_to_go (ns a cell)",
        *("P_s", "area", *(f"w = {w:g}" for w in weights)),
        left=["P_s", "area"],
    )
    for kind, make in (("after observations", observed_field), ("random", random_field)):
        for side in sides:
            exposure, goal, row = make(side), (side // 2, side - 1), []
            for w in weights:
                runs: dict[str, Callable[[], object]] = {}
                runs["C++"] = PEERS["bucket queue in C++"][0](exposure, goal, w, PSI)
                runs["swarmctl"] = lambda: cost_to_go(exposure, [goal], w, PSI)  # noqa: B023
                found = medians_s(runs, 3 if side >= 2000 else 11)
                own_ns = 1e9 * found["swarmctl"] / side**2
                row.append(f"{found['C++'] / found['swarmctl']:.2f} ({own_ns:.0f})")
            table.add_row(kind, f"{side}²", *row)
    return table


def walled_field_table(side: int) -> Table:
    """Measure fields with walls, which the bucket queue in C++ does not know."""
    table = make_table(
        f"Random fields of {side}² cells, a tenth of the cells walls",
        *("w", "cost_to_go [ns a cell]", "scipy, graph built [ratio]"),
    )
    rng = np.random.default_rng(5)
    walled = random_field(side)
    walled[rng.random(walled.shape) < 0.1] = np.inf
    goal = (side // 2, side - 1)
    walled[goal] = 0.1
    for w in (0.5, 1.0):
        runs: dict[str, Callable[[], object]] = {"swarmctl": lambda: cost_to_go(walled, [goal], w, PSI)}  # noqa: B023
        runs["scipy"] = PEERS["scipy, graph built"][0](np.minimum(walled, 1e6), goal, w, PSI)
        found = medians_s(runs, 3)
        ratio = found["scipy"] / found["swarmctl"]
        table.add_row(f"{w:g}", f"{1e9 * found['swarmctl'] / side**2:.1f}", f"{ratio:.1f}")
    return table


def threads_table(side: int) -> Table:
    """Compare two fields with different goals in two threads with the same fields one after the other."""
    table = make_table(f"Two goals on {side}² cells", "w", "two threads [ratio to one after the other]")
    exposure, goals = observed_field(side), ((side // 2, side - 1), (side // 3, 0))
    with ThreadPoolExecutor(2) as pool:
        for w in (0.5, 1.0):

            def search(goal: Cell) -> CostToGo:
                return cost_to_go(exposure, [goal], w, PSI)  # noqa: B023

            runs: dict[str, Callable[[], object]] = {}
            runs["in turn"] = lambda: [search(goal) for goal in goals]
            runs["at once"] = lambda: list(pool.map(search, goals))
            found = medians_s(runs, 7, time.perf_counter)
            table.add_row(f"{w:g}", f"{found['at once'] / found['in turn']:.2f}")
    return table


TURNS = 10
"""observations in one area; few, so that the vehicle stays about half-way"""


def replan_table(side: int, times: int) -> Table:
    """Compare a replan after one new 3 × 3 observation with a new field of the whole area.

    The area changes after each TURNS replans. The first field of an area does not count.
    """
    table = make_table(
        f"Replans on {side}² cells, vehicle half-way, after one 3 × 3 observation",
        *("observer, goal, w", "new field [ms]", "replan p50 [ms]", "p99 [ms]"),
        *("new field / p50", "new field / p99", "cells searched"),
        left=["observer, goal, w"],
    )
    straight, aside, near = (side // 2, side - 1), (side * 3 // 10, side - 1), (side // 2 - 20, side - 1)
    for name, goal, seen_share, anywhere, w in (
        ("vehicle, straight across, 0.5", straight, 0.0, False, 0.5),
        ("vehicle, a third seen, 0.5", near, 0.33, False, 0.5),
        ("vehicle, a third seen, 0.9", near, 0.33, False, 0.9),
        ("vehicle, a third seen, 1", near, 0.33, False, 1.0),
        ("vehicle, goal to one side, 0.5", aside, 0.0, False, 0.5),
        ("a peer anywhere, straight across, 0.5", straight, 0.0, True, 0.5),
        ("a peer anywhere, a third seen, 0.5", near, 0.33, True, 0.5),
    ):
        new_field_s, replan_s, searched = [], [], []
        for seed in range(times // TURNS):
            crossing = Crossing(side, goal, seen_share, seed)
            planner = Replanner(crossing.layers, [goal], w, PSI)
            route = planner.route(crossing.position)
            for turn in range(TURNS):
                if not anywhere:
                    crossing.position = route[1]
                while not (cells := crossing.observe(anywhere=anywhere)):
                    crossing.position = crossing.position if anywhere else route[1]
                    route = planner.route(crossing.position)

                def replan() -> None:
                    nonlocal route
                    planner.changed(cells)  # noqa: B023
                    route = planner.route(crossing.position)  # noqa: B023

                replan_s.append(call_s(replan))
                searched.append(planner.searched_cells)
                if turn == 0:
                    exposure = crossing.layers.known + crossing.layers.p_unseen * crossing.layers.unseen
                    full: list[CostToGo] = []
                    new_field_s.append(call_s(lambda: full.append(cost_to_go(exposure, [goal], w, PSI))))  # noqa: B023
                    assert full[0].cells_from(crossing.position) == route, "replanning is exact"
        field, p50, p99 = np.median(new_field_s), np.median(replan_s), np.quantile(replan_s, 0.99)
        table.add_row(
            name, f"{1e3 * field:.1f}", f"{1e3 * p50:.2f}", f"{1e3 * p99:.2f}", f"{field / p50:.1f}",
            f"{field / p99:.1f}", f"{int(np.median(searched))}",
        )  # fmt: skip
    return table


def swarm_table(side: int, count: int) -> Table:
    """Compare a replan of one vehicle with a replan of all vehicles, which share one search."""
    table = make_table(f"{count} vehicles with one goal on {side}² cells", "vehicles", "replan [ms]", "ratio")
    exposure, goal = observed_field(side), (side // 2, side - 1)
    starts = [(int(row), 0) for row in np.linspace(0, side - 1, count)]

    def replan(cells: list[Cell]) -> None:
        cost_to_go(exposure, [goal], 0.5, PSI).paths_from(cells)

    found = medians_s({"one": lambda: replan(starts[count // 3 :][:1]), "all": lambda: replan(starts)}, 41)
    for name, s in found.items():
        table.add_row(name, f"{1e3 * s:.2f}", f"{s / found['one']:.2f}")
    return table


def bound_table(side: int, n_fields: int) -> Table:
    """Measure the planners that keep a bound; the unit is the time of one search.

    A search is a field of the whole area in reused memory. One unit has w = 0.5. The other has the
    weights that the planner searched.
    """
    table = make_table(
        f"A length bound halfway along the front, {n_fields} fields of {side}² cells: time in searches",
        *(
            "planner, P_s",
            "searches made",
            "unit w = 0.5: p50",
            "p90",
            "unit own w: p50",
            "p90",
            "proved exact",
        ),
        left=["planner, P_s"],
    )
    planners = (("time_bound", time_bound), ("constrained", constrained))
    for kind, make in (("random", random_field), ("after observations", observed_field)):
        for name, planner in planners:
            n_searches, in_searches, in_own_searches, n_exact = [], [], [], 0
            for seed in range(n_fields):
                problem = bounded_crossing(make(side, seed))
                route = planner.plan(problem, planner.Params())
                taken_s = min(call_s(lambda: planner.plan(problem, planner.Params())) for _ in range(3))  # noqa: B023
                own_s = [search_s(problem, searched.w) for searched in route.searched]
                n_searches.append(len(own_s))
                in_searches.append(taken_s / search_s(problem, 0.5))
                in_own_searches.append(taken_s / np.mean(own_s))
                n_exact += route.lower_bound is not None and route.cost <= route.lower_bound * (1 + 1e-9)
            table.add_row(
                f"{name}, {kind}",
                f"{np.median(n_searches):.0f}",
                *(
                    f"{np.quantile(ratios, q):.1f}"
                    for ratios in (in_searches, in_own_searches)
                    for q in (0.5, 0.9)
                ),
                f"{n_exact} of {n_fields}" if name == "constrained" else "–",
            )
    return table


def search_s(problem: Problem, w: float) -> float:
    """Return the time of one field of the whole area [s]."""
    field = spread(problem.exposure, problem.goals, w, PSI)
    return min(call_s(lambda: spread(problem.exposure, problem.goals, w, PSI, into=field)) for _ in range(3))


def bounded_crossing(exposure: Floats) -> Problem:
    """Return a crossing with a length bound: the mean of the shortest and the least exposed route."""
    side = exposure.shape[0]
    start, goals = (side // 2, 0), ((side // 3, side - 1),)
    lengths = []
    for w in (0.0, 1.0):
        cells = cost_to_go(exposure, goals, w, PSI).cells_from(start)
        steps = np.abs(np.diff(np.array(cells), axis=0)).sum(axis=1)
        lengths.append(float(np.sqrt(steps).sum()))
    return Problem(exposure, start, goals, 0.5, PSI, max_length_cells=sum(lengths) / 2)


def formation_table(sides: tuple[int, ...]) -> Table:
    """Measure the route of a group of five, and of a group of one; every part counts."""
    wedge = ((0.0, 0.0), (-1.0, 1.0), (-1.0, -1.0), (-2.0, 2.0), (-2.0, -2.0))
    column = ((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0), (-3.0, 0.0), (-4.0, 0.0))
    table = make_table(
        "A group's route, w = 0.5 [s]", "group, P_s", *(f"{side}²" for side in sides), left=["group, P_s"]
    )
    for text, shapes in (
        ("one", (((0.0, 0.0),),)),
        ("five, wedge", (wedge,)),
        ("five, wedge or column", (wedge, column)),
    ):
        for kind, make in (("random", random_field), ("after observations", observed_field)):
            row = []
            for side in sides:
                problem = Problem(make(side), (side // 2, 0), ((side // 2, side - 1),), 0.5, PSI)
                params = formation.Params(shapes)
                run: dict[str, Callable[[], object]] = {"group": lambda: formation.plan(problem, params)}  # noqa: B023
                row.append(f"{medians_s(run, 3)['group']:.3f}")
            table.add_row(f"{text}, {kind}", *row)
    return table


def memory_table(side: int) -> Table:
    """Measure the memory of a field, and the growth in a thousand replans."""
    table = make_table("Memory", "", "")
    process, exposure = psutil.Process(os.getpid()), observed_field(side)
    gc.collect()
    before = process.memory_info().rss
    field = cost_to_go(exposure, [(side // 2, side - 1)], 0.5, PSI)
    field.cells_from((side // 3, 0))
    held = process.memory_info().rss - before
    table.add_row(escape(f"a field of {side}² cells and a route [bytes/cell]"), f"{held / side**2:.1f}")
    del field
    crossing = Crossing(side, (side // 2, side - 1), 0.0)
    planner = Replanner(crossing.layers, [crossing.goal], 0.5, PSI)
    held_mb = []
    for turn in range(1100):
        planner.changed(crossing.observe(anywhere=True))
        planner.route(crossing.position)
        if turn in (100, 1099):
            gc.collect()
            held_mb.append(process.memory_info().rss / 2**20)
    table.add_row(escape("growth in a thousand replans [MB]"), f"{held_mb[1] - held_mb[0]:+.1f}")
    return table


def echo_table(side: int, count: int) -> Table:
    """Measure the latency of other threads of the process while a planner searches."""
    table = make_table(
        f"A Zenoh echo over TCP, {count} times",
        *("a thread of the same process computes", "p50 [ms]", "p99 [ms]", "max [ms]"),
        left=["a thread of the same process computes"],
    )
    exposure, goal = observed_field(side), (side // 2, side - 1)
    problem = Problem(exposure, (side // 2, 0), (goal,), 0.5, PSI)
    with_bound = bounded_crossing(observed_field(200))
    for name, background_task in (
        ("nothing", None),
        (f"fields of {side}² cells", lambda: cost_to_go(exposure, [goal], 0.5, PSI)),
        (f"dijkstra on {side}² cells", lambda: plan(problem)),
        ("constrained on 200² cells", lambda: plan(with_bound, "constrained")),
    ):
        p50, p99, maximum = 1e3 * np.quantile(round_trips_s(count, background_task), (0.5, 0.99, 1.0))
        table.add_row(name, f"{p50:.2f}", f"{p99:.2f}", f"{maximum:.2f}")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="without the largest area and most repetitions, about two minutes",
    )
    parser.add_argument(
        "--memory", action="store_true", help="the memory alone, in a process without other measurements"
    )
    options = parser.parse_args()
    quick: bool = options.quick
    warm_up()
    if options.memory:
        console.print(memory_table(1000))
        return
    for table in field_tables((100, 300, 1000) if quick else (100, 300, 1000, 2000)):
        console.print(table)
    if "bucket queue in C++" in PEERS:
        console.print(queue_table((300, 1000) if quick else (300, 1000, 2000, 4000)))
    else:
        console.print("Without the bucket queue in C++: neither g++ nor clang++ is installed.")
    console.print(walled_field_table(1000))
    console.print(threads_table(1000))
    console.print(replan_table(1000, 100 if quick else 1000))
    console.print(swarm_table(200, 50))
    console.print(bound_table(200, 10 if quick else 50))
    console.print(formation_table((100, 300)))
    subprocess.run([sys.executable, __file__, "--memory"], check=True)
    console.print(echo_table(1000, 500 if quick else 3000))


if __name__ == "__main__":
    main()
