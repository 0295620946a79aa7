"""Wall times of flights on the virtual clock, and latencies from an observation to a changed mission.

The flights have 5, 20, 50 and 100 vehicles. Wall times are of this machine at this moment. The last column is
the wall time of a vehicle, as a ratio to the flight of 5 vehicles in the same run.
"""

from __future__ import annotations

import argparse
import asyncio
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from tables import make_table

from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.scenario import Scenario, build
from swarmctl.flight import app
from swarmctl.flight.run import Clock
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.planners import warm_up
from swarmctl.report.live_rows import SwarmView
from swarmctl.report.outcome import FlightReport

SHIPPED = Path(__file__).parent.parent / "configs" / "swarm.yaml"


class Quiet:
    """A user interface that shows nothing."""

    def say(self, text: str) -> None: ...

    def log(self, text: str) -> None: ...

    def refresh(self, picture: SwarmView) -> None: ...


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
            make_scenario(count), Path(folder), Quiet(), clock=clock, permission=lambda foreign: None
        )
        report = run_virtual(flight) if clock == "virtual" else asyncio.run(flight)
    return MeasuredFlight(count, report, time.perf_counter() - began_s, time.process_time() - cpu_s)


def virtual_flights(counts: tuple[int, ...]) -> Table:
    """Measure the wall time of whole flights, with simulator and record."""
    table = make_table(
        "The shipped configuration on the virtual clock",
        *("vehicles", "arrived", "simulated time [s]", "wall time [s]", "times real time"),
        "wall time of a vehicle, ratio",
    )
    first_s: float | None = None
    for count in counts:
        flight = fly(count, "virtual")
        vehicle_s = flight.wall_s / count
        first_s = first_s or vehicle_s
        flown_s = flight.report.statistics.longest_flight_s
        table.add_row(
            str(count),
            str(flight.report.summary["arrived"]),
            f"{flown_s:.0f}",
            f"{flight.wall_s:.2f}",
            f"{flown_s / flight.wall_s:.0f}",
            f"{vehicle_s / first_s:.2f}",
        )
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
    options = parser.parse_args()
    console = Console(width=130)
    warm_up()
    console.print(virtual_flights((5,) if options.quick else (5, 20, 50, 100)))
    console.print(latencies())


if __name__ == "__main__":
    main()
