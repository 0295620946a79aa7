"""Shared parts of the commands that fly: options, arming permission, display, Ctrl-C, exit code."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Coroutine, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, TypeVar

import typer

from swarmctl.cli.console import FAILED, INTERRUPTED, USAGE, fail, out, say, say_error, split_items, timed
from swarmctl.config.links_checks import forwarding_problem
from swarmctl.config.scenario import Scenario
from swarmctl.core.operator_text import typed_names
from swarmctl.core.records import replace
from swarmctl.flight.gc_tuning import tune_collector
from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.flight.permission import Permission, PreflightFailed
from swarmctl.flight.run import Clock, real_clock_need
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links.url import parse_url
from swarmctl.preflight.waivers import Waiver, parse_waivers
from swarmctl.report import outputs
from swarmctl.report.flight_table import flight_table, missed_bounds, network_lines
from swarmctl.report.outcome import FlightReport
from swarmctl.report.terminal import LiveTable, PlainLines, Terminal

RealOption = Annotated[
    bool, typer.Option("--real", help="Allow arming vehicles outside the built-in simulator.")
]
ConfirmOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME,…",
        callback=split_items,
        help="With --real, in scripts: the names of all real vehicles.",
    ),
]
ForwardOption = Annotated[
    list[str] | None,
    typer.Option(
        "--forward",
        metavar="MAVLINK_URL",
        help="Send a copy of the vehicles' traffic to this URL, for QGroundControl or Mission Planner, such "
        "as udpout:127.0.0.1:14550; repeatable.",
    ),
]
WaiveOption = Annotated[
    list[str] | None,
    typer.Option(
        "--waive",
        metavar="CHECK[:VEHICLE],…",
        callback=split_items,
        help="Accept failed preflight checks, of one vehicle or of all. The results show the waivers.",
    ),
]
T = TypeVar("T")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LATE_INTERRUPT = (
    b"the flight is over and its files are being written; press Ctrl-C again to exit without them\n"
)
STDERR = 2


def parse_waivers_or_exit(texts: list[str] | None, scenario: Scenario) -> tuple[Waiver, ...]:
    """Return the waivers of the options; exit if a waiver is not allowed."""
    try:
        return parse_waivers(texts or (), {spec.sysid: spec.name for spec in scenario.specs})
    except ValueError as error:
        fail([f"--waive {error}"], USAGE)


class _TimedLines(PlainLines):
    """Plain lines that begin with the time, because logs of several machines are compared."""

    def say(self, text: str) -> None:
        super().say(timed(text))


class _TimedTable(LiveTable):
    def log(self, text: str) -> None:
        super().log(timed(text))


def terminal(*, verbose: bool, with_time: bool = False) -> Terminal:
    """Return the display; with `with_time`, each line except the live table begins with the time of day."""
    if out.is_terminal:
        return (_TimedTable if with_time else LiveTable)(out, verbose=verbose)
    return (_TimedLines if with_time else PlainLines)(out, verbose=verbose)


def require_simulated_clock(path: Path, scenario: Scenario) -> None:
    """Exit if a vehicle or a link of the configuration needs the machine's clock."""
    if (need := real_clock_need(scenario)) is not None:
        fail([f"{path}: {need}; remove --clock virtual"], USAGE)


def with_forwarding(scenario: Scenario, urls: Sequence[str]) -> Scenario:
    """Return the scenario with these receivers of the vehicles' traffic added; exit if a URL is invalid."""
    config = scenario.config
    for url in urls:
        try:
            parse_url(url)
        except ValueError as error:
            fail([f"--forward: {error}"], USAGE)
        if problem := forwarding_problem(config.links, url):
            fail([f"--forward {problem}"], USAGE)
    links = config.links.model_copy(update={"forward": (*config.links.forward, *urls)})
    return replace(scenario, config=config.model_copy(update={"links": links}))


def conclude(report: FlightReport, scenario: Scenario, folder: Path) -> None:
    """Write a run's files and print the results; raise typer.Exit, or the run's bug, unless all succeeded."""
    problem = _write_files(folder, scenario, report)
    _print_results(report, folder)
    if problem:
        fail([problem], FAILED)
    if report.bug is not None:
        raise report.bug
    if report.ended in ("stopped", "abandoned"):
        raise typer.Exit(INTERRUPTED)
    done = report.arrived + len(report.ended_by_operator)
    if report.trouble or done < max(len(report.states), 1) or _late_vehicles(report):
        raise typer.Exit(FAILED)


def _late_vehicles(report: FlightReport) -> list[str]:
    """Return the vehicles that missed their time bounds, unless they followed an operator's order."""
    return [name for name in missed_bounds(report.summary) if name not in report.ended_by_operator]


