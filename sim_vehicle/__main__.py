"""`python -m sim_vehicle`: a fleet on MAVLink links, and the commands of `COMMANDS`."""

import importlib
import io
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Never

import typer

USAGE_ERROR, INTERRUPTED = 2, 130
# Modules are imported on use, so that a fleet starts quickly.
COMMANDS = {
    "run": ("sim_vehicle.scenarios.command", "run"),
    "conformance": ("sim_vehicle.conformance.cli", "conformance"),
    "conformance-table": ("sim_vehicle.conformance.table", "conformance_table"),
    "schema": ("sim_vehicle.scenarios.command", "schema"),
}
DEFAULT_URL = "udpout:127.0.0.1:14550"
HELP_FAULTS = "help"
DISTRIBUTION = "mavlink-swarmctl"
CONTEXT = {"help_option_names": ["--help", "-h"]}
# ClickException, the base class of command-line errors; the module differs between typer versions.
CommandLineError: type[Any] = typer.BadParameter.__mro__[2]


def fleet(
    count: Annotated[
        int | None,
        typer.Option("--count", "-n", min=1, max=10_000, help="Vehicles; default as in --personality, or 1."),
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(
            "--home",
            "-l",
            metavar="LAT,LON,ALT[,HDG]",
            help="Position of the first vehicle [deg, deg, m above sea level, deg]; further vehicles stand "
            "5 m apart to the east. Default: Ljubljana, Slovenia.",
        ),
    ] = None,
    personality: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="ardupilot (default), px4, or mixed (alternating)."),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option("--type", metavar="TYPE", help="copter (default) or plane."),
    ] = None,
    speedup: Annotated[
        float | None,
        typer.Option("--speedup", "-S", min=0.1, max=1000, help="Simulated seconds per second; default 1."),
    ] = None,
    url: Annotated[
        list[str] | None,
        typer.Option(
            "--url",
            "--out",
            help="A link (repeatable): udpout:HOST:PORT, udpin:HOST:PORT, "
            f"tcpin:HOST:PORT, tcpout:HOST:PORT, serial:DEVICE:BAUD. Default: {DEFAULT_URL}.",
        ),
    ] = None,
    per_port: Annotated[
        int | None,
        typer.Option(min=1, max=250, help="Vehicles per port, then the next port; default: up to id 250."),
    ] = None,
    port_step: Annotated[
        int, typer.Option(min=1, max=1000, help="Step between port numbers (ArduPilot's SITL: 10).")
    ] = 1,
    sysid: Annotated[
        int | None, typer.Option(min=1, max=250, help="System id of the first vehicle; default 1.")
    ] = None,
    ready_s: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=3600,
            help="Simulated seconds from boot to a position estimate; 0: at once. "
            "Default: as on the real autopilots.",
        ),
    ] = None,
    wind: Annotated[
        str | None, typer.Option(metavar="SPEED,FROM[,GUST]", help="[m/s, deg, m/s]; default: no wind.")
    ] = None,
    param: Annotated[
        list[str] | None,
        typer.Option("--param", "-P", metavar="NAME=VALUE", help="A parameter of all vehicles that have it."),
    ] = None,
    param_file: Annotated[
        list[Path] | None,
        typer.Option(
            "--param-file", "--add-param-file", help="A file of parameters: NAME VALUE in each line."
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[:k=v,...]",
            help="A fault, e.g. packet_loss:rate=0.2,at=30,for=10; `help` lists all.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness; default 0.")] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(help="YAML or JSON file with vehicles, faults and area; its values replace defaults."),
    ] = None,
    step: Annotated[
        bool,
        typer.Option(
            "--step",
            help="Advance time only by lines `step SECONDS` on standard input. The answer to each line is "
            "`at SECONDS`; `quit` ends.",
        ),
    ] = False,
    tlog: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for a tlog of each vehicle.")
    ] = None,
    table: Annotated[bool, typer.Option(help="Show the fleet live on a terminal; never with --step.")] = True,
    parent_pid: Annotated[int | None, typer.Option(help="Stop when this process has ended.")] = None,
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """Run simulated vehicles that fly and speak MAVLink like ArduPilot and PX4. Ctrl-C stops the fleet.

    `python -m sim_vehicle run` flies and checks scenarios; `python -m sim_vehicle conformance` tests any
    autopilot. Exit codes: 0 normal end, 2 invalid option or unusable link.
    """  # fmt: skip
    # These imports are slow, and --help does not need them.
    from sim_vehicle.faults.spec import help_text  # noqa: PLC0415
    from sim_vehicle.links import LinkError  # noqa: PLC0415
    from sim_vehicle.serving.options import FleetOptions, OptionError, read_options  # noqa: PLC0415
    from sim_vehicle.serving.serve import ServeSettings, serve  # noqa: PLC0415

    if version:
        typer.echo(f"sim_vehicle {_version()}")
        return
    if fault and HELP_FAULTS in fault:
        typer.echo(help_text())
        return
    if step and speedup is not None:
        _exit_usage_error(
            "--speedup and --step exclude each other: --step advances time on request; remove one of the two"
        )
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
            ServeSettings(
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
        _exit_usage_error(str(error))


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "(not installed)"


def _exit_usage_error(text: str) -> Never:
    for line in text.splitlines():
        typer.echo(f"sim_vehicle: {line}", err=True)
    raise typer.Exit(USAGE_ERROR)


def _exit_now(_number: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def _handle_signals(handler: Callable[[int, FrameType | None], Any]) -> None:
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # SIGHUP: the terminal closes; missing on some platforms
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), handler)


def main() -> None:
    """Run the fleet, or the command named by the first argument."""
    name, arguments = "sim_vehicle", sys.argv[1:]
    command = COMMANDS.get(arguments[0]) if arguments else None
    tolerate_lost_output()
    # A signal during the imports ends a fleet at once. In a command every signal raises KeyboardInterrupt.
    _handle_signals(_exit_now if command is None else signal.default_int_handler)
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    try:
        if command is None:
            app.command(context_settings=CONTEXT)(fleet)
        else:
            app.command(context_settings=CONTEXT)(getattr(importlib.import_module(command[0]), command[1]))
            name, arguments = f"{name} {arguments[0]}", arguments[1:]
        code = typer.main.get_command(app)(arguments, prog_name=f"python -m {name}", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except CommandLineError as error:
        typer.echo(f"{name}: {' '.join(error.format_message().split())} (see --help)", err=True)
        code = USAGE_ERROR
    if code == INTERRUPTED:
        typer.echo(f"{name}: interrupted", err=True)
    sys.exit(code)


# -- output after the loss of its reader --------------------------------------------------------------------


class _TolerantStream(io.TextIOWrapper):
    """A standard stream that discards all text after its first failure."""

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._discard(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._discard(error)

    def _discard(self, error: OSError) -> None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
        if self is sys.stdout and sys.stderr is not None and not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"sim_vehicle: standard output is lost ({error.strerror})\n")


def tolerate_lost_output() -> None:
    """Let a run and its exit code survive lost output: a closed pipe (`| head`) or a full disk."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is getattr(sys, f"__{name}__") and isinstance(stream, io.TextIOWrapper):
            setattr(
                sys,
                name,
                _TolerantStream(
                    stream.buffer,
                    stream.encoding,
                    stream.errors,
                    line_buffering=stream.line_buffering,
                    write_through=stream.write_through,
                ),
            )


if __name__ == "__main__":
    main()
