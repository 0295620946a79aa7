"""`swarmctl study`: experiments of many missions, cell by cell, or of whole flights."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from swarmctl.cli.console import FAILED, INTERRUPTED, STYLE, USAGE, err, fail, say

if TYPE_CHECKING:
    from swarmctl.study.cluster import Workers
    from swarmctl.study.experiment import Experiment

EXTRA = "mavlink-swarmctl[study]"
PACKAGES = ("distributed", "pandas", "pyarrow")
STARTING = "starting; the first study on a machine compiles for some 20 s"
"""text beside the progress bar until the first batch"""

app = typer.Typer(name="study", add_completion=False, **STYLE)


@app.callback(invoke_without_command=True)
def study(
    context: typer.Context,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            help="Experiment (YAML), such as configs/studies/communication.yaml.",
            show_default=False,
        ),
    ] = None,
    out_folder: Annotated[Path, typer.Option("--out", help="Parent folder of the results folder.")] = Path(
        "studies"
    ),
    worlds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of worlds at each level, instead of the experiment's. A later command with more "
            "worlds adds the missing ones.",
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help="Number of worker processes. Default: one for each core.", show_default=False
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Dask scheduler whose workers compute, such as tcp://10.0.0.5:8786.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Fly an experiment of many missions, and draw its figures with intervals."""
    if context.invoked_subcommand is not None:
        return
    if config is None:
        fail(["give --config FILE, such as --config configs/studies/communication.yaml"], USAGE)
    if workers is not None and scheduler is not None:
        fail(["--workers are processes of this machine; leave it out with --scheduler"], USAGE)
    _require_packages()
    experiment = _load_or_exit(config, worlds)
    folder = out_folder / config.stem
    say(_describe(experiment))
    _run(experiment, folder, workers or len(os.sched_getaffinity(0)), scheduler)
    _report(folder)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Results folder of a study.")],
) -> None:
    """Draw the figures and the report of a results folder again, without computing missions."""
    _require_packages()
    if not (folder / "results.parquet").is_file():
        text = f"{folder} has no results.parquet"
        fail([f"{text}; give the folder of a finished study, or repeat an interrupted one"], USAGE)
    _report(folder)


def _require_packages() -> None:
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        text = f"`swarmctl study` needs {', '.join(missing)}; install them by pip install '{EXTRA}'"
        fail([f"{text} [study-packages]"], FAILED)


def _load_or_exit(config: Path, worlds: int | None) -> Experiment:
    from swarmctl.config.problems import ConfigError  # noqa: PLC0415 - slow imports
    from swarmctl.study.experiment import load_experiment  # noqa: PLC0415

    try:
        return load_experiment(config, worlds)
    except ConfigError as error:
        fail(error.lines, USAGE)


def _describe(experiment: Experiment) -> str:
    n_levels, until = len(experiment.levels), experiment.section.until
    most = "at most " if until is not None else ""
    text = f"{n_levels} level{'s' if n_levels > 1 else ''} × {most}{experiment.worlds} worlds"
    number = f"{most}{n_levels * experiment.worlds} {experiment.section.kind}"
    return f"{experiment.section.question}\n{text}: {number}"


def _run(experiment: Experiment, folder: Path, n_workers: int, scheduler: str | None) -> None:
    from swarmctl.study.cluster import ClusterError, local_workers, workers_of  # noqa: PLC0415
    from swarmctl.study.flights import FlightFailed  # noqa: PLC0415
    from swarmctl.study.results import ResultsError, open_results  # noqa: PLC0415
    from swarmctl.study.run import run  # noqa: PLC0415

    def next_block(n_worlds: int, widest: float) -> None:
        say(_precision(experiment, n_worlds, widest), console=err)

    command = shlex.join(["swarmctl", *sys.argv[1:]])
    try:
        source = local_workers(n_workers) if scheduler is None else workers_of(scheduler)
        with source as workers, open_results(folder, experiment) as results, _progress(workers) as progress:
            outcome = run(experiment, results, workers, progress, command, next_block)
    except (ResultsError, ClusterError, FlightFailed) as error:
        fail([str(error)], FAILED)
    except (KeyboardInterrupt, SystemExit):
        text = f"interrupted; {folder} keeps the finished batches, and the same command goes on from there"
        say(text, console=err)
        raise typer.Exit(INTERRUPTED) from None
    if outcome.widest is not None:
        say(_precision(experiment, outcome.n_worlds, outcome.widest))
    say(f"{outcome.n_rows} rows: {folder / 'results.parquet'}")


def _precision(experiment: Experiment, n_worlds: int, widest: float) -> str:
    """Return how precise a study with `until` is."""
    wanted = experiment.section.until
    assert wanted is not None
    text = f"{n_worlds} worlds: the widest interval is ± {widest:.3g}"
    return text if widest <= wanted.half_width else f"{text}, wider than ± {wanted.half_width:g}"


class _Rate(ProgressColumn):
    """The number of missions, or of routes, in a second."""

    def render(self, task: Any) -> Text:
        return Text("" if task.speed is None else f"{task.speed:,.0f}/s", style="progress.data.speed")


@contextmanager
def _progress(workers: Workers[Any, Any]) -> Iterator[Any]:
    """Show a bar with rate and time left on a terminal, and a line for each tenth elsewhere."""
    if not err.is_terminal:
        yield _Lines()
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(STARTING, total=None)
        begin: int | None = None

        def show(done: int, total: int) -> None:
            nonlocal begin
            if begin is None:  # earlier missions do not count as speed
                begin = done
                bar.reset(task, completed=done, total=total)
            n = workers.n_cores
            text = STARTING if done == begin else f"{n} worker{'' if n == 1 else 's'}"
            bar.update(task, completed=done, total=total, description=text)

        yield show


class _Lines:
    """Progress for a file or a pipe: a line for each tenth."""

    def __init__(self) -> None:
        self._tenth = -1

    def __call__(self, done: int, total: int) -> None:
        if (tenth := 10 * done // total) != self._tenth:
            self._tenth = tenth
            say(f"{done} of {total} done", console=err)


def _report(folder: Path) -> None:
    from swarmctl.study.report import ReportError, write  # noqa: PLC0415 - loads matplotlib

    try:
        say(f"figures and report: {write(folder)}")
    except ReportError as error:
        fail([str(error)], FAILED)