def _print_results(report: FlightReport, folder: Path) -> None:
    for text in report.trouble:
        say_error(text)
    if report.ended in ("ended", "stopped", "abandoned"):
        out.print(flight_table(report.summary))
        for text in network_lines(report.summary):
            say(text, "yellow")
    if report.ended != "ended" or not report.all_arrived:
        if report.ended == "abandoned":
            say("the program did not wait for the vehicles; their last known states:", "yellow")
        for text in report.final_states:
            say(text)
    if report.ended == "failed":
        say("no flight was completed; the lines above give the reasons")
    else:
        say(f"{report.arrived} of {len(report.states)} arrived")
        if ordered := report.ended_by_operator:
            say(f"ended by the operator: {', '.join(ordered)}")
        if late := _late_vehicles(report):
            say_error(f"missed their time bounds: {', '.join(late)} [time-bound-missed]")
    say(f"run folder: {folder}")


def _write_files(folder: Path, scenario: Scenario, report: FlightReport) -> str:
    """Write a run's files; return the problem as text, or an empty text."""
    try:
        if report.states:
            outputs.write_run(folder, scenario, report)
    except OSError as error:
        return f"{folder}: the run's files could not be written: {error.strerror or error}"
    return ""


def arming_permission(scenario: Scenario, *, real: bool, confirm: Sequence[str] | None) -> Permission:
    """Return a function that raises PreflightFailed for vehicles neither simulated nor confirmed."""
    allowed = _confirmed(scenario, confirm) if real else frozenset()

    def permit(external: Sequence[OwnVehicle]) -> None:
        refused = [m for m in external if m.name not in allowed]
        if refused:
            raise PreflightFailed([_refusal(m) for m in refused])

    return permit


def _confirmed(scenario: Scenario, confirm: Sequence[str] | None) -> frozenset[str]:
    """Return the names of all real vehicles; exit unless the operator gives or types exactly these names."""
    names = [spec.name for spec in scenario.specs if not spec.simulated]
    if not names:
        fail(["--real: every vehicle of this configuration is simulated; remove --real"], USAGE)
    if not confirm:
        if not sys.stdin.isatty():
            fail(
                [
                    "--real asks for a confirmation on a terminal; without a terminal add --confirm "
                    f"{','.join(names)}"
                ],
                USAGE,
            )
        for spec in scenario.specs:
            if not spec.simulated:
                say(f"  {spec.name}: system {spec.sysid} at {spec.url}")
        confirm = typed_names(
            typer.prompt("These real vehicles will be armed and fly. Type their names, separated by commas")
        )
    if sorted(confirm) != sorted(names):
        fail(
            [
                f"confirmation of real vehicles: expected {','.join(names)}, found {','.join(confirm)}; no "
                "flight was started [not-confirmed]"
            ],
            USAGE,
        )
    return frozenset(names)


def _refusal(vehicle: OwnVehicle) -> str:
    found = vehicle.identity.firmware if vehicle.identity is not None else "an unknown autopilot"
    return (
        f"{vehicle.name}: {found} at {vehicle.spec.url} is not a vehicle of the built-in simulator, so it is "
        "not armed; to fly it, give --real and type the vehicles' names [real-not-confirmed]"
    )


class _LateSignalLoop(asyncio.SelectorEventLoop):
    """An event loop that installs `on_late_signal` in place of each signal handler that the flight removes.

    Plain asyncio would install the default handler, which ends the process.
    """

    def __init__(self, on_late_signal: Callable[[int, FrameType | None], None]) -> None:
        super().__init__()
        self._on_late_signal = on_late_signal

    def remove_signal_handler(self, sig: int) -> bool:
        removed = super().remove_signal_handler(sig)
        signal.signal(sig, self._on_late_signal)
        return removed


@contextlib.contextmanager
def uninterrupted(
    display: Terminal, clock: Clock = "real"
) -> Iterator[Callable[[Coroutine[Any, Any, T]], T]]:
    """Yield a function that runs and shows a flight; protect the writing of its files from interruption.

    Between the end of the flight and the end of the context, the first signal only prints a warning. The
    second signal ends the process.
    """
    before = {number: signal.getsignal(number) for number in SIGNALS}
    is_warned = False

    def on_late_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal is_warned
        if is_warned:
            os._exit(INTERRUPTED)
        is_warned = True
        with contextlib.suppress(OSError):
            os.write(STDERR, LATE_INTERRUPT)  # sys.stderr may be writing another line

    def run(flight: Coroutine[Any, Any, T]) -> T:
        tune_collector()
        with display.shown():
            if clock == "virtual":
                return run_virtual(flight)
            with asyncio.Runner(loop_factory=lambda: _LateSignalLoop(on_late_signal)) as runner:
                return runner.run(flight)

    try:
        yield run
    finally:
        for number, handler in before.items():
            with contextlib.suppress(ValueError):  # not the main thread
                signal.signal(number, handler)
