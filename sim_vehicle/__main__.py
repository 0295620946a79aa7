"""`python -m sim_vehicle`: a fleet on MAVLink links; `run` and `conformance` are commands of their own."""

import importlib
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Never

import typer

from sim_vehicle.serving.output import let_output_get_lost

USAGE_ERROR, INTERRUPTED = 2, 130
# Imported only when asked for: a fleet should be up in a moment.
COMMANDS = {
    "run": ("sim_vehicle.scenarios.command", "run"),
    "conformance": ("sim_vehicle.conformance.cli", "conformance"),
    "schema": ("sim_vehicle.scenarios.command", "schema"),
}
DEFAULT_URL = "udpout:127.0.0.1:14550"
HELP_FAULTS = "help"
DISTRIBUTION = "mavlink-swarmctl"
HELP = {"help_option_names": ["--help", "-h"]}
# The class of all that can be wrong with a command line; its own name has moved between versions of typer.
USAGE: type[Any] = typer.BadParameter.__mro__[2]


def fleet(
    count: Annotated[
        int | None,
        typer.Option("--count", "-n", min=1, max=10_000, help="How many vehicles; 1 if not given."),
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(
            "--home",
            "-l",
            "--custom-location",
            metavar="LAT,LON,ALT[,HDG]",
            help="Where the first stands [deg, deg, m above sea level]; the others 5 m apart to the east. "
            "If not given, in Ljubljana, Slovenia.",
        ),
    ] = None,
    personality: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="ardupilot (if not given), px4, mixed (in turn), or ardupilot:3,px4:2."
        ),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option("--type", "--vehicle", "-v", metavar="TYPE", help="copter (if not given) or plane."),
    ] = None,
    speedup: Annotated[
        float | None,
        typer.Option(
            "--speedup", "-S", min=0.1, max=1000, help="Simulated seconds per second; 1 if not given."
        ),
    ] = None,
    url: Annotated[
        list[str] | None,
        typer.Option(
            "--url",
            "--out",
            help="Where to talk, more than once for more: udpout:HOST:PORT, udpin:HOST:PORT, "
            f"tcpin:HOST:PORT, tcpout:HOST:PORT, serial:DEVICE:BAUD. If not given, {DEFAULT_URL}.",
        ),
    ] = None,
    per_port: Annotated[
        int | None,
        typer.Option(min=1, max=250, help="Vehicles on a port, more on further ports; 250 if not given."),
    ] = None,
    port_step: Annotated[
        int, typer.Option(min=1, max=1000, help="From one port to the next (ArduPilot's instances: 10).")
    ] = 1,
    sysid: Annotated[
        int | None, typer.Option(min=1, max=250, help="System id of the first; 1 if not given.")
    ] = None,
    ready_s: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=3600,
            help="Simulated seconds from boot to a position estimate; 0: at once. "
            "If not given, as long as the real ones take.",
        ),
    ] = None,
    wind: Annotated[
        str | None, typer.Option(metavar="SPEED,FROM[,GUST]", help="[m/s, deg, m/s]; none if not given.")
    ] = None,
    param: Annotated[
        list[str] | None,
        typer.Option(
            "--param", "-P", metavar="NAME=VALUE", help="A parameter of those vehicles that have it."
        ),
    ] = None,
    param_file: Annotated[
        list[Path] | None,
        typer.Option(
            "--param-file", "--add-param-file", help="Parameters in a file: NAME VALUE in each line."
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[:k=v,...]",
            help="What goes wrong, e.g. packet_loss:rate=0.2,at=30,for=10; help lists.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of all randomness; 0 if not given.")] = None,
    scenario: Annotated[
        Path | None, typer.Option(help="File with vehicles, faults, area and hostiles, YAML or JSON.")
    ] = None,
    step: Annotated[
        bool,
        typer.Option(
            "--step",
            help="Time stands still but for the lines `step SECONDS` on standard input, each "
            "answered by `at SECONDS`; `quit` ends.",
        ),
    ] = False,
    tlog: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write what each vehicle sends there.")
    ] = None,
    table: Annotated[
        bool, typer.Option(help="Show the fleet live, where output is a terminal; never with --step.")
    ] = True,
    parent_pid: Annotated[int | None, typer.Option(help="Stop when this process is gone.")] = None,
    version: Annotated[bool, typer.Option("--version", help="Show which version this is.")] = False,
) -> None:
    """Vehicles in software that fly and speak MAVLink like ArduPilot and PX4. Ctrl-C stops them.

    `python -m sim_vehicle run --help` flies scenarios and judges them; `... conformance --help` examines any
    autopilot. Exit codes: 0 ended as it should, 2 something given is wrong.
    """  # fmt: skip
    # --help needs none of these, which take a while
    from sim_vehicle.faults.spec import help_text  # noqa: PLC0415
    from sim_vehicle.links import LinkError  # noqa: PLC0415
    from sim_vehicle.serving.options import FleetOptions, OptionError, read_options  # noqa: PLC0415
    from sim_vehicle.serving.serve import Serving, serve  # noqa: PLC0415

    if version:
        typer.echo(f"sim_vehicle {_version()}")
        return
    if fault and HELP_FAULTS in fault:
        typer.echo(help_text())
        return
    if step and speedup is not None:
        _refuse("--speedup: not with --step, where time passes only when it is told to; drop one of them")
    options = FleetOptions(
        count=count,
        home=home,
        personality=personality,
        kind=kind,
        sysid=sysid,
        seed=seed,
        per_port=per_port,
        wind=wind,
        params=param or (),
        param_files=param_file or (),
        faults=fault or (),
        scenario=scenario,
    )
    try:
        chosen, urls, notes = read_options(options, url or [DEFAULT_URL])
        for note in notes:
            typer.echo(f"sim_vehicle: {note}", err=True)
        serve(
            chosen,
            Serving(
                urls=urls,
                port_step=port_step,
                ready_s=ready_s,
                speedup=None if step else speedup or chosen.speedup or 1.0,
                tlog=tlog,
                table=table,
                parent_pid=parent_pid,
            ),
        )
    except (OptionError, LinkError) as error:
        _refuse(str(error))


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "of a checkout that is not installed"


def _refuse(text: str) -> Never:
    for line in text.splitlines():
        typer.echo(f"sim_vehicle: {line}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _leave(_number: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def _end_by(handler: Callable[[int, FrameType | None], Any]) -> None:
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the last: a terminal that is closed, where there is one
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), handler)


def main() -> None:
    """The entry point of the package: the fleet, or one of the other commands."""
    name, arguments = "sim_vehicle", sys.argv[1:]
    command = COMMANDS.get(arguments[0]) if arguments else None
    let_output_get_lost()
    # From the first moment on, also while things are imported. A fleet just stops; a command may have a
    # vehicle in the air, and ends in order.
    _end_by(_leave if command is None else signal.default_int_handler)
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    try:
        if command is None:
            app.command(context_settings=HELP)(fleet)
        else:
            app.command(context_settings=HELP)(getattr(importlib.import_module(command[0]), command[1]))
            name, arguments = f"{name} {arguments[0]}", arguments[1:]
        code = typer.main.get_command(app)(arguments, prog_name=f"python -m {name}", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except USAGE as error:
        typer.echo(f"{name}: {' '.join(error.format_message().split())} (--help says more)", err=True)
        code = USAGE_ERROR
    if code == INTERRUPTED:
        typer.echo(f"{name}: interrupted", err=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
