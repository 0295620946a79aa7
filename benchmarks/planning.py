"""Planning times as ratios to other libraries, measured in one run on one core.

Run: `pip install -e '.[bench]'`, then `python benchmarks/planning.py` (some minutes; `--quick` leaves out the
largest area). Times are medians of this machine at this moment; compared functions are timed alternately.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import psutil
from echo import round_trips_s
from numpy.typing import NDArray
from peers import PEERS
from rich import box
from rich.console import Console
from rich.table import Table
from scenes import Crossing, observed, random_field

from swarmctl.planners import Problem, constrained, plan, time_bound, warm_up
from swarmctl.planners.dijkstra import CostToGo, cost_to_go
from swarmctl.planners.kernels import spread
from swarmctl.planners.replan import Replanner

PSI = 0.132
"""the prior P_s of an inner cell: 6 hostiles in 100 cells at 0.6/0.3/0.1"""
Floats = NDArray[np.float64]
console = Console(width=110)


def timed(run: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    run()
    return time.perf_counter() - began_s


def in_turns(runs: dict[str, Callable[[], object]], times: int) -> dict[str, float]:
    """Return the median of each [s]; they run alternately, so that noise affects all of them."""
    found: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(times):
        for name, run in runs.items():
            found[name].append(timed(run))
    return {name: float(np.median(several)) for name, several in found.items()}


def table(title: str, *columns: str) -> Table:
    made = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for index, column in enumerate(columns):
        made.add_column(column, justify="left" if index == 0 else "right")
    return made


def full_fields(sides: tuple[int, ...]) -> Iterator[Table]:
    """Compare the cost-to-go field of the whole area with the peers."""
    for kind, make in (("as observed, w = 0.5", observed), ("random in [0, 0.3], w = 0.5", random_field)):
        made = table(
            f"cost to go from every cell, P_s {kind}: times longer than swarmctl takes",
            "peer",
            *(f"{side}²" for side in sides),
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
            found = in_turns(runs, 3 if side >= 1000 else 7)
            own.append(found["swarmctl"] / side**2)
            for name in PEERS:
                ratios[name].append(f"{found[name] / found['swarmctl']:.1f}" if name in found else "–")
            del runs
            gc.collect()
        for name, row in ratios.items():
            made.add_row(name, *row)
        made.add_section()
        made.add_row("swarmctl [ns a cell]", *(f"{1e9 * s:.1f}" for s in own))
        yield made


def hard_fields(side: int) -> Table:
    """Measure cases in which the sweeps do not help: random costs with little weight on length, and walls."""
    made = table(
        f"{side}², harder fields: ns a cell, and times scipy (graph built)", "P_s", "w", "ns a cell", "ratio"
    )
    rng = np.random.default_rng(5)
    walled = random_field(side)
    walled[rng.random(walled.shape) < 0.1] = np.inf
    walled[side // 2, side - 1] = 0.1
    for name, exposure, w in (
        ("as observed", observed(side), 0.9),
        ("as observed", observed(side), 1.0),
        ("random", random_field(side), 0.9),
        ("random", random_field(side), 1.0),
        ("random, a tenth walls", walled, 0.5),
    ):
        goal = (side // 2, side - 1)
        runs: dict[str, Callable[[], object]] = {"swarmctl": lambda: cost_to_go(exposure, [goal], w, PSI)}  # noqa: B023
        runs["scipy"] = PEERS["scipy, graph built"][0](np.minimum(exposure, 1e6), goal, w, PSI)
        found = in_turns(runs, 3)
        ratio = found["scipy"] / found["swarmctl"]
        made.add_row(name, f"{w:g}", f"{1e9 * found['swarmctl'] / side**2:.1f}", f"{ratio:.1f}")
    return made


TURNS = 10
"""observations of one crossing, so that the vehicle is about half-way at each"""


def replans(side: int, times: int) -> Table:
    """Compare a replan after one new 3 × 3 observation with a new field of the whole area.

    Every tenth time another area is drawn; its first field does not count.
    """
    made = table(
        f"{side}², vehicle half-way, one 3 × 3 observation: replanning against a fresh field",
        "who observes, where to, w",
        "fresh [ms]",
        "replan p50",
        "p99",
        "fresh / p50",
        "fresh / p99",
        "cells",
    )
    straight, aside, near = (side // 2, side - 1), (side * 3 // 10, side - 1), (side // 2 - 20, side - 1)
    for who, goal, seen, anywhere, w in (
        ("itself, straight across, 0.5", straight, 0.0, False, 0.5),
        ("itself, a third seen, 0.5", near, 0.33, False, 0.5),
        ("itself, a third seen, 0.9", near, 0.33, False, 0.9),
        ("itself, a third seen, 1", near, 0.33, False, 1.0),
        ("itself, goal well to one side, 0.5", aside, 0.0, False, 0.5),
        ("a peer anywhere, straight across, 0.5", straight, 0.0, True, 0.5),
        ("a peer anywhere, a third seen, 0.5", near, 0.33, True, 0.5),
    ):
        fresh, replan, searched = [], [], []
        for seed in range(times // TURNS):
            crossing = Crossing(side, goal, seen, seed)
            planner = Replanner(crossing.layers, [goal], w, PSI)
            route = planner.route(crossing.position)
            for turn in range(TURNS):
                if not anywhere:
                    crossing.position = route[1]
                while not (cells := crossing.observe(anywhere=anywhere)):
                    crossing.position = crossing.position if anywhere else route[1]
                    route = planner.route(crossing.position)

                def again() -> None:
                    nonlocal route
                    planner.changed(cells)  # noqa: B023
                    route = planner.route(crossing.position)  # noqa: B023

                replan.append(timed(again))
                searched.append(planner.searched_cells)
                if turn == 0:
                    exposure = crossing.layers.known + crossing.layers.p_unseen * crossing.layers.unseen
                    full: list[CostToGo] = []
                    fresh.append(timed(lambda: full.append(cost_to_go(exposure, [goal], w, PSI))))  # noqa: B023
                    assert full[0].cells_from(crossing.position) == route, "replanning is exact"
        f, p50, p99 = np.median(fresh), np.median(replan), np.quantile(replan, 0.99)
        made.add_row(
            who, f"{1e3 * f:.1f}", f"{1e3 * p50:.2f}", f"{1e3 * p99:.2f}", f"{f / p50:.1f}",
            f"{f / p99:.1f}", f"{int(np.median(searched))}",
        )  # fmt: skip
    return made


def swarm(side: int, count: int) -> Table:
    """Measure vehicles with one goal, which share one search."""
    made = table(f"{count} vehicles with one goal on {side}²", "", "[ms]", "ratio")
    exposure, goal = observed(side), (side // 2, side - 1)
    starts = [(int(row), 0) for row in np.linspace(0, side - 1, count)]

    def replan(of: list[tuple[int, int]]) -> None:
        cost_to_go(exposure, [goal], 0.5, PSI).paths_from(of)

    found = in_turns({"one": lambda: replan(starts[count // 3 :][:1]), "all": lambda: replan(starts)}, 41)
    for name, s in found.items():
        made.add_row(f"{name} replanned", f"{1e3 * s:.2f}", f"{s / found['one']:.2f}")
    return made


def bounded(side: int, n_fields: int) -> Table:
    """Measure the planners that keep a bound, in units of one search.

    A search is a field of the whole area in reused memory, at w = 0.5 or at the weights that the planner
    searched; weights nearer to 1 take longer.
    """
    made = table(
        f"{side}², a bound halfway along the front, {n_fields} fields each: time in searches",
        "planner, P_s",
        "made",
        "at w = 0.5: p50",
        "p90",
        "at its own w: p50",
        "p90",
        "proved exact",
    )
    planners = (("time_bound", time_bound), ("constrained", constrained))
    for kind, make in (("random", random_field), ("as observed", observed)):
        for name, planner in planners:
            made_n, by_half, by_own, exact = [], [], [], 0
            for seed in range(n_fields):
                problem = halfway(make(side, seed))
                route = planner.plan(problem, planner.Params())
                taken_s = min(timed(lambda: planner.plan(problem, planner.Params())) for _ in range(3))  # noqa: B023
                own_s = [search_s(problem, searched.w) for searched in route.searched]
                made_n.append(len(own_s))
                by_half.append(taken_s / search_s(problem, 0.5))
                by_own.append(taken_s / np.mean(own_s))
                exact += route.lower_bound is not None and route.cost <= route.lower_bound * (1 + 1e-9)
            made.add_row(
                f"{name}, {kind}",
                f"{np.median(made_n):.0f}",
                *(f"{np.quantile(of, q):.1f}" for of in (by_half, by_own) for q in (0.5, 0.9)),
                f"{exact} of {n_fields}" if name == "constrained" else "–",
            )
    return made


def search_s(problem: Problem, w: float) -> float:
    """Return the time of one field of the whole area [s]."""
    field = spread(problem.exposure, problem.goals, w, PSI)
    return min(timed(lambda: spread(problem.exposure, problem.goals, w, PSI, into=field)) for _ in range(3))


def halfway(exposure: Floats) -> Problem:
    """Return a crossing bounded by the mean of the shortest and the least exposed route's lengths."""
    side = exposure.shape[0]
    start, goals = (side // 2, 0), ((side // 3, side - 1),)
    lengths = []
    for w in (0.0, 1.0):
        cells = cost_to_go(exposure, goals, w, PSI).cells_from(start)
        steps = np.abs(np.diff(np.array(cells), axis=0)).sum(axis=1)
        lengths.append(float(np.sqrt(steps).sum()))
    return Problem(exposure, start, goals, 0.5, PSI, max_length_cells=sum(lengths) / 2)


def memory(side: int) -> Table:
    """Measure the memory of a field, and the growth after a thousand replans."""
    made = table("memory", "", "")
    process, exposure = psutil.Process(os.getpid()), observed(side)
    gc.collect()
    before = process.memory_info().rss
    field = cost_to_go(exposure, [(side // 2, side - 1)], 0.5, PSI)
    field.cells_from((side // 3, 0))
    held = process.memory_info().rss - before
    made.add_row(f"the field of {side}² and a route in it, bytes a cell", f"{held / side**2:.1f}")
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
    made.add_row("a thousand replans later, MB more", f"{held_mb[1] - held_mb[0]:+.1f}")
    return made


def echo(side: int, count: int) -> Table:
    """Measure whether other threads of the process run while a planner searches."""
    made = table(
        f"a Zenoh echo over TCP, {count} times", "beside it in the process", "p50 [ms]", "p99", "max"
    )
    exposure, goal = observed(side), (side // 2, side - 1)
    problem = Problem(exposure, (side // 2, 0), (goal,), 0.5, PSI)
    in_time = halfway(observed(200))
    for name, beside in (
        ("nothing", None),
        (f"the full field of {side}² without a pause", lambda: cost_to_go(exposure, [goal], 0.5, PSI)),
        (f"dijkstra on {side}² without a pause", lambda: plan(problem)),
        ("constrained on 200² without a pause", lambda: plan(in_time, "constrained")),
    ):
        p50, p99, top = 1e3 * np.quantile(round_trips_s(count, beside), (0.5, 0.99, 1.0))
        made.add_row(name, f"{p50:.2f}", f"{p99:.2f}", f"{top:.2f}")
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--quick", action="store_true", help="leave out the largest area, and most repetitions"
    )
    parser.add_argument(
        "--memory", action="store_true", help="only the memory, of a process that did nothing else"
    )
    asked = parser.parse_args()
    quick: bool = asked.quick
    warm_up()
    if asked.memory:
        console.print(memory(1000))
        return
    for made in full_fields((100, 300, 1000) if quick else (100, 300, 1000, 2000)):
        console.print(made)
    console.print(hard_fields(1000))
    console.print(replans(1000, 100 if quick else 1000))
    console.print(swarm(200, 50))
    console.print(bounded(200, 10 if quick else 50))
    subprocess.run([sys.executable, __file__, "--memory"], check=True)
    console.print(echo(1000, 500 if quick else 3000))


if __name__ == "__main__":
    main()
