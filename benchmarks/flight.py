"""Wall time of virtual flights of 5, 20 and 100 vehicles, and the latency from observation to mission.

Run: `python benchmarks/flight.py`. Wall times are of this machine at this moment. The last column is the
time per vehicle as a ratio to the flight of 5 vehicles in the same run.
"""

from __future__ import annotations

import asyncio
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.scenario import Scenario, build
from swarmctl.flight import app
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.flight.wiring import Clock
from swarmctl.planners import warm_up
from swarmctl.report.live_rows import SwarmView
from swarmctl.report.outcome import FlightReport

SHIPPED = Path(__file__).parent.parent / "configs" / "swarm.yaml"


class Quiet:
    def say(self, text: str) -> None: ...

    def log(self, text: str) -> None: ...

    def refresh(self, picture: SwarmView) -> None: ...


@dataclass(frozen=True)
class Flight:
    count: int
    report: FlightReport
    wall_s: float
    cpu_s: float


def scenario(count: int) -> Scenario:
    """Return the shipped configuration with another number of vehicles."""
    config = load(SHIPPED, check_config)
    assert config.simulate is not None
    simulate = config.simulate.model_copy(update={"count": count})
    # A step of 5 m would take a hundred vehicles into the flight levels.
    step_m = min(5.0, 100.0 / count)
    flight = config.flight.model_copy(update={"altitude_step_m": step_m})
    separation = config.separation.model_copy(update={"vertical_m": min(3.0, 0.8 * step_m)})
    return build(config.model_copy(update={"simulate": simulate, "flight": flight, "separation": separation}))


def fly(count: int, clock: Clock) -> Flight:
    began_s, cpu_s = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        flight = app.fly(scenario(count), Path(folder), Quiet(), clock=clock, permission=lambda foreign: None)
        report = run_virtual(flight) if clock == "virtual" else asyncio.run(flight)
    return Flight(count, report, time.perf_counter() - began_s, time.process_time() - cpu_s)


def virtual_flights(counts: tuple[int, ...]) -> Table:
    table = Table(title="the shipped configuration on the virtual clock", box=box.SIMPLE_HEAD)
    for title in ("vehicles", "arrived", "flown [s]", "wall [s]", "times real time", "wall a vehicle, ratio"):
        table.add_column(title, justify="right")
    base: float | None = None
    for count in counts:
        flight = fly(count, "virtual")
        a_vehicle = flight.wall_s / count
        base = base or a_vehicle
        flown_s = flight.report.statistics.longest_flight_s
        table.add_row(
            str(count),
            str(flight.report.summary["arrived"]),
            f"{flown_s:.0f}",
            f"{flight.wall_s:.2f}",
            f"{flown_s / flight.wall_s:.0f}",
            f"{a_vehicle / base:.2f}",
        )
    return table


def latency() -> Table:
    flight = fly(5, "real")
    table = Table(title="5 vehicles, 10 times real time, UDP and Zenoh: wall time", box=box.SIMPLE_HEAD)
    table.add_column("from an observation to")
    for title in ("n", "p50 [ms]", "p99 [ms]", "max [ms]"):
        table.add_column(title, justify="right")
    for name, found in flight.report.summary["latency"].items():
        what = name.removeprefix("observation_to_").removesuffix("_s").replace("_", " ")
        row = [f"{1e3 * found[q]:.1f}" for q in ("p50", "p99", "max")]
        table.add_row(what, str(found["n"]), *row)
    share = 100.0 * flight.cpu_s / flight.wall_s
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    table.caption = (
        f"ground station: {share:.0f} % of a core, at most {memory_mb:.0f} MB in this process so far"
    )
    return table


if __name__ == "__main__":
    console = Console()
    warm_up()
    console.print(virtual_flights((5, 20, 100)))
    console.print(latency())
