"""The command line: the program's entry, its commands and its exit codes.

Exit codes: 0 done, 1 something expected went wrong and was said, 2 wrong usage or configuration, 3 a bug,
130 interrupted before the work was done. `router` and `watch` are meant to run until Ctrl-C: they end with 0.
"""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from swarmctl import __version__
from swarmctl.bus.transports.process_exit import leave
from swarmctl.cli.console import BUG, INTERRUPTED, OK, err, out
from swarmctl.cli.registry import COMMANDS


class _LoadedByName(TyperGroup):
    """Only the command that is called is imported: an order does not wait for planners and pictures."""

    def __init__(self, **attrs: Any) -> None:
        super().__init__(**attrs)
        for name, (_, summary) in COMMANDS.items():
            self.add_command(TyperCommand(name, help=summary))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] in COMMANDS:
            self.add_command(_loaded(args[0]), args[0])
        return super().resolve_command(ctx, args)


def _loaded(name: str) -> Any:
    module, _ = COMMANDS[name]
    alone = typer.Typer(**_STYLE)
    import_module(f"swarmctl.cli.{module}").register(alone)
    return typer.main.get_command(alone)


_STYLE: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": "markdown",
}

cli = typer.Typer(
    name="swarmctl",
    cls=_LoadedByName,
    help="Fly a swarm of MAVLink vehicles across an area whose threats nobody knows beforehand.\n\n"
    "Start here: `swarmctl fly --config configs/swarm.yaml` flies five simulated copters; "
    "the run folder it names holds a map, a summary and every log. `swarmctl plan` shows first routes "
    "without flying, `swarmctl check` finds what is wrong with a configuration.",
    no_args_is_help=True,
    **_STYLE,
)


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


def main() -> None:
    """The entry point of the package."""
    leave(_exit_code())


def _exit_code() -> int:
    try:
        cli()
    except SystemExit as ended:  # as every command ends
        return ended.code if isinstance(ended.code, int) else OK
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception:  # noqa: BLE001 - the one place where a bug becomes an exit code
        traceback.print_exc()
        err.print("swarmctl: this is a bug; please report it with the text above", style="bold red")
        return BUG
    return OK
