"""`python -m sim_vehicle conformance URL`."""

import contextlib
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from sim_vehicle.conformance.guard import ALTER, ARM, REBOOT
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import select
from sim_vehicle.conformance.report import as_json, catalogue, matrix, print_result, vehicle_words
from sim_vehicle.conformance.runner import Report, permissions, run
from sim_vehicle.conformance.sockets import open_wire
from sim_vehicle.conformance.wire import WireError
from sim_vehicle.links.url import UrlError, parse_url

FAILED, USAGE_ERROR, INTERRUPTED = 1, 2, 130


def conformance(
    url: Annotated[
        str | None,
        typer.Argument(
            help="Where the vehicle talks: udpin:0.0.0.0:14550, udpout:, tcpout:, tcpin: or serial:."
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Checks by category, name or pattern ('mission', 'mission.*'); may be given again."
        ),
    ] = None,
    list_checks: Annotated[bool, typer.Option("--list", help="Show the checks and stop.")] = False,
    sysid: Annotated[int | None, typer.Option(min=1, max=254, help="Which vehicle; the first heard.")] = None,
    allow_arm: Annotated[
        bool, typer.Option("--allow-arm", help="A vehicle that is not the simulator may be armed and flown.")
    ] = False,
    allow_reboot: Annotated[bool, typer.Option("--allow-reboot", help="It may be rebooted.")] = False,
    allow_alter: Annotated[
        bool,
        typer.Option("--allow-alter", help="Logs may be erased, a signing key set, sensors calibrated."),
    ] = False,
    ground_only: Annotated[
        bool, typer.Option("--ground-only", help="Nothing arms, the simulator neither.")
    ] = False,
    speedup: Annotated[
        float, typer.Option(min=0.1, max=1000, help="Vehicle seconds per second, where it is simulated.")
    ] = 1.0,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the results there as well.")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="A line a check while it runs.")] = False,
) -> None:
    """Check one vehicle at a URL against MAVLink and what its autopilot is known to do.

    A vehicle that is not the simulator is never armed, rebooted or altered unless that is allowed. Its
    mission, fence and rally points are put back afterwards, also when Ctrl-C ends it; what could not be saved
    before is not touched. Nothing that changes a vehicle is sent to another. The exit code is 0 if nothing
    failed, 1 if something did, 2 if something given is wrong, 130 if it was interrupted.
    """
    console = Console()
    try:
        checks = select(only or [])
        if list_checks:
            console.print(catalogue(checks))
            return
        if url is None:
            raise typer.BadParameter("a URL is needed, for example udpin:0.0.0.0:14550", param_hint="URL")
        wire = open_wire(parse_url(url), speedup=speedup)
    except (ValueError, UrlError, WireError) as error:
        raise _usage(error) from error
    with contextlib.closing(wire):
        allow = {ARM: allow_arm, REBOOT: allow_reboot, ALTER: allow_alter}
        peer = Peer(wire)
        try:
            facts = peer.meet(sysid)
        except WireError as error:
            raise _usage(error) from error
        peer.permits = set(
            permissions(facts, frozenset(k for k, given in allow.items() if given), ground_only=ground_only)
        )
        console.print(vehicle_words(facts), highlight=False)
        report = run(
            peer,
            checks,
            on_result=lambda result: print_result(console, result) if verbose else None,
            on_interrupt=_say_that_it_ends,
        )
    _tell(console, report, url, json_file)


def _say_that_it_ends() -> None:
    # Also where nobody reads any more: the vehicle comes first.
    with contextlib.suppress(OSError):
        typer.echo("sim_vehicle conformance: ending; the vehicle is brought down and put back", err=True)


def _usage(error: Exception) -> typer.Exit:
    typer.echo(f"sim_vehicle conformance: {error}", err=True)
    return typer.Exit(USAGE_ERROR)


def _tell(console: Console, report: Report, url: str, json_file: Path | None) -> None:
    console.print(matrix(report))
    if json_file is not None:
        try:
            json_file.write_text(as_json(report, url) + "\n", encoding="utf-8")
        except OSError as error:
            raise _usage(ValueError(f"--json {json_file}: {error.strerror}")) from error
    if report.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not report.passed:
        raise typer.Exit(FAILED)
