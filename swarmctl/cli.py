"""The command line: the only place that prints and exits.

Exit codes: 0 done, 1 something expected went wrong and was said, 2 wrong usage or configuration, 3 a bug,
130 interrupted.
"""

from __future__ import annotations

import asyncio
import json
import sys
import traceback
from collections.abc import Sequence
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from swarmctl import __version__, app, front_report, operate, outputs, plan_report, preflight, record
from swarmctl.app import Report
from swarmctl.bus.base import BusError
from swarmctl.clock import run_virtual
from swarmctl.config import Config, ConfigError, load
from swarmctl.core.chance import WORLDS
from swarmctl.core.messages import SetWeights
from swarmctl.core.roster import meant_by
from swarmctl.director import Member, Permission, PreflightFailed
from swarmctl.display import told
from swarmctl.flight_report import flight_table, missed
from swarmctl.judge import judge
from swarmctl.known import NotKnown, with_known, without_a_way
from swarmctl.planners.front import MAX_LABELS
from swarmctl.scenario import Scenario, build
from swarmctl.terminal import LiveTable, PlainLines, Terminal

OK, EXPECTED, USAGE, BUG, INTERRUPTED = 0, 1, 2, 3, 130

cli = typer.Typer(
    name="swarmctl",
    help="Fly a swarm of MAVLink vehicles across an area whose threats nobody knows beforehand.\n\n"
    "Start here: `swarmctl fly --config configs/swarm.yaml` flies five simulated copters; "
    "the run folder it names holds a map, a summary and every log. `swarmctl plan` shows first routes "
    "without flying, `swarmctl check` finds what is wrong with a configuration.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
WIDE = 140
"""columns where nobody looks at a terminal"""
out = Console(width=None if sys.stdout.isatty() else WIDE)
err = Console(stderr=True)


class Clock(StrEnum):
    REAL = "real"
    VIRTUAL = "virtual"


ConfigOption = Annotated[
    Path,
    typer.Option("--config", "-c", help="The swarm, as YAML; see configs/swarm.yaml.", show_default=False),
]
OutOption = Annotated[Path, typer.Option("--out", help="Where run folders are made.")]


def _say_version(wanted: bool) -> None:
    if wanted:
        out.print(f"swarmctl {__version__}", highlight=False)
        raise typer.Exit


@cli.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say the version and exit."),
    ] = False,
) -> None:
    pass


@cli.command()
def fly(
    config: ConfigOption,
    clock: Annotated[
        Clock,
        typer.Option(help="virtual: simulated vehicles in this process, as fast as it computes, repeatable."),
    ] = Clock.REAL,
    real: Annotated[
        bool, typer.Option("--real", help="Allow arming vehicles that the built-in simulator does not play.")
    ] = False,
    confirm: Annotated[
        str,
        typer.Option(metavar="NAME,NAME", help="With --real, for scripts: the vehicles that may be armed."),
    ] = "",
    out_folder: OutOption = Path("runs"),
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Show everything that is said.")] = False,
) -> None:
    """Fly the swarm, simulated or real, from the ground to the last landing."""
    scenario = _scenario(config)
    if clock is Clock.VIRTUAL and scenario.config.vehicles:
        _fail(
            [f"{config}: vehicles with a URL fly in real time; `--clock virtual` is for `simulate` only"],
            USAGE,
        )
    allowed = _confirmed(scenario, confirm) if real else frozenset()
    if clock is Clock.REAL and (found := list(preflight.troubles(scenario, out_folder))):
        _fail(found, EXPECTED)
    folder = _run_folder(out_folder, scenario.config.name)
    terminal: Terminal = (LiveTable if out.is_terminal else PlainLines)(out, verbose=verbose)
    with terminal.shown():
        flight = app.fly(scenario, folder, terminal, clock=clock.value, permission=_permission(allowed))
        report = run_virtual(flight) if clock is Clock.VIRTUAL else asyncio.run(flight)
    trouble = _written(folder, scenario, report)
    _tell(report, folder)
    if trouble:
        _fail([trouble], EXPECTED)
    if report.bug is not None:
        raise report.bug
    if report.ended in ("stopped", "abandoned"):
        raise typer.Exit(INTERRUPTED)
    if report.trouble or not report.all_arrived or missed(report.summary):
        raise typer.Exit(EXPECTED)


