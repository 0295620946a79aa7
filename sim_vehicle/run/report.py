"""What a run leaves: a tlog a vehicle and verdict.json, and the tables for a terminal."""

import contextlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim_vehicle.run.runner import VehicleEnd, Verdict
from sim_vehicle.run.station import Heard
from sim_vehicle.scenario.model import VehicleSpec
from sim_vehicle.serving.tlog import Tlog

SHOWN_FAILURES, SHOWN_VEHICLES = 3, 40
WIDE = 110  # columns of a terminal that has room for texts


@contextlib.contextmanager
def tlogs(folder: Path, vehicles: Sequence[VehicleSpec]) -> Iterator[Heard]:
    """Open a tlog for each vehicle; yields what writes into them."""
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as files:
        logs = [Tlog(files.enter_context(_open(folder, spec))) for spec in vehicles]

        def heard(index: int, frame: bytes, now: float) -> None:
            logs[index].write(frame, now)

        yield heard


def _open(folder: Path, spec: VehicleSpec) -> BinaryIO:
    link = f"link-{spec.link}-" if spec.link else ""
    return (folder / f"{link}vehicle-{spec.sysid}.tlog").open("wb")


def write_verdict(folder: Path, verdict: Verdict) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(verdict.as_dict(), indent=1, allow_nan=False)
    (folder / "verdict.json").write_text(text + "\n", encoding="utf-8")


def show(console: Console, verdict: Verdict) -> None:
    """The checks, the steps that failed, and how each vehicle ended."""
    checks = Table(title=f"{verdict.scenario}, seed {verdict.seed}", title_justify="left", box=SIMPLE)
    for heading in ("check", "verdict", "failed by"):
        checks.add_column(heading)
    for check in verdict.checks:
        found = [f"vehicle {f.sysid} at {f.t_s:.2f} s: {f.found}" for f in check.failures[:SHOWN_FAILURES]]
        more = len(check.failures) - len(found)
        text = "\n".join([*found, *([f"and {more} more"] if more else [])])
        checks.add_row(check.check, "[green]passed" if check.passed else "[red]FAILED", text)
    for failed in verdict.steps_failed:
        text = f"vehicle {failed.sysid} at {failed.t_s:.2f} s: {failed.text}"
        checks.add_row(f"step {failed.index + 1}: {failed.action}", "[red]FAILED", text)
    console.print(checks)
    _show_vehicles(console, verdict.vehicles)


def _show_vehicles(console: Console, vehicles: Sequence[VehicleEnd]) -> None:
    with_text = console.width >= WIDE
    table = Table(box=SIMPLE, collapse_padding=True, pad_edge=False)
    for heading in ("id", "autopilot", "mode", "armed"):
        table.add_column(heading, no_wrap=True)
    for heading in ("up [m]", "off [m]", "flown [m]", "charge", "strikes"):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    if with_text:
        table.add_column("last text", no_wrap=True)
    for v in vehicles[:SHOWN_VEHICLES]:
        numbers = (
            f"{v.height_m:.1f}",
            f"{v.from_start_m:.1f}",
            f"{v.flown_m:.0f}",
            f"{v.battery_remaining:.0%}",
        )
        table.add_row(
            f"{v.sysid}" if not v.link else f"{v.link}:{v.sysid}",
            f"{v.personality} {v.kind}",
            v.mode,
            "yes" if v.armed else "no",
            *numbers,
            str(v.strikes),
            *([v.last_text] if with_text else []),
        )
    console.print(table)
    if len(vehicles) > SHOWN_VEHICLES:
        console.print(f"and {len(vehicles) - SHOWN_VEHICLES} more vehicles, in verdict.json")
