"""`swarmctl watch`: the table of vehicles whose agents run on other machines."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from typing import Annotated

import typer
from rich.live import Live

from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.cli.configuration import load_roster_or_exit
from swarmctl.cli.console import FAILED, INTERRUPTED, OK, ConfigOption, ConnectOption, fail, log, out
from swarmctl.cli.ground_station import GroundStation, ground_station_or_exit
from swarmctl.station import watch as watching
from swarmctl.station.watch import StateBoard, StationView, table

LINES_EVERY_S = 30.0


def watch(
    config: ConfigOption,
    connect: ConnectOption = None,
    once: Annotated[
        bool,
        typer.Option(
            "--once", help="Show the table once and exit: when all vehicles have reported, or after 5 s."
        ),
    ] = False,
) -> None:
    """Show the positions and states of a swarm on many machines, until Ctrl-C."""
    swarm = load_roster_or_exit(config)
    station = ground_station_or_exit(config, swarm, connect)
    board = StateBoard(swarm.name, swarm.names, swarm.grid, station.codec)
    shown = _once if once else _live if out.is_terminal else _lines
    try:
        with shown() as show_view:
            asyncio.run(_watch(station, board, swarm.name, show_view, once=once))
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
    station: GroundStation,
    board: StateBoard,
    swarm: str,
    show_view: Callable[[StationView], None],
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
    with ZenohBus(station.network) as bus:
        await watching.watch(bus, board, swarm, lambda: station.state_of(bus), show_view, once=once)


@contextlib.contextmanager
def _live() -> Iterator[Callable[[StationView], None]]:
    with Live(console=out, auto_refresh=False) as live:
        yield lambda view: live.update(table(view), refresh=True)


@contextlib.contextmanager
def _once() -> Iterator[Callable[[StationView], None]]:
    yield lambda view: out.print(table(view))


@contextlib.contextmanager
def _lines() -> Iterator[Callable[[StationView], None]]:
    yield watching.StateLines(log, LINES_EVERY_S).show
