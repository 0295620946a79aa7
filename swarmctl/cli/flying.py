"""What commands that fly have in common: who may be armed, where it is shown, how it ended."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import EXPECTED, INTERRUPTED, USAGE, err, fail, out, timed
from swarmctl.config.links_checks import forwarding_problem
from swarmctl.config.scenario import Scenario
from swarmctl.flight import companion
from swarmctl.flight.director import Permission, PreflightFailed
from swarmctl.flight.member import Member
from swarmctl.links.url import parse_url
from swarmctl.preflight.waivers import Waiver, parse_waivers
from swarmctl.report import outputs
from swarmctl.report.flight_table import flight_table, missed_bounds, network_lines
from swarmctl.report.outcome import Report
from swarmctl.report.terminal import LiveTable, PlainLines, Terminal

RealOption = Annotated[
    bool, typer.Option("--real", help="Allow arming vehicles that the built-in simulator does not play.")
]
ForwardOption = Annotated[
    list[str] | None,
    typer.Option(
        "--forward",
        metavar="MAVLINK_URL",
        help="Here goes a copy of all traffic of the vehicles, for QGroundControl or Mission Planner to "
        "watch, such as udpout:127.0.0.1:14550; repeatable.",
    ),
]


WaiveOption = Annotated[
    list[str] | None,
    typer.Option(
        "--waive",
        metavar="CHECK[:VEHICLE]",
        help="Let a preflight check fail (repeatable): said, and recorded in summary.json.",
    ),
]


def waivers_of(texts: list[str] | None, scenario: Scenario) -> tuple[Waiver, ...]:
    """What the operator takes upon himself; leaves where that may not be."""
    try:
        return parse_waivers(texts or (), [spec.name for spec in scenario.specs])
    except ValueError as error:
        fail([f"--waive {error}"], USAGE)


class _TimedLines(PlainLines):
    """For the logs of a flight on many machines, which are read side by side."""

    def say(self, text: str) -> None:
        super().say(timed(text))


class _TimedTable(LiveTable):
    def log(self, text: str) -> None:
        super().log(timed(text))


def terminal(*, verbose: bool, with_time: bool = False) -> Terminal:
    """`with_time`: each line that stays has the wall clock's."""
    if out.is_terminal:
        return (_TimedTable if with_time else LiveTable)(out, verbose=verbose)
    return (_TimedLines if with_time else PlainLines)(out, verbose=verbose)


def forwarded(scenario: Scenario, urls: Sequence[str]) -> Scenario:
    """The scenario with more places to which the vehicles' traffic goes."""
    config = scenario.config
    for url in urls:
        try:
            parse_url(url)
        except ValueError as error:
            fail([f"--forward: {error}"], USAGE)
        if strangers := forwarding_problem(config.links, url):
            fail([f"--forward {strangers}"], USAGE)
    links = config.links.model_copy(update={"forward": (*config.links.forward, *urls)})
    return replace(scenario, config=config.model_copy(update={"links": links}))


def conclude(report: Report, scenario: Scenario, folder: Path) -> None:
    """Say how it ended, leave its files, and leave with its exit code."""
    trouble = _written(folder, scenario, report)
    _tell(report, folder)
    if trouble:
        fail([trouble], EXPECTED)
    if report.bug is not None:
        raise report.bug
    if report.ended in ("stopped", "abandoned"):
        raise typer.Exit(INTERRUPTED)
    done = report.arrived + len(companion.ended_by_operator(report))
    if report.trouble or done < max(len(report.states), 1) or _late(report):
        raise typer.Exit(EXPECTED)


def _late(report: Report) -> list[str]:
    """The vehicles that did not keep their time bounds; whom an operator has called back needs not."""
    return [name for name in missed_bounds(report.summary) if name not in companion.ended_by_operator(report)]


def _tell(report: Report, folder: Path) -> None:
    for text in report.trouble:
        err.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    if report.ended in ("ended", "stopped", "abandoned"):
        out.print(flight_table(report.summary))
        for text in network_lines(report.summary):
            out.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if report.ended != "ended" or not report.all_arrived:
        if report.ended == "abandoned":
            out.print("left at once, without waiting for any vehicle:", style="yellow", highlight=False)
        for text in report.final_states:
            out.print(text, highlight=False, markup=False, soft_wrap=True)
    if report.ended == "failed":
        out.print("nothing was flown to the end; see above", highlight=False)
    else:
        out.print(f"{report.arrived} of {len(report.states)} arrived", highlight=False)
        if called_back := companion.ended_by_operator(report):
            out.print(f"ended by the operator: {', '.join(called_back)}", highlight=False, soft_wrap=True)
        if late := _late(report):
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


def confirmed(scenario: Scenario, confirm: str) -> frozenset[str]:
    """The vehicles the operator has named, which must be all that are not simulated here."""
    names = [spec.name for spec in scenario.specs if not spec.simulated]
    if not names:
        fail(["--real: every vehicle of this configuration is simulated; leave --real away"], USAGE)
    if not confirm:
        if not sys.stdin.isatty():
            fail([f"--real needs a terminal to confirm at, or --confirm {','.join(names)}"], USAGE)
        for spec in scenario.specs:
            if not spec.simulated:
                out.print(f"  {spec.name}: system {spec.sysid} at {spec.url}", highlight=False)
        confirm = typer.prompt("These will be armed and fly. Type their names, separated by commas")
    typed = [name.strip() for name in confirm.split(",") if name.strip()]
    if sorted(typed) != sorted(names):
        fail(
            [f"not confirmed: expected {','.join(names)}, found {','.join(typed)}; nothing was started"],
            USAGE,
        )
    return frozenset(names)


def permission(allowed: frozenset[str]) -> Permission:
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