@cli.command()
def plan(
    config: ConfigOption,
    out_folder: OutOption = Path("runs"),
    front: Annotated[
        bool,
        typer.Option("--front", help="All routes worth flying: what each metre more saves in exposure."),
    ] = False,
    uav: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="With --front: this vehicle only; a name or system id.", show_default=False
        ),
    ] = "",
    max_labels: Annotated[
        int, typer.Option(min=1, help="With --front: partial routes that a vehicle's search may cost.")
    ] = MAX_LABELS,
    known: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Plan with what an earlier run over the area has seen."),
    ] = None,
) -> None:
    """Plan the first routes for w = 0, 0.5 and 1 without flying: a table, a map and .plan files."""
    scenario = _scenario(config)
    if known is not None:
        scenario = _with_known(scenario, known)
    if front:
        _plan_front(scenario, out_folder, uav, max_labels)
        return
    if uav:
        _fail(["--uav chooses whose front is shown; give --front too"], USAGE)
    folder = _run_folder(out_folder, f"{scenario.config.name}-plan")
    routes = outputs.first_routes(scenario)
    outputs.write_plans(folder, scenario, routes)
    out.print(plan_report.plan_table(scenario, routes))
    out.print(
        "ΣP_s is a sum of chances, and ∏(1 − P_s) takes cells as independent: neither is the chance of "
        f"getting through. That is simulated, in {WORLDS} worlds drawn from what is believed.",
        style="bright_black",
        highlight=False,
    )
    out.print(f"map and missions: {folder}", highlight=False, soft_wrap=True)


@cli.command()
def check(config: ConfigOption, out_folder: OutOption = Path("runs")) -> None:
    """Say everything that is wrong with a configuration, here and now, without starting anything."""
    scenario = _scenario(config)
    found = list(preflight.troubles(scenario, out_folder))
    if found:
        _fail(found, EXPECTED)
    n, grid = len(scenario.specs), scenario.grid
    text = (
        f"{config}: good. {n} vehicle{'s' if n != 1 else ''}, {grid.rows} × {grid.cols} cells of "
        f"{grid.cell_size_m:g} m, {scenario.prior.count} hostiles announced."
    )
    out.print(text, highlight=False, soft_wrap=True)


@cli.command("set")
def set_weights(
    uav: Annotated[
        list[str] | None,
        typer.Option(
            "--uav",
            metavar="NAME",
            help="A vehicle's name or system id; may be repeated.",
            show_default=False,
        ),
    ] = None,
    everyone: Annotated[bool, typer.Option("--all", help="Every vehicle of the swarm.")] = False,
    w: Annotated[
        float | None, typer.Option("--w", help="Distance anxiety: 0 the shortest route, 1 the least exposed.")
    ] = None,
    firing_strength: Annotated[
        str,
        typer.Option(metavar="D,N1,N2", help="The three below in one: 0.7,0.3,0.1."),
    ] = "",
    direct: Annotated[float | None, typer.Option(help="Firing strength over a hostile's cell.")] = None,
    first_neighbour: Annotated[float | None, typer.Option(help="Over the 4 nearest cells.")] = None,
    second_neighbour: Annotated[float | None, typer.Option(help="Over the 4 diagonal cells.")] = None,
    swarm: Annotated[
        str | None, typer.Option(help="Its name, where more than one flies on this machine.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="The swarm's configuration, instead of its name.")
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option(metavar="tcp/HOST:PORT", help="Where the flight listens, if not on this machine."),
    ] = None,
) -> None:
    """Change w and the firing strengths of vehicles in flight, from their next plans on."""
    try:
        strengths = operate.strengths(firing_strength, (direct, first_neighbour, second_neighbour))
        command = SetWeights(operate.meant(uav or [], everyone), w, strengths)
        station = operate.find(swarm, load(config) if config is not None else None, connect)
    except ConfigError as error:
        _fail(error.lines, USAGE)
    except ValueError as error:
        _fail([str(error)], USAGE)
    except BusError as error:
        _fail([str(error)], EXPECTED)
    try:
        answer = asyncio.run(operate.set_weights(station, command))
    except (BusError, operate.NoAnswer) as error:
        _fail([str(error)], EXPECTED)
    if answer.refused:
        _fail([f"{station.swarm} refused: {answer.refused}"], EXPECTED)
    for vehicle in answer.vehicles:
        text = told(command.w, command.strength, vehicle)
        (out if vehicle.outcome == "taken" else err).print(
            text, highlight=False, markup=False, soft_wrap=True
        )
    if operate.has_failed(command, answer):
        raise typer.Exit(EXPECTED)


@cli.command()
def replay(
    run: Annotated[Path, typer.Argument(help="A run folder, or its run.mcap.", show_default=False)],
) -> None:
    """Fold the recorded events of a run again and say whether the same was decided."""
    try:
        verdict = record.replay(record.of(run))
    except record.RecordError as error:
        _fail([str(error)], USAGE)
    if verdict.difference:
        _fail([f"differs: {verdict.difference}"], EXPECTED)
    out.print(
        f"the same: {verdict.events} events gave the {verdict.effects} effects recorded", highlight=False
    )


@cli.command()
def schema() -> None:
    """Print the JSON schema of configurations, for editors."""
    out.print_json(
        json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **Config.model_json_schema()})
    )


