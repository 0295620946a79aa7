"""`swarmctl router`: the router of a star network."""

from __future__ import annotations

import asyncio
import datetime as dt
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.access import ROUTER
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.cli.configuration import fail_for_keys, load_roster_or_exit
from swarmctl.cli.console import FAILED, USAGE, ConfigOption, fail, log, say
from swarmctl.config.communication import Communication
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import load_keyring
from swarmctl.station import router as routing


def router(
    config: ConfigOption,
    listen: Annotated[
        str,
        typer.Option(
            metavar="ENDPOINT",
            help="Endpoint to listen at, instead of communication.router, such as tls/0.0.0.0:7447.",
        ),
    ] = "",
    keys: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of `swarmctl keys`, instead of communication.keys."),
    ] = None,
    prints_only: Annotated[
        bool,
        typer.Option("--print", help="Print the configuration for `zenohd --config` as JSON5, and exit."),
    ] = False,
) -> None:
    """Route the messages of a swarm on many machines, with access control, until Ctrl-C."""
    swarm = load_roster_or_exit(config)
    communication = swarm.communication
    endpoint = _endpoint(communication, listen)
    credentials = _credentials(config, communication, endpoint, keys)
    configuration = zenoh_config.router(endpoint, swarm.name, [*swarm.names], credentials)
    if prints_only:
        say(configuration.as_json5())
        return
    if credentials is None and not endpoint.is_loopback:
        say(
            f"{endpoint} is open to other machines without authentication: other machines can send as any "
            "vehicle; use tls/ or quic/ with `swarmctl keys` [open-endpoint]"
        )
    common_names = {} if credentials is None else credentials.common_names
    try:
        asyncio.run(routing.run(configuration, log, swarm.names, common_names))
    except BusError as error:
        fail([str(error)], FAILED)


def _endpoint(communication: Communication, listen: str) -> BusEndpoint:
    if not listen and communication.router is None:
        fail(["no endpoint: set communication.router, such as tcp/HOST:7447, or give --listen"], USAGE)
    try:
        return parse_endpoint(listen or communication.router or "")
    except ValueError as error:
        fail([f"--listen: {error}"], USAGE)


def _credentials(
    config: Path, communication: Communication, endpoint: BusEndpoint, keys: Path | None
) -> Credentials | None:
    if not endpoint.is_certified:
        if keys is not None:
            fail([f"--keys: {endpoint} uses no keys; listen at tls/ or quic/ instead of tcp/"], USAGE)
        return None
    folder = keys if keys is not None else None if communication.keys is None else Path(communication.keys)
    if folder is None:
        text = f"{endpoint} needs certificates: make keys with `swarmctl keys`, and give their folder"
        fail([f"{text} with --keys or as communication.keys [no-certificates]"], USAGE)
    try:
        return load_keyring(folder, ROUTER, dt.datetime.now(dt.UTC)).credentials
    except KeyringError as error:
        fail_for_keys(config if keys is None else None, error)
