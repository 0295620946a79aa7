"""Missions a second and core of the abstract mission, and what a mission costs by part.

Times are CPU time of this process on this machine at this moment. The plain and the compiled mission fly the
same worlds alternately, so that noise affects both.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from tables import describe_load, make_table

from swarmctl.config.model import load
from swarmctl.config.scenario import Scenario, build
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.descent import descend
from swarmctl.planners.kernels.lattice import ROOT2
from swarmctl.study import kernel_layout as k
from swarmctl.study import replan_kernels
from swarmctl.study.compiled_mission import CompiledMission
from swarmctl.study.kinds import KINDS
from swarmctl.study.mission import fly_mission
from swarmctl.study.world import World

REPEATS = 2000
MISSIONS = KINDS["missions"]
PLAIN_PARTS = {
    "choose_route": "search and decision",
    "believed_exposure": "belief to exposure (Eq. 3 and 4)",
    "_learn": "merging observations",
    "_send": "sending",
    "strikes": "strikes",
    "measured": "measures of the vehicles",
}


def cpu_s(run: Callable[[], object]) -> float:
    began_s = time.process_time()
    run()
    return time.process_time() - began_s


def rates(scenario: Scenario, n_worlds: int) -> Table:
    """Compare whole missions: columns included for the compiled loop, as a study computes them."""
    table = make_table("Missions a second and core", "mission", "missions/s", "ratio", left=["mission"])
    plain_s = compiled_s = 0.0
    for seed in range(n_worlds):
        world = World.drawn(scenario, seed)
        plain_s += cpu_s(lambda world=world: fly_mission(scenario, world))  # type: ignore[misc]
        seeds = range(10 * seed, 10 * seed + 10)
        compiled_s += cpu_s(lambda seeds=seeds: MISSIONS.table(scenario, seeds)) / 10  # type: ignore[misc]
    table.add_row("plain", f"{n_worlds / plain_s:.1f}", "1")
    table.add_row("compiled", f"{n_worlds / compiled_s:.0f}", f"{plain_s / compiled_s:.0f}")
    return table


def compiled_parts(scenario: Scenario, n_worlds: int) -> Table:
    """Show the CPU time of the compiled mission by part."""
    loop = CompiledMission(scenario)
    worlds = [World.drawn(scenario, seed) for seed in range(n_worlds)]
    results = [loop.fly(world) for world in worlds]
    whole_s = cpu_s(lambda: MISSIONS.table(scenario, range(n_worlds))) / n_worlds
    fly_s = cpu_s(lambda: [loop.fly(world) for world in worlds]) / n_worlds
    vehicles, _ = loop.flown_once(worlds[-1])
    result_s = cpu_s(lambda: [loop.result(worlds[-1], vehicles) for _ in worlds]) / n_worlds
    world_s = cpu_s(lambda: [World.drawn(scenario, seed) for seed in range(n_worlds)]) / n_worlds
    searches = float(np.mean([sum(row.searches for row in result.rows) for result in results]))
    sent = float(np.mean([sum(row.messages_sent for row in result.rows) for result in results]))
    title = f"The compiled mission by part ({searches:.0f} searches, {sent:.0f} messages)"
    table = make_table(title, "part", "ms a mission", "share", left=["part"])
    parts = {
        "drawing the world": world_s,
        "compiled loop": fly_s - result_s,
        "measures of the vehicles": result_s,
        "columns, and arrays of the level": whole_s - fly_s - world_s,
        "whole": whole_s,
    }
    for part, seconds in parts.items():
        table.add_row(part, f"{1e3 * seconds:.3f}", f"{seconds / whole_s:.0%}")
    return table


def nothing(*arguments: object) -> None:
    """Do nothing; a call takes the time of handing over the arguments."""


def kernel_times(scenario: Scenario) -> Table:
    """Show the times of the steps of one replanning, without a call's overhead, at three places."""
    loop = CompiledMission(scenario)
    world = World.drawn(scenario, 3)
    (vehicles, _), area, settings, search = (
        loop.flown_once(world),
        loop.area_of(world),
        loop.settings,
        loop.search,
    )
    width, cols, step = area.width, area.width - 2, settings.step
    n_unseen = scenario.grid.n_cells - vehicles.ints[0, k.KNOWN]
    n_hidden = settings.n_hostiles - vehicles.ints[0, k.FOUND]
    believed = (vehicles.known[0], n_unseen, n_hidden, area, search)
    goals = vehicles.goals[:1]

    def call_us(kernel: Callable[..., object], *arguments: object) -> float:
        machine_code = compiled(kernel)
        machine_code(*arguments)
        return 1e6 * cpu_s(lambda: [machine_code(*arguments) for _ in range(REPEATS)]) / REPEATS

    table = make_table("One replanning by part [µs]", "part", "west edge", "middle", "east", left=["part"])
    rows: dict[str, list[float]] = {}
    for col in (0, cols // 2, cols - 4):
        start = (scenario.grid.rows // 2 + 1) * width + col + 1
        least = compiled(replan_kernels.believed_exposure)(*believed)
        bound = (start, width, step, settings.w * least, search.rest)
        searched = (start, np.inf, goals, False, settings, area, search)
        field = search.label, step, step * (ROOT2 - 1.0), search.straight, False, width
        way = (*field, goals, start, np.empty(0))
        for part, kernel, arguments in (
            ("exposure (Eq. 3 and 4)", replan_kernels.believed_exposure, believed),
            ("edge costs (Eq. 5)", replan_kernels.write_straight, (settings, search)),
            ("bound of the search", replan_kernels.write_rest, bound),
            ("search", replan_kernels.spread_to, searched),
            ("route down the field", descend, way),
        ):
            rows.setdefault(part, []).append(call_us(kernel, *arguments) - call_us(nothing, *arguments))
    for part, times_us in rows.items():
        table.add_row(part, *(f"{time_us:.1f}" for time_us in times_us))
    return table


def plain_parts(scenario: Scenario, seeds: Sequence[int]) -> Table:
    """Show the shares of the plain mission; a profile, so parts with many calls look larger than they are."""
    profile = cProfile.Profile(time.process_time)
    for seed in seeds:
        profile.runcall(fly_mission, scenario, World.drawn(scenario, seed))
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    whole_s = next(row[3] for (_, _, name), row in stats.items() if name == "fly_mission")
    table = make_table("The plain mission by part", "part", "share", left=["part"])
    for function, part in PLAIN_PARTS.items():
        seconds = sum(
            row[3] for (file, _, name), row in stats.items() if name == function and "swarmctl" in file
        )
        table.add_row(part, f"{seconds / whole_s:.0%}")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", type=Path, default=Path("configs/swarm.yaml"))
    parser.add_argument("--worlds", type=int, default=30)
    options = parser.parse_args()
    scenario = build(load(options.config))
    console = Console(width=110)
    MISSIONS.table(scenario, [0])  # compiles
    console.print(describe_load())
    console.print(rates(scenario, options.worlds))
    console.print(compiled_parts(scenario, 10 * options.worlds))
    console.print(kernel_times(scenario))
    console.print(plain_parts(scenario, range(options.worlds)))


if __name__ == "__main__":
    main()