def main() -> None:
    """The entry point of the package."""
    try:
        cli()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception:  # noqa: BLE001 - the one place where a bug becomes an exit code
        traceback.print_exc()
        err.print("swarmctl: this is a bug; please report it with the text above", style="bold red")
        sys.exit(BUG)


def _scenario(path: Path) -> Scenario:
    try:
        return build(load(path, judge))
    except ConfigError as error:
        _fail(error.lines, USAGE)


def _fail(lines: Sequence[str], code: int) -> NoReturn:
    for text in lines:
        err.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)


def _run_folder(parent: Path, name: str) -> Path:
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
        folder = parent / f"{stamp}-{name}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            _fail([f"the run folder {folder} cannot be made: {error.strerror or error}"], EXPECTED)
        return folder
    raise AssertionError("a thousand runs in a second")


def _confirmed(scenario: Scenario, confirm: str) -> frozenset[str]:
    """The vehicles the operator has named, which must be all that are not simulated here."""
    names = [spec.name for spec in scenario.specs if not spec.simulated]
    if not names:
        _fail(["--real: every vehicle of this configuration is simulated; leave --real away"], USAGE)
    if not confirm:
        if not sys.stdin.isatty():
            _fail([f"--real needs a terminal to confirm at, or --confirm {','.join(names)}"], USAGE)
        for spec in scenario.specs:
            if not spec.simulated:
                out.print(f"  {spec.name}: system {spec.sysid} at {spec.url}", highlight=False)
        confirm = typer.prompt("These will be armed and fly. Type their names, separated by commas")
    typed = [name.strip() for name in confirm.split(",") if name.strip()]
    if sorted(typed) != sorted(names):
        _fail(
            [f"not confirmed: expected {','.join(names)}, found {','.join(typed)}; nothing was started"],
            USAGE,
        )
    return frozenset(names)


def _permission(allowed: frozenset[str]) -> Permission:
    def permit(foreign: Sequence[Member]) -> None:
        refused = [m for m in foreign if m.name not in allowed]
        if refused:
            raise PreflightFailed([_refusal(m) for m in refused])

    return permit


def _refusal(member: Member) -> str:
    found = member.identity.firmware if member.identity is not None else "an unknown autopilot"
    return (
        f"{member.name}: {found} at {member.spec.url} is not played by the built-in simulator, so it is not "
        "armed; to fly it, give --real and type the names of the vehicles"
    )


def _with_known(scenario: Scenario, run: Path) -> Scenario:
    try:
        scenario, said = with_known(scenario, run)
    except NotKnown as error:
        _fail([str(error)], USAGE)
    for text in said:
        out.print(text, highlight=False, markup=False, soft_wrap=True)
    if closed := list(without_a_way(scenario)):
        _fail(closed, EXPECTED)
    return scenario


def _plan_front(scenario: Scenario, out_folder: Path, uav: str, max_labels: int) -> None:
    names = {spec.sysid: spec.name for spec in scenario.specs}
    try:
        wanted = meant_by([uav], names) if uav else list(names)
    except ValueError as error:
        _fail([f"--uav {uav}: {error}"], USAGE)
    found = front_report.fronts(scenario, [names[sysid] for sysid in wanted], max_labels)
    folder = _run_folder(out_folder, f"{scenario.config.name}-front")
    front_report.write_fronts(folder, scenario, found)
    out.print(front_report.front_table(found))
    for text in [*front_report.left_out(found), front_report.WHAT_IS_WHAT]:
        out.print(text, style="bright_black", highlight=False, markup=False, soft_wrap=True)
    out.print(f"all routes, with their cells, and the picture: {folder}", highlight=False, soft_wrap=True)


def _tell(report: Report, folder: Path) -> None:
    for text in report.trouble:
        err.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    if report.ended in ("ended", "stopped", "abandoned"):
        out.print(flight_table(report.summary))
    if report.ended != "ended" or not report.all_arrived:
        if report.ended == "abandoned":
            out.print("left at once, without waiting for any vehicle:", style="yellow", highlight=False)
        for text in report.left:
            out.print(text, highlight=False, markup=False, soft_wrap=True)
    if report.ended == "failed":
        out.print("nothing was flown to the end; see above", highlight=False)
    else:
        out.print(f"{report.arrived} of {len(report.states)} arrived", highlight=False)
        if late := missed(report.summary):
            err.print(f"out of time: {', '.join(late)}", style="red", highlight=False, soft_wrap=True)
    out.print(f"run folder: {folder}", highlight=False, soft_wrap=True)


def _written(folder: Path, scenario: Scenario, report: Report) -> str:
    """Writes what a run leaves for people; returns what went wrong with it."""
    try:
        if report.states:
            outputs.write_run(folder, scenario, report)
    except OSError as error:
        return f"{folder}: the run's files could not be written: {error.strerror or error}"
    return ""
