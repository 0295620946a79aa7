"""`swarmctl dashboard`: the browser's view of a run, a flight in progress, a swarm, a study, or a set-up."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.base import BusError
from swarmctl.cli.configuration import load_roster_or_exit, load_scenario_or_exit
from swarmctl.cli.console import FAILED, OK, USAGE, ConnectOption, fail, say
from swarmctl.cli.live_dashboard import MISSING
from swarmctl.config.problems import ConfigError
from swarmctl.core.messages import Request, VehicleAnswer
from swarmctl.core.operator_text import extended
from swarmctl.report import record_file

if TYPE_CHECKING:
    from swarmctl.config.scenario import Scenario
    from swarmctl.dashboard.access import Sessions
    from swarmctl.dashboard.server import Where
    from swarmctl.dashboard.tiles import Tiles

PARENT_CHECK_S = 1.0
RUNS = Path("runs")
"""parent of the run folders of flights that the set-up starts"""


def dashboard(
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN", help="A run folder, its run.mcap, or the folder of a study.", show_default=False
        ),
    ] = None,
    other_run: Annotated[
        Path | None,
        typer.Argument(
            metavar="OTHER_RUN", help="Another run, shown beside the first one.", show_default=False
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            metavar="FILE",
            help="Configuration of a swarm of `swarmctl agent`, to watch it.",
            show_default=False,
        ),
    ] = None,
    connect: ConnectOption = None,
    live: Annotated[bool, typer.Option("--live", help="Follow the flight that writes RUN.")] = False,
    setup: Annotated[
        Path | None,
        typer.Option(
            "--setup",
            metavar="FILE",
            help="Configuration to edit on a map; a new file begins with the starter.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[int, typer.Option(help="Port on this machine; 0: any free port.", min=0, max=65535)] = 0,
    listen: Annotated[
        str,
        typer.Option(metavar="HOST", help="Address to listen at; for other machines with TLS."),
    ] = "127.0.0.1",
    cert: Annotated[
        Path | None,
        typer.Option(
            help="Certificate for TLS. Default: the operator's of communication.keys.",
            show_default=False,
        ),
    ] = None,
    key: Annotated[
        Path | None, typer.Option(help="Private key of the certificate, as PEM.", show_default=False)
    ] = None,
    tiles: Annotated[
        str | None,
        typer.Option(
            metavar="URL|FILE",
            help="A background map: a URL with {z}, {x} and {y}, or an MBTiles file.",
            show_default=False,
        ),
    ] = None,
    parent_pid: Annotated[int, typer.Option(hidden=True, help="End with this process.")] = 0,
) -> None:
    """Show a recorded run, a flight in progress, or the results of a study in a browser on this machine.

    Two runs are shown side by side on one time. With --config, watch a swarm of `swarmctl agent`
    processes. With --setup, edit a configuration on a map, and fly it.
    """
    if sum(given is not None for given in (run, config, setup)) != 1:
        fail(["give one of a run folder, --config FILE and --setup FILE"], USAGE)
    if other_run is not None and other_run == run:
        fail([f"{run} is given twice; give two different runs"], USAGE)
    try:
        from swarmctl.dashboard.server import (  # noqa: PLC0415
            CannotListen,
            CannotServe,
            GrowingTimeline,
            serve,
            serve_page,
        )
    except ModuleNotFoundError as error:
        fail([MISSING.format(error.name, "dashboard")], USAGE)
    from swarmctl.dashboard.sources.recording import RecordSource, open_live  # noqa: PLC0415
    from swarmctl.report.record import record_path  # noqa: PLC0415

    where = _where(listen, port, cert, key, config)
    background = None if tiles is None else _tiles_or_exit(tiles)

    def announce(role: str, address: str) -> None:
        say(f"{'open this address once' if where.certificate is None else f'for each {role}'}: {address}")

    async def until_parent_ends() -> None:
        while os.getppid() == parent_pid:  # noqa: ASYNC110 - the end of a parent raises no event
            await asyncio.sleep(PARENT_CHECK_S)
        os._exit(OK)

    async def shown() -> None:
        watching = asyncio.create_task(until_parent_ends()) if parent_pid else None  # noqa: F841
        if config is not None:
            await _watch(config, connect, partial(serve, where=where, announce=announce, tiles=background))
            return
        if run is None:
            await serve_page(_setup_page(setup or Path(), background), where, announce, tiles=background)
            return
        if (run / "results.parquet").is_file():
            await serve_page(_study_page(run), where, announce)
            return
        runs = [run] if other_run is None else [run, other_run]
        opened = [await open_live(path) if live else RecordSource(path, "recording") for path in runs]
        sources = [GrowingTimeline(source.timeline, source.run) for source in opened]
        record = record_path(run)
        is_flying = live and other_run is None and record_file.is_in_progress(record)
        send = _sender_to_flight(opened[0].timeline.area.swarm, record) if is_flying else None
        titled = dict(zip(map(str, runs), sources, strict=True))
        try:
            await serve(titled, where, announce, send, background)
        finally:
            for source in opened:
                source.close()

    try:
        asyncio.run(shown())
    except (CannotServe, record_file.RecordError) as error:
        fail([str(error)], USAGE)
    except (BusError, CannotListen) as error:
        fail([str(error)], FAILED)
    except ConfigError as error:
        fail(error.lines, USAGE)
    except SystemExit:  # Ctrl-C, the normal end
        raise typer.Exit from None


def _where(host: str, port: int, cert: Path | None, key: Path | None, config: Path | None) -> Where:
    """Return the address of the page, by default with the certificate of the swarm's operator."""
    from swarmctl.dashboard.server import LOOPBACK, Where  # noqa: PLC0415

    if (cert is None) != (key is None):
        fail(["give --cert and --key together"], USAGE)
    if cert is None and config is not None and host not in LOOPBACK:
        keys = load_roster_or_exit(config).communication.keys
        if keys is not None:
            cert, key = Path(keys) / OPERATOR / "cert.pem", Path(keys) / OPERATOR / "key.pem"
    return Where(host, port, cert, key)


