"""`swarmctl router`: what the agents of a star connect to."""

from __future__ import annotations

import asyncio
import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.access import ROUTER
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.cli.calling import of_keys, roll_of
from swarmctl.cli.console import EXPECTED, USAGE, ConfigOption, fail, log, say
from swarmctl.config.communication import Communication
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import load
from swarmctl.station import router as routing


def register(cli: typer.Typer) -> None:
    cli.command("router")(route)


def route(
    config: ConfigOption,
    listen: Annotated[
        str,
        typer.Option(metavar="ENDPOINT", help="Where, instead of at communication.router: tls/0.0.0.0:7447."),
    ] = "",
    keys: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder that `swarmctl keys` made, instead of communication.keys."),
    ] = None,
    print_it: Annotated[
        bool,
        typer.Option("--print", help="Print the same for `zenohd --config`, as JSON5, and do nothing else."),
    ] = False,
) -> None:
    """Route what the agents of a swarm on many machines say, each only what it may, until Ctrl-C."""
    roll = roll_of(config)
    communication = roll.communication
    where = _where(communication, listen)
    credentials = _credentials(config, communication, where, keys)
    configuration = zenoh_config.router(where, roll.name, [*roll.names], credentials)
    if print_it:
        say(configuration.as_json5())
        return
    if credentials is None and not where.is_loopback:
        say(f"whoever reaches {where} can speak for every vehicle and give commands: nobody asks who it is")
    _run(configuration, roll.names)


def _where(communication: Communication, listen: str) -> BusEndpoint:
    if not listen and communication.router is None:
        fail(["where? give communication.router an endpoint, such as tcp/HOST:7447, or --listen"], USAGE)
    try:
        return parse_endpoint(listen or communication.router or "")
    except ValueError as error:
        fail([f"--listen: {error}"], USAGE)


def _credentials(
    config: Path, communication: Communication, where: BusEndpoint, keys: Path | None
) -> Credentials | None:
    if not where.is_certified:
        if keys is not None:
            fail([f"--keys: {where} uses none; listen at tls/ or quic/ instead of tcp/"], USAGE)
        return None
    folder = keys if keys is not None else None if communication.keys is None else Path(communication.keys)
    if folder is None:
        fail([f"{where} needs certificates: give --keys the folder that `swarmctl keys` made"], USAGE)
    try:
        return load(folder, ROUTER, dt.datetime.now(dt.UTC)).credentials
    except KeyringError as error:
        fail([str(error)] if keys is not None else of_keys(config, [str(error)]), EXPECTED)


def _run(configuration: Configuration, names: Mapping[int, str]) -> None:
    try:
        asyncio.run(routing.run(configuration, log, names))
    except BusError as error:
        fail([str(error)], EXPECTED)
