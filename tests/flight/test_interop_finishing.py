"""Ctrl-C after the landing: the program still writes the files of the run."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from swarmctl_process import run

from swarmctl.cli.flights import LATE_INTERRUPT

pytestmark = [pytest.mark.interop, pytest.mark.full]

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 4, cols: 4, cell_size_m: 50}
threats: {count: 1}
simulate: {count: 1, speedup: 20, ready_s: 0}
flight: {altitude_m: 10}
"""
INTERRUPTED_WHERE = """\
import os, signal
from swarmctl.ROOM import MODULE
from swarmctl.cli.entry import main

before = MODULE.NAME
def interrupted(*args, **more):
    for _ in range(TIMES):
        os.kill(os.getpid(), signal.NUMBER)
    return before(*args, **more)
MODULE.NAME = interrupted
main()
"""
AGENT = ["agent", "--uav", "uav1", "--launch", "when-ready"]


def flown(
    words: list[str], folder: Path, where: str, number: str, times: int
) -> subprocess.CompletedProcess[str]:
    """Run a whole flight whose process gets signals at a place after the landing."""
    (folder / "small.yaml").write_text(SMALL)
    room, module, name = where.rsplit(".", 2)
    code = INTERRUPTED_WHERE.replace("ROOM", room).replace("MODULE", module).replace("NAME", name)
    code = code.replace("NUMBER", number).replace("TIMES", str(times))
    return run(*words, "--config", "small.yaml", cwd=folder, program=code)


@pytest.mark.parametrize(
    ("words", "where", "number"),
    [
        (AGENT, "flight.app.summary", "SIGINT"),
        (AGENT, "report.outputs.write_run", "SIGINT"),
        (AGENT, "report.pictures.sheet.draw_map", "SIGTERM"),
        (["fly"], "report.outputs.write_run", "SIGINT"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else value,
)
def test_a_signal_after_the_landing_does_not_cost_the_summary(
    words: list[str], where: str, number: str, tmp_path: Path
) -> None:
    done = flown(words, tmp_path, where, number, 1)
    assert done.returncode == 0, done.stdout + done.stderr
    assert LATE_INTERRUPT.decode() in done.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert json.loads((folder / "summary.json").read_text())["arrived"] == 1
    assert (folder / "map.png").exists()


def test_two_signals_after_the_landing_leave_at_once(tmp_path: Path) -> None:
    assert flown(AGENT, tmp_path, "report.outputs.write_run", "SIGINT", 2).returncode == 130