def _tiles_or_exit(text: str) -> Tiles:
    from swarmctl.dashboard.tiles import TilesError, tiles_of  # noqa: PLC0415

    try:
        return tiles_of(text)
    except TilesError as error:
        fail([str(error)], USAGE)


async def _watch(config: Path, connect: str | None, serve: Callable[..., Coroutine[Any, Any, None]]) -> None:
    """Serve the page of a swarm of agents. Raises BusError."""
    from swarmctl.bus.transports.zenoh import ZenohBus  # noqa: PLC0415
    from swarmctl.cli.ground_station import ground_station_or_exit  # noqa: PLC0415
    from swarmctl.dashboard.server import GrowingTimeline  # noqa: PLC0415
    from swarmctl.dashboard.sources.bus import BusSource  # noqa: PLC0415

    scenario, swarm = load_scenario_or_exit(config), load_roster_or_exit(config)
    station = ground_station_or_exit(config, swarm, connect)
    with ZenohBus(station.network) as bus:
        now_s = asyncio.get_running_loop().time()
        source = BusSource(scenario, station.codec, now_s)
        run = partial(source.run, bus, partial(station.state_of, bus))
        send = _sender(swarm.name, config, connect)
        await serve({str(config): GrowingTimeline(source.timeline, run)}, send=send)


def _sender(
    swarm: str, config: Path | None = None, connect: str | None = None
) -> Callable[[Request], Awaitable[Sequence[VehicleAnswer]]]:
    """Return the way of commands from the page to a swarm, that of `swarmctl order` and `set`."""
    from swarmctl.cli.operator_command import send_command  # noqa: PLC0415
    from swarmctl.dashboard.orders_panel import NotSent  # noqa: PLC0415
    from swarmctl.security.files import KeyringError  # noqa: PLC0415
    from swarmctl.station.client import NoValidAnswer  # noqa: PLC0415

    async def send_or_tell(request: Request) -> Sequence[VehicleAnswer]:
        try:
            _, answers = await send_command(request, swarm if config is None else None, config, connect)
        except (BusError, KeyringError, NoValidAnswer, ValueError) as error:
            raise NotSent(str(error)) from error
        return answers

    return send_or_tell


def _sender_to_flight(swarm: str, record: Path) -> Callable[[Request], Awaitable[Sequence[VehicleAnswer]]]:
    """Return the sender of commands to a flight; after its end a later flight may have the same name."""
    from swarmctl.dashboard.orders_panel import NotSent  # noqa: PLC0415

    send = _sender(swarm)

    async def send_to_flight(request: Request) -> Sequence[VehicleAnswer]:
        try:
            is_flying = record_file.is_in_progress(record)
        except record_file.RecordError as error:
            advice = f"; nothing was sent; use `swarmctl abort --swarm {swarm}`"
            raise NotSent(extended(str(error), advice)) from error
        if not is_flying:
            text = "the process of the flight has ended; nothing was sent; open the present flight's page"
            raise NotSent(f"{record}: {text} [flight-ended]")
        return await send(request)

    return send_to_flight


def _study_page(folder: Path) -> Callable[[object], None]:
    """Return the registration of the page of a study. Raises ConfigError."""
    try:
        from swarmctl.dashboard import study_page  # noqa: PLC0415 - loads matplotlib
        from swarmctl.dashboard.sources.study import StudySource  # noqa: PLC0415
        from swarmctl.study.report import ReportError  # noqa: PLC0415
    except ModuleNotFoundError as error:
        fail([MISSING.format(error.name, "study")], USAGE)
    try:
        source = StudySource(folder)
    except ReportError as error:
        fail([str(error)], USAGE)
    return lambda _sessions: study_page.register(source)


def _setup_page(path: Path, tiles: Tiles | None) -> Callable[[Sessions], None]:
    """Return the registration of the set-up page of a configuration. Raises ConfigError."""
    from swarmctl.cli.check import problems_of  # noqa: PLC0415
    from swarmctl.cli.setup_flight import SetupFlight  # noqa: PLC0415
    from swarmctl.dashboard import setup_page  # noqa: PLC0415
    from swarmctl.dashboard.draft import Draft  # noqa: PLC0415
    from swarmctl.dashboard.flights import Flights  # noqa: PLC0415

    Draft.open(path)
    flights = Flights(partial(SetupFlight, runs=RUNS), _sender_to_flight)

    def find_problems(draft: Draft, scenario: Scenario) -> list[str]:
        return problems_of(draft.path, draft.document, scenario, RUNS)

    return lambda sessions: setup_page.register(path, sessions, find_problems, flights, tiles)
