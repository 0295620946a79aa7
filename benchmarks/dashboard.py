"""Costs of the dashboard's model: pictures and their changes of a large swarm, and reading of a record.

The swarm is made up: each vehicle tells its state and its intent each second, moves, and observes cells that
all others receive. CPU time is that of the model and of the encoded changes for one browser; the process has
one core. `--run` reads a recorded run instead, and looks at random times. `--browsers 5` flies the first
example without and with a dashboard and five pages of Chromium, and compares CPU times and latencies.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import msgspec
from rich.console import Console
from tables import describe_load, make_table

from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.frames import IntentPoint, IntentShared, StateShared
from swarmctl.core.observation import Observation
from swarmctl.core.vehicle import VehicleState
from swarmctl.dashboard.changes import changes
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.sources.recording import RecordSource

LATENCIES = ("observation_to_last_peers_belief_s", "observation_to_last_changed_mission_s")
PICTURES_A_SECOND = 10
TELEMETRY_A_SECOND = 4
CELLS_AN_OBSERVATION = 3
OBSERVATIONS_A_SECOND = 0.25
"""of one vehicle: 5 m/s over cells of 20 m"""


def swarm(vehicles: int, cells: int) -> Scenario:
    content = {
        "name": "bench",
        "area": {
            "origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": cells, "cols": cells, "cell_size_m": 20.0,
        },
        "threats": {"count": cells * cells // 20},
        "communication": {"bus": "memory"},
        "simulate": {"count": vehicles},
    }  # fmt: skip
    return build(Config.model_validate_json(json.dumps(content)))


class MadeUpSwarm:
    """Vehicles that cross the area and tell what they see."""

    def __init__(self, scenario: Scenario, timeline: Timeline) -> None:
        self.grid, self.timeline, self.rng = scenario.grid, timeline, random.Random(1)
        self.uavs = list(timeline.vehicles)
        self.seq = dict.fromkeys(self.uavs, 0)

    def second(self, now_s: float) -> None:
        """Fold one second of all vehicles."""
        for part in range(TELEMETRY_A_SECOND):
            at_s = now_s + part / TELEMETRY_A_SECOND
            for uav in self.uavs:
                self.timeline.telemetry(uav, at_s, self._telemetry(uav, at_s))
        for uav in self.uavs:
            state = self._telemetry(uav, now_s + 0.9)
            assert state.lat_lon is not None
            lat_deg, lon_deg = state.lat_lon
            shared = StateShared(
                now_s, lat_deg, lon_deg, 40.0, 340.0, "flying", 0, 0, hears=tuple(self.uavs[:8])
            )
            self.timeline.shared(uav, now_s + 0.9, shared, has_telemetry=True)
            points = [
                IntentPoint(float(t), *self._place(uav, now_s + t), 340.0 + uav) for t in range(0, 200, 10)
            ]
            self.timeline.intent(uav, now_s + 0.9, IntentShared(1, tuple(points)), is_route=True)
            for other in self.uavs:
                self.timeline.heard(other, uav, now_s + 0.9, is_intent=True)
            if self.rng.random() < OBSERVATIONS_A_SECOND:
                self._observe(uav, now_s + 0.9)

    def _place(self, uav: int, now_s: float) -> tuple[float, float]:
        east_m = (5.0 * now_s) % (self.grid.size_east_m - 1.0)
        north_m = (uav - 0.5) / len(self.uavs) * self.grid.size_north_m
        return self.grid.frame.to_geodetic(east_m, north_m)

    def _telemetry(self, uav: int, now_s: float) -> VehicleState:
        lat_deg, lon_deg = self._place(uav, now_s)
        return VehicleState(
            now_s, lat_deg, lon_deg, 40.0 + math.sin(now_s + uav), 340.0, 5.0, 5.0, mode="AUTO", armed=True,
            battery_percent=90,
        )  # fmt: skip

    def _observe(self, uav: int, now_s: float) -> None:
        self.seq[uav] += 1
        lat_deg, lon_deg = self._place(uav, now_s)
        cell = self.grid.cell_at(lat_deg, lon_deg) or (0, 0)
        rows = [min(max(cell[0] + d, 0), self.grid.rows - 1) for d in (-1, 0, 1)]
        cells = tuple((row, cell[1], self.rng.random() < 0.05) for row in dict.fromkeys(rows))
        seen = Observation(uav, self.seq[uav], now_s, cells)
        for other in self.uavs:
            self.timeline.learned(other, now_s, (seen,))


def live(console: Console, vehicles: int, cells: int, seconds: int) -> None:
    scenario = swarm(vehicles, cells)
    timeline = Timeline(scenario, "live file")
    made_up = MadeUpSwarm(scenario, timeline)
    before, n_bytes, fold_s, picture_s = None, 0, 0.0, 0.0
    encode = msgspec.json.Encoder().encode
    for second in range(seconds):
        start = time.process_time()
        made_up.second(float(second))
        fold_s += time.process_time() - start
        start = time.process_time()
        for part in range(PICTURES_A_SECOND):
            picture = timeline.at(second + part / PICTURES_A_SECOND)
            n_bytes += len(encode(changes(before, picture)))
            before = picture
        picture_s += time.process_time() - start
    table = make_table(
        f"{vehicles} vehicles, {cells} × {cells} cells, {PICTURES_A_SECOND} changes a second, {seconds} s",
        "fold [% of a core]", "pictures and changes [% of a core]", "a browser [kB/s]",
    )  # fmt: skip
    table.add_row(
        f"{100.0 * fold_s / seconds:.1f}",
        f"{100.0 * picture_s / seconds:.1f}",
        f"{n_bytes / seconds / 1e3:.0f}",
    )
    console.print(table)


def replayed(console: Console, run: Path) -> None:
    start = time.perf_counter()
    source = RecordSource(run, "recording")
    source.read()
    first = time.perf_counter() - start
    while source.read(1.0):
        pass
    whole, timeline = time.perf_counter() - start, source.timeline
    rng, took = random.Random(1), []
    for _ in range(200):
        start = time.perf_counter()
        timeline.at(rng.uniform(0.0, timeline.end_s))
        took.append(time.perf_counter() - start)
    took.sort()
    table = make_table(
        f"{len(timeline.vehicles)} vehicles for {timeline.end_s:.0f} s",
        "first picture [s]", "whole record [s]", "a seek, median [ms]", "a seek, worst [ms]",
    )  # fmt: skip
    table.add_row(f"{first:.2f}", f"{whole:.2f}", f"{1e3 * took[100]:.1f}", f"{1e3 * took[-1]:.1f}")
    console.print(table)
    source.close()


def flown(console: Console, n_pages: int) -> None:
    """Fly the first example without the dashboard, and with `n_pages` open pages of it."""
    table = make_table(
        "the first example in real time",
        "pages", "flight [s of CPU]", "dashboard [s of CPU]", "observation to last belief, p50, p99 [s]",
        "observation to last mission, p50, p99 [s]",
    )  # fmt: skip
    for pages in (0, n_pages):
        with tempfile.TemporaryDirectory() as folder:
            flight_s, dashboard_s, latency = _one_flight(Path(folder), pages)
        ages = [f"{latency[name]['p50']:.2f}, {latency[name]['p99']:.2f}" for name in LATENCIES]
        table.add_row(str(pages), f"{flight_s:.1f}", f"{dashboard_s:.1f}", *ages)
    console.print(table)


def _one_flight(folder: Path, pages: int) -> tuple[float, float, dict[str, dict[str, float]]]:
    """Return the CPU times of the flight and of its dashboard [s], and the latencies of its summary."""
    command = [
        sys.executable,
        "-m",
        "swarmctl",
        "fly",
        "--example",
        "swarm",
        *["--dashboard"][: min(pages, 1)],
    ]
    flight_s = dashboard_s = 0.0
    with ExitStack() as stack:
        flight = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        stack.callback(flight.kill)
        assert flight.stdout is not None
        for line in flight.stdout if pages else ():
            if address := re.search(r"http://\S+", line):
                _open_pages(stack, address[0], pages)
                break
        summary: list[Path] = []
        while not summary:
            flight_s = _cpu_s(flight.pid) or flight_s
            children = Path(f"/proc/{flight.pid}/task/{flight.pid}/children")
            for child in children.read_text().split() if pages and children.exists() else ():
                if "dashboard" in Path(f"/proc/{child}/cmdline").read_text():
                    dashboard_s = _cpu_s(int(child))
            time.sleep(0.5)
            summary = list(folder.glob("runs/*/summary.json"))
        return flight_s, dashboard_s, json.loads(summary[0].read_text())["latency"]


def _open_pages(stack: ExitStack, address: str, pages: int) -> None:
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    driver = stack.enter_context(sync_playwright())
    context = driver.chromium.launch(
        executable_path=shutil.which("chromium"), args=["--no-sandbox"]
    ).new_context()
    for i in range(pages):
        context.new_page().goto(address if i == 0 else address.partition("?")[0], timeout=120_000)


def _cpu_s(pid: int) -> float:
    """Return the CPU time of a process without its children [s]; 0 for one that has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, help="a run folder, or its run.mcap")
    parser.add_argument("--browsers", type=int, metavar="N", help="fly with N open pages, and without")
    parser.add_argument("--quick", action="store_true", help="a shorter case")
    arguments = parser.parse_args()
    console = Console()
    if arguments.run is not None:
        replayed(console, arguments.run)
    elif arguments.browsers:
        flown(console, arguments.browsers)
    else:
        live(console, 50, 100, 20 if arguments.quick else 120)
    console.print(describe_load())


if __name__ == "__main__":
    main()
