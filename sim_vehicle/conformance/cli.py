"""`python -m sim_vehicle conformance URL`."""

import contextlib
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from sim_vehicle.conformance.guard import ALTER, ARM, CRASH, REBOOT
from sim_vehicle.conformance.link_wire import LinkWire
from sim_vehicle.conformance.registry import select
from sim_vehicle.conformance.report import (
    as_json,
    check_tables,
    describe_vehicle,
    print_result,
    result_tables,
)
from sim_vehicle.conformance.runner import RunReport, granted_permissions, run
from sim_vehicle.conformance.traffic import WireError
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.links.url import UrlError, parse_url

FAILED, USAGE_ERROR, INTERRUPTED = 1, 2, 130  # exit codes


def conformance(
    url: Annotated[
        str | None,
        typer.Argument(help="Link to the vehicle: udpin:0.0.0.0:14550, udpout:, tcpout:, tcpin: or serial:."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Run only this category, name or pattern ('mission', 'mission.*'); repeatable."),
    ] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Show the checks and exit.")] = False,
    sysid: Annotated[
        int | None, typer.Option(min=1, max=254, help="System id; default: the first vehicle.")
    ] = None,
    allow_arm: Annotated[
        bool, typer.Option("--allow-arm", help="Allow arming and flying a vehicle that is not the simulator.")
    ] = False,
    allow_reboot: Annotated[
        bool, typer.Option("--allow-reboot", help="Allow rebooting the vehicle.")
    ] = False,
    allow_alter: Annotated[
        bool,
        typer.Option("--allow-alter", help="Allow erasing logs, setting a signing key, calibrating sensors."),
    ] = False,
    allow_crash: Annotated[
        bool,
        typer.Option("--allow-crash", help="Allow, as the last checks, frames that ended a known firmware."),
    ] = False,
    ground_only: Annotated[
        bool, typer.Option("--ground-only", help="Arm nothing, not even the simulator.")
    ] = False,
    speedup: Annotated[
        float, typer.Option(min=0.1, max=1000, help="Vehicle seconds per second, for a simulated vehicle.")
    ] = 1.0,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Also write the results to this file.")
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print each result during the run.")
    ] = False,
) -> None:
    """Check one vehicle at a URL against MAVLink and the known behaviour of its autopilot.

    A real vehicle is armed, rebooted or altered only if an option allows it. At the end, also after Ctrl-C,
    the plans and parameters are restored; a note lists each failure. A plan without a saved copy is not
    overwritten. Other vehicles on the link receive only messages without an effect.

    Exit codes: 0 no check failed; 1 a check failed; 2 a bad argument, link or file; 130 interrupted.
    """
    console = Console()
    try:
        checks = select(only or [])
        if list_only:
            console.print(check_tables(checks))
            return
        if url is None:
            raise typer.BadParameter("a URL is needed, for example udpin:0.0.0.0:14550", param_hint="URL")
        wire = LinkWire(parse_url(url), speedup, warn=_warn)
    except (ValueError, UrlError, WireError) as error:
        raise _usage(error) from error
    with contextlib.closing(wire):
        allow = {ARM: allow_arm, REBOOT: allow_reboot, ALTER: allow_alter, CRASH: allow_crash}
        vehicle = VehicleUnderTest(wire)
        try:
            identity = vehicle.connect(sysid)
        except WireError as error:
            raise _usage(error) from error
        vehicle.permissions = granted_permissions(
            identity, frozenset(k for k, given in allow.items() if given), ground_only=ground_only
        )
        console.print(describe_vehicle(identity), highlight=False)
        report = run(
            vehicle,
            checks,
            on_result=lambda result: print_result(console, result) if verbose else None,
            on_interrupt=lambda: _warn("interrupted; landing and restoring the vehicle [restoring]"),
        )
    _report(console, report, url, json_file)


def _warn(line: str) -> None:
    # A closed standard error must not stop the restoration of the vehicle.
    with contextlib.suppress(OSError):
        typer.echo(f"sim_vehicle conformance: {line}", err=True)


def _usage(error: Exception) -> typer.Exit:
    typer.echo(f"sim_vehicle conformance: {error}", err=True)
    return typer.Exit(USAGE_ERROR)


def _report(console: Console, report: RunReport, url: str, json_file: Path | None) -> None:
    console.print(result_tables(report))
    if json_file is not None:
        try:
            json_file.write_text(as_json(report, url) + "\n", encoding="utf-8")
        except OSError as error:
            raise _usage(ValueError(f"--json {json_file}: {error.strerror}")) from error
    if report.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not report.passed:
        raise typer.Exit(FAILED)
