"""`python -m sim_vehicle`: a fleet on MAVLink links; `run` and `conformance` are commands of their own."""

import importlib
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Never

import typer

USAGE_ERROR = 2
# Imported only when asked for: a fleet should be up in a moment.
COMMANDS = {
    "run": ("sim_vehicle.run.command", "run"),
    "conformance": ("sim_vehicle.conformance.cli", "conformance"),
}
DEFAULT_URL = "udpout:127.0.0.1:14550"
HELP_FAULTS = "help"
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
    table: Annotated[bool, typer.Option(help="Show the fleet live, where output is a terminal.")] = True,
    parent_pid: Annotated[int | None, typer.Option(help="Stop when this process is gone.")] = None,
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


def _refuse(text: str) -> Never:
    for line in text.splitlines():
        typer.echo(f"sim_vehicle: {line}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _leave(_number: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def main() -> None:
    """The entry point of the package: the fleet, or one of the other commands."""
    for number in (signal.SIGINT, signal.SIGTERM):  # from the first moment on, also while things are imported
        signal.signal(number, _leave)
    name, arguments = "sim_vehicle", sys.argv[1:]
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    if arguments and arguments[0] in COMMANDS:
        module, function = COMMANDS[arguments[0]]
        app.command()(getattr(importlib.import_module(module), function))
        name, arguments = f"{name} {arguments[0]}", arguments[1:]
    else:
        app.command()(fleet)
    try:
        code = typer.main.get_command(app)(arguments, prog_name=f"python -m {name}", standalone_mode=False)
    except USAGE as error:
        typer.echo(f"{name}: {' '.join(error.format_message().split())} (--help says more)", err=True)
        code = USAGE_ERROR
    sys.exit(code)


if __name__ == "__main__":
    main()
