"""The program: its commands, shell completion and exit codes.

Exit codes: 0 done, 1 failed for a reported cause, 2 wrong usage or configuration, 3 a bug, 130 interrupted
before the work was done. `router`, `watch` and `dashboard` run until Ctrl-C and then end with 0.
"""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from swarmctl import __version__
from swarmctl.bus.transports.process_exit import exit_process
from swarmctl.cli.console import BUG, INTERRUPTED, OK, STYLE, err, say
from swarmctl.cli.registry import COMMANDS


class _LazyGroup(TyperGroup):
    """A group that imports only the called command, because planners and pictures are slow to import."""

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        for name, (_, summary) in COMMANDS.items():
            self.add_command(TyperCommand(name, help=summary))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] in COMMANDS:
            self.add_command(load_command(args[0]), args[0])
        return super().resolve_command(ctx, args)


def load_command(name: str) -> Any:
    """Import a command's file, and return its `app`, or else its function of the same name, as a command."""
    file, _ = COMMANDS[name]
    module = import_module(f"swarmctl.cli.{file}")
    app = getattr(module, "app", None)
    if not isinstance(app, typer.Typer):
        app = typer.Typer(add_completion=False, **STYLE)
        app.command(name)(getattr(module, file))
    return typer.main.get_command(app)


cli = typer.Typer(
    name="swarmctl",
    cls=_LazyGroup,
    help="Fly a swarm of MAVLink vehicles across an area with unknown threats.\n\n"
    "Start here: `swarmctl fly --example swarm` flies five simulated copters; "
    "its run folder has a map, a summary and all logs. `swarmctl plan` shows first routes without a flight, "
    "`swarmctl check` lists the problems of a configuration.",
    no_args_is_help=True,
    **STYLE,
)


def _print_version(is_given: bool) -> None:
    if is_given:
        say(f"swarmctl {__version__}")
        raise typer.Exit


@cli.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line and exit with its code."""
    exit_process(_exit_code())


def _exit_code() -> int:
    try:
        cli(prog_name="swarmctl")  # also for `python -m swarmctl`
    except SystemExit as ended:  # the usual end of a command
        return ended.code if isinstance(ended.code, int) else OK
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception:  # noqa: BLE001 - the only place where a bug becomes an exit code
        traceback.print_exc()
        say("swarmctl: this is a bug; please report it with the text above [bug]", "bold red", err)
        return BUG
    return OK
