"""The command line: the program's entry, its commands and its exit codes.

Exit codes: 0 done, 1 something expected went wrong and was said, 2 wrong usage or configuration, 3 a bug,
130 interrupted.
"""

from __future__ import annotations

import traceback
from typing import Annotated

import typer

from swarmctl import __version__
from swarmctl.bus.leaving import leave
from swarmctl.commands import (
    agent,
    check,
    fly,
    keys,
    observe,
    order,
    plan,
    replay,
    router,
    schema,
    watch,
    weights,
)
from swarmctl.commands.shared import BUG, INTERRUPTED, OK, err, out

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

# In the order of the help.
for command in (fly, plan, check, weights, observe, agent, watch, order, router, keys, replay, schema):
    command.register(cli)


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
