"""`python -m sim_vehicle run`: fly and check scenarios; the exit code is the verdict."""

import json
import shlex
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from sim_vehicle.problems import nearest
from sim_vehicle.scenarios import Scenario, ScenarioError, load_scenario
from sim_vehicle.scenarios.checks import CHECKS
from sim_vehicle.scenarios.report import fold, print_verdict, write_verdict
from sim_vehicle.scenarios.runner import Run
from sim_vehicle.serving.tlog import tlogs

FOLDER = Path(__file__).parent

FAILED, UNUSABLE = 1, 2  # exit codes
LAG_REPORTED_S = 0.5  # smallest reported lag behind the wall clock


def run(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(help="Scenario files, or names of shipped scenarios.", show_default=False),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for results; each scenario gets a folder with tlogs and verdict.json."),
    ] = Path("runs"),
    seed: Annotated[int | None, typer.Option(min=0, help="Seed; replaces the scenario's seed.")] = None,
    speedup: Annotated[
        float | None,
        typer.Option(min=0.1, max=1000, help="Simulated seconds per second; default: as the scenario says."),
    ] = None,
    list_scenarios: Annotated[bool, typer.Option("--list", help="Show the shipped scenarios.")] = False,
    list_checks: Annotated[bool, typer.Option("--list-checks", help="Show the checks.")] = False,
    show_scenario: Annotated[
        str | None, typer.Option("--show", metavar="NAME", help="Print a shipped scenario as a template.")
    ] = None,
) -> None:
    """Fly scenarios on the virtual clock and check them.

    Exit codes: 0 every step and check passed; 1 a step or a check failed; 2 a scenario or the folder of
    results is unusable; 130 interrupted, without a verdict of the running scenario.
    """
    console = Console(highlight=False)
    if list_scenarios or list_checks:
        _list(console, with_scenarios=list_scenarios, with_checks=list_checks)
        return
    if show_scenario is not None:
        _print_scenario(show_scenario)
        return
    if not scenarios:
        raise typer.BadParameter("give a scenario file, or a name from `run --list`", param_hint="SCENARIOS")
    try:
        loaded = [(text, load_scenario(find_scenario(text), standalone=True)) for text in scenarios]
    except ScenarioError as error:
        for line in str(error).splitlines():
            typer.echo(f"sim_vehicle: {line}", err=True)
        raise typer.Exit(UNUSABLE) from error
    verdicts = [_fly(console, text, scenario, out, seed=seed, speedup=speedup) for text, scenario in loaded]
    if not all(verdicts):
        raise typer.Exit(FAILED)


def schema() -> None:
    """Print the JSON schema of scenario files, for editors that complete and check keys."""
    from sim_vehicle.scenarios.schema import file_schema  # noqa: PLC0415 (not needed for a run)

    typer.echo(json.dumps(file_schema(), indent=1))


def _print_scenario(name: str) -> None:
    names = shipped()
    if name not in names:
        raise typer.BadParameter(
            f"{name!r} is not a shipped scenario; the names are {', '.join(names)}", param_hint="--show"
        )
    typer.echo(names[name].read_text(encoding="utf-8"), nl=False)


def _fly(
    console: Console, text: str, scenario: Scenario, out: Path, *, seed: int | None, speedup: float | None
) -> bool:
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    folder = out / scenario.name
    speed_limit = _SpeedLimit(speedup or scenario.speedup)
    try:
        with tlogs(folder, scenario.vehicles) as record_frame:
            run = Run(
                scenario,
                on_frame=record_frame,
                on_failure=lambda line: console.print(f"[red]{escape(line)}"),
            )
            verdict = run.run(speed_limit.wait)
        write_verdict(folder, verdict)
    except OSError as error:
        typer.echo(
            f"sim_vehicle: {folder}: {error.strerror or error}; choose another folder with --out", err=True
        )
        raise typer.Exit(UNUSABLE) from error
    print_verdict(console, verdict)
    took_s = speed_limit.took_s()
    word = "[green]passed[/]" if verdict.passed else "[red]FAILED[/]"
    speed = f"{verdict.simulated_s:.1f} s simulated in {took_s:.1f} s"
    console.print(f"{scenario.name}: {word}, {speed}; {escape(str(folder))}", soft_wrap=True)
    if speed_limit.lost_s > LAG_REPORTED_S:
        typer.echo(
            f"sim_vehicle: the machine is too slow for {speed_limit.speedup:g}x; "
            f"the run took {speed_limit.lost_s:.1f} s longer; use a lower --speedup",
            err=True,
        )
    if not verdict.passed:
        command = f"python -m sim_vehicle run {shlex.quote(text)} --seed {scenario.seed}"
        console.print(f"to repeat the run: {escape(command)}", soft_wrap=True)
    return verdict.passed


class _SpeedLimit:
    """The limit of the simulation to `speedup` times real time; None: unlimited."""

    def __init__(self, speedup: float | None) -> None:
        self.speedup = speedup
        self.lost_s = 0.0  # lag behind the wall clock that the run does not recover
        self._began_s = time.monotonic()

    def took_s(self) -> float:
        return time.monotonic() - self._began_s

    def wait(self, now: float) -> None:
        if self.speedup is None:
            return
        ahead_s = now / self.speedup + self.lost_s - self.took_s()
        if ahead_s > 0:
            time.sleep(ahead_s)
        elif ahead_s < -LAG_REPORTED_S:
            self.lost_s -= ahead_s


def _list(console: Console, *, with_scenarios: bool, with_checks: bool) -> None:
    scenarios = shipped() if with_scenarios else {}
    listed = [(name, f": {load_scenario(path).about}") for name, path in scenarios.items()]
    for check in CHECKS.values() if with_checks else ():
        argument = ""
        if check.argument is not None:
            default = "" if check.default is None else f" = {check.default}"
            argument = f" ({check.argument}{default})"
        listed.append((check.name, f"{argument}, {check.when}: {check.summary}"))
    for name, text in listed:
        first, *rest = fold(Text(name + text), console.width if console.is_terminal else None, "    ")
        first.stylize("bold", 0, len(name))
        for line in (first, *rest):
            console.print(line, soft_wrap=True)


def shipped() -> dict[str, Path]:
    """Return the files of the shipped scenarios, by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


def find_scenario(text: str) -> Path:
    """Return the path of a scenario from a path or a shipped name; raise ScenarioError if unknown."""
    path = Path(text)
    if path.exists():
        return path
    names = shipped()
    if text in names:
        return names[text]
    near = nearest(path.stem, names)
    meant = f"; did you mean {near}?" if near else ""
    raise ScenarioError(f"{text}: no such file and no shipped scenario{meant}; `run --list` shows the names")
