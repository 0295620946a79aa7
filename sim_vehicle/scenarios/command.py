"""`python -m sim_vehicle run`: fly scenarios, judge them, exit with the verdict."""

import json
import shlex
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from sim_vehicle.scenarios import Scenario, ScenarioError, load_scenario
from sim_vehicle.scenarios.checks import CHECKS
from sim_vehicle.scenarios.report import folded, show, tlogs, write_verdict
from sim_vehicle.scenarios.runner import Run
from sim_vehicle.scenarios.shipped import find, shipped

FAILED, UNUSABLE = 1, 2
LAG_REPORTED_S = 0.5


def run(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(help="Scenario files, or names of shipped scenarios.", show_default=False),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Where a folder for each scenario is made, with its tlogs and verdict.json.")
    ] = Path("runs"),
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the scenario's.")] = None,
    speedup: Annotated[
        float | None,
        typer.Option(min=0.1, max=1000, help="Simulated seconds per second, instead of as fast as it goes."),
    ] = None,
    list_scenarios: Annotated[bool, typer.Option("--list", help="Show the shipped scenarios.")] = False,
    list_checks: Annotated[bool, typer.Option("--list-checks", help="Show what can be checked.")] = False,
    show_scenario: Annotated[
        str | None, typer.Option("--show", metavar="NAME", help="Print a shipped scenario, to begin with.")
    ] = None,
) -> None:
    """Fly scenarios on the virtual clock and judge them.

    Exits with 0 if every check of every scenario passed, 1 if one failed, 2 if a scenario cannot be used, 130
    if it was interrupted: then no verdict is written of the scenario that was flown.
    """
    console = Console(highlight=False)
    if list_scenarios or list_checks:
        _list(console, with_scenarios=list_scenarios, with_checks=list_checks)
        return
    if show_scenario is not None:
        _print(show_scenario)
        return
    if not scenarios:
        raise typer.BadParameter("name a scenario file, or one of `run --list`", param_hint="SCENARIOS")
    try:
        loaded = [(text, load_scenario(find(text), flown=True)) for text in scenarios]
    except ScenarioError as error:
        for line in str(error).splitlines():
            typer.echo(f"sim_vehicle: {line}", err=True)
        raise typer.Exit(UNUSABLE) from error
    verdicts = [_fly(console, text, scenario, out, seed=seed, speedup=speedup) for text, scenario in loaded]
    if not all(verdicts):
        raise typer.Exit(FAILED)


def schema() -> None:
    """Print the JSON schema of scenario files, for editors that complete and check keys."""
    from sim_vehicle.scenarios.schema import file_schema  # noqa: PLC0415 (a run needs none of it)

    typer.echo(json.dumps(file_schema(), indent=1))


def _print(name: str) -> None:
    names = {scenario.name: scenario.path for scenario in shipped()}
    if name not in names:
        raise typer.BadParameter(f"{name!r} is none of {', '.join(names)}", param_hint="--show")
    typer.echo(names[name].read_text(encoding="utf-8"), nl=False)


def _fly(
    console: Console, text: str, scenario: Scenario, out: Path, *, seed: int | None, speedup: float | None
) -> bool:
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    folder = out / scenario.name
    pace = _Pace(speedup or scenario.speedup)
    try:
        with tlogs(folder, scenario.vehicles) as heard:
            run = Run(scenario, heard=heard, said=lambda line: console.print(f"[red]{escape(line)}"))
            verdict = run.run(pace.wait)
        write_verdict(folder, verdict)
    except OSError as error:
        typer.echo(
            f"sim_vehicle: {folder}: {error.strerror or error}; choose another folder by --out", err=True
        )
        raise typer.Exit(UNUSABLE) from error
    show(console, verdict)
    took_s = pace.took_s()
    word = "[green]passed[/]" if verdict.passed else "[red]FAILED[/]"
    speed = f"{verdict.simulated_s:.1f} s simulated in {took_s:.1f} s"
    console.print(f"{scenario.name}: {word}, {speed}; {escape(str(folder))}", soft_wrap=True)
    if pace.lost_s > LAG_REPORTED_S:
        typer.echo(
            f"sim_vehicle: could not keep up with {pace.speedup:g}x, {pace.lost_s:.1f} s lost", err=True
        )
    if not verdict.passed:
        command = f"python -m sim_vehicle run {shlex.quote(text)} --seed {scenario.seed}"
        console.print(f"repeat it with: {escape(command)}", soft_wrap=True)
    return verdict.passed


class _Pace:
    """Waits for the wall clock, `speedup` times slower than the simulated one; None: never."""

    def __init__(self, speedup: float | None) -> None:
        self.speedup = speedup
        self.lost_s = 0.0
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
    listed = [(scenario.name, f": {scenario.about}") for scenario in shipped()] if with_scenarios else []
    for check in CHECKS.values() if with_checks else ():
        argument = ""
        if check.argument is not None:
            default = "" if check.default is None else f" = {check.default}"
            argument = f" ({check.argument}{default})"
        listed.append((check.name, f"{argument}, {check.when}: {check.summary}"))
    for name, text in listed:
        first, *others = folded(Text(name + text), console.width if console.is_terminal else None, "    ")
        first.stylize("bold", 0, len(name))
        for line in (first, *others):
            console.print(line, soft_wrap=True)
