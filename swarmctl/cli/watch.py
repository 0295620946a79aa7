"""`swarmctl watch`: the table of vehicles whose agents run on other machines."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import os
import signal
from collections.abc import Callable, Iterator
from typing import Annotated

import typer
from rich.live import Live

from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.cli.configuration import keys_problem_lines, load_roster_or_exit
from swarmctl.cli.console import FAILED, INTERRUPTED, OK, USAGE, ConfigOption, fail, log, out
from swarmctl.config import joining
from swarmctl.core.frames import FrameCodec
from swarmctl.core.operator_text import extended
from swarmctl.security.files import KeyringError
from swarmctl.station import watch
from swarmctl.station.watch import StateBoard, SwarmView, table

LINES_EVERY_S = 30.0


def register(cli: typer.Typer) -> None:
    cli.command("watch")(show)


def show(
    config: ConfigOption,
    connect: Annotated[
        str | None,
        typer.Option(metavar="tcp/HOST:PORT", help="The router, instead of communication.router."),
    ] = None,
    once: Annotated[
        bool,
        typer.Option(
            "--once", help="Show the table once and exit: when all vehicles have reported, or after 5 s."
        ),
    ] = False,
) -> None:
    """Show the positions and states of a swarm on many machines, until Ctrl-C."""
    swarm = load_roster_or_exit(config)
    try:
        keyring = joining.keyring_of(swarm, OPERATOR, dt.datetime.now(dt.UTC))
        network = joining.as_station(swarm, connect, keyring)
    except KeyringError as error:
        fail(keys_problem_lines(config, [str(error)]), FAILED)
    except joining.NoNetwork as error:
        advice = "" if connect is not None else ", or give --connect tcp/HOST:PORT"
        fail([extended(str(error), advice)], USAGE)
    verify = None if keyring is None else keyring.verify
    board = StateBoard(swarm.name, swarm.names, swarm.grid, FrameCodec(swarm.name, None, verify))
    shown = _live if out.is_terminal and not once else _lines if not once else _once
    try:
        with shown() as show_view:
            asyncio.run(_watch(network, board, swarm.name, show_view, once=once))
    except BusError as error:
        fail([str(error)], FAILED)
    except asyncio.CancelledError:
        # Ctrl-C is the normal end of the command; with --once it is an interruption.
        raise typer.Exit(INTERRUPTED if once else OK) from None
    if not board.has_any:
        fail(
            [
                "no valid state of a vehicle was received; check that the agents run, and that they connect "
                "to the same router or mesh [no-vehicle]"
            ],
            FAILED,
        )


async def _watch(
    network: Configuration,
    board: StateBoard,
    swarm: str,
    show_view: Callable[[SwarmView], None],
    *,
    once: bool,
) -> None:
    """Show the swarm until a signal raises CancelledError; a second signal ends the process at once."""
    task = asyncio.current_task()
    assert task is not None

    def interrupted() -> None:
        if task.cancelling():
            os._exit(INTERRUPTED)
        task.cancel()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        with contextlib.suppress(ValueError, RuntimeError):  # not the main thread
            asyncio.get_running_loop().add_signal_handler(number, interrupted)
    with ZenohBus(network) as bus:

        def network_state() -> str:
            where = ", ".join(map(str, network.connect))
            if bus.connected:
                return f"{where}: connected"
            trouble = f" ({bus.trouble})" if bus.trouble else ""
            return f"{where}: not connected{trouble}: {joining.connection_advice(network)}"

        await watch.watch(bus, board, swarm, network_state, show_view, once=once)


@contextlib.contextmanager
def _live() -> Iterator[Callable[[SwarmView], None]]:
    with Live(console=out, auto_refresh=False) as live:
        yield lambda view: live.update(table(view), refresh=True)


@contextlib.contextmanager
def _once() -> Iterator[Callable[[SwarmView], None]]:
    yield lambda view: out.print(table(view))


@contextlib.contextmanager
def _lines() -> Iterator[Callable[[SwarmView], None]]:
    yield watch.StateLines(log, LINES_EVERY_S).show
