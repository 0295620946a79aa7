"""`--resume`: go on with a run whose program died in flight."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli import machine_code
from swarmctl.cli.console import FAILED, USAGE, err, fail
from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.report import unfinished_run
from swarmctl.report.record_file import RecordError
from swarmctl.report.unfinished_run import UnfinishedRun, UnfinishedRunError

LAST = "last"
ResumeOption = Annotated[
    str | None,
    typer.Option(
        "--resume",
        metavar="RUN",
        help="Take over the vehicles of a run whose program died in flight: its folder, or `last`, the "
        "newest run of this swarm or vehicle in the folder of --out.",
        show_default=False,
    ),
]


def run_or_exit(given: str, runs: Path, name: str) -> Path:
    """Return the folder of the run; exit if `last` is given and `runs` has none of this name (empty: any)."""
    if given != LAST:
        return Path(given)
    if (found := unfinished_run.last_run(runs, name)) is None:
        fail([f"--resume last: {runs} has no run{f' of {name}' if name else ''} [no-run]"], USAGE)
    return found


def load_or_exit(run: Path, given: Scenario | None = None) -> tuple[Scenario, UnfinishedRun]:
    """Return the scenario and the content of an unfinished run; exit with the reason if there is none.

    `given` is the scenario of --config, which must be that of the run; None: the recorded configuration.
    """
    try:
        return unfinished_run.load(run, lambda recorded: _scenario(run, recorded, given), _epoch_ns())
    except UnfinishedRunError as error:
        fail([f"--resume {error}"], FAILED)
    except RecordError as error:
        fail([f"--resume {error}"], USAGE)


def _scenario(run: Path, recorded: Config, given: Scenario | None) -> Scenario:
    machine_code.prepare(recorded, err)
    scenario = build(recorded) if given is None else given
    if differing := unfinished_run.differing_sections(recorded, scenario.config):
        raise UnfinishedRunError(
            f"{run}: flown with another configuration; it differs in: {', '.join(differing)}. Give the "
            "configuration of the run, or for `fly` no --config [other-configuration]"
        )
    if all(spec.simulated for spec in scenario.specs):
        raise UnfinishedRunError(
            f"{run}: the vehicles were simulated by the program itself and ended with it; start a new flight "
            "[simulated-ended]"
        )
    return scenario


def _epoch_ns() -> int:
    """Return the wall time at time 0 of the clock that a flight in real time has."""
    return time.time_ns() - time.monotonic_ns()
