"""Costs of flights on the virtual clock, and latencies from an observation to a changed mission.

The flights have 5, 20, 50 and 100 vehicles. Each flight runs in a process of its own, with the compiled
kernels loaded. Costs are processor time of the whole flight, with simulator and record, because wall time
depends on the other programs of this machine. The last column shows the growth: processor time of one
vehicle in one simulated second.
"""

from __future__ import annotations

import argparse
import asyncio
import resource
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console
from rich.table import Table
from tables import make_table

from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.scenario import Scenario, build
from swarmctl.flight import app
from swarmctl.flight.gc_tuning import tune_collector
from swarmctl.flight.run import Clock
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.planners import warm_up
from swarmctl.report.outcome import FlightReport
from swarmctl.report.ui import SilentUi

SHIPPED = Path(__file__).parent.parent / "configs" / "swarm.yaml"


@dataclass(frozen=True)
class MeasuredFlight:
    """A flight with its report and costs."""

    count: int
    report: FlightReport
    wall_s: float
    cpu_s: float


def make_scenario(count: int) -> Scenario:
    """Return the shipped configuration with another number of vehicles."""
    config = load(SHIPPED, check_config)
    assert config.simulate is not None
    simulate = config.simulate.model_copy(update={"count": count})
    # With a step of 5 m, the highest of a hundred vehicles would fly at about 500 m.
    step_m = min(5.0, 100.0 / count)
    flight = config.flight.model_copy(update={"altitude_step_m": step_m})
    separation = config.separation.model_copy(update={"vertical_m": min(3.0, 0.8 * step_m)})
    return build(config.model_copy(update={"simulate": simulate, "flight": flight, "separation": separation}))


def fly(count: int, clock: Clock) -> MeasuredFlight:
    """Fly the shipped configuration with `count` vehicles."""
    began_s, cpu_s = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        flight = app.fly(
            make_scenario(count), Path(folder), SilentUi(), clock=clock, permission=lambda foreign: None
        )
        report = run_virtual(flight) if clock == "virtual" else asyncio.run(flight)
    return MeasuredFlight(count, report, time.perf_counter() - began_s, time.process_time() - cpu_s)


def virtual_row(count: int) -> list[str]:
    """Fly `count` vehicles on the virtual clock, prepared as `swarmctl fly` does; return the row."""
    warm_up()
    tune_collector()
    flight = fly(count, "virtual")
    flown_s = flight.report.statistics.longest_flight_s
    return [
        str(count),
        str(flight.report.summary["arrived"]),
        f"{flown_s:.0f}",
        f"{flight.cpu_s:.1f}",
        f"{flight.wall_s:.1f}",
        f"{flown_s / flight.cpu_s:.1f}",
        f"{1e3 * flight.cpu_s / (count * flown_s):.2f}",
    ]


def virtual_flights(counts: Sequence[int]) -> Table:
    """Measure the costs of whole flights, with simulator and record."""
    table = make_table(
        "The shipped configuration on the virtual clock",
        *("vehicles", "arrived", "simulated time [s]", "CPU [s]", "wall time [s]"),
        *("simulated time / CPU", "CPU of a vehicle in 1 s [ms]"),
    )
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as processes:
        for row in processes.map(virtual_row, counts):
            table.add_row(*row)
    return table


def latencies() -> Table:
    """Measure latencies in a flight of 5 vehicles in real time, with UDP and Zenoh."""
    flight = fly(5, "real")
    table = make_table(
        "5 vehicles at 10 times speed over UDP and Zenoh: latencies in wall time",
        *("from an observation to", "n", "p50 [ms]", "p99 [ms]", "max [ms]"),
        left=["from an observation to"],
    )
    for name, quantiles in flight.report.summary["latency"].items():
        event = name.removeprefix("observation_to_").removesuffix("_s").replace("_", " ")
        row = [f"{1e3 * quantiles[q]:.1f}" for q in ("p50", "p99", "max")]
        table.add_row(event, str(quantiles["n"]), *row)
    cpu_percent = 100.0 * flight.cpu_s / flight.wall_s
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    table.caption = (
        f"ground station: {cpu_percent:.0f} % of a core; memory of this process: {memory_mb:.0f} MB at most"
    )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="5 vehicles only, less than a minute")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[5, 20, 50, 100], metavar="N")
    parser.add_argument("--only", choices=("virtual", "latencies"), help="only one of the two tables")
    options = parser.parse_args()
    console = Console(width=130)
    warm_up()
    if options.only != "latencies":
        console.print(virtual_flights([5] if options.quick else options.vehicles))
    if options.only != "virtual":
        console.print(latencies())


if __name__ == "__main__":
    main()
