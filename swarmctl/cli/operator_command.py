"""Commands to vehicles in flight: options, search for the flight, authentication, and answers."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.bus import directory
from swarmctl.bus.authentication import RequestSigning
from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.base import BusError
from swarmctl.cli.configuration import fail_for_keys, load_roster_or_exit
from swarmctl.cli.console import FAILED, USAGE, err, fail, out, say, split_items
from swarmctl.config import joining
from swarmctl.core.messages import Request, VehicleAnswer
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import Keyring
from swarmctl.security.requests import OperatorSigning, TokenSigning
from swarmctl.security.token import Token, token_of_environment
from swarmctl.station import client, commands
from swarmctl.station.client import FlightEndpoints

UavsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--uav",
        metavar="NAME,…",
        callback=split_items,
        help="The vehicles, by name or system id.",
        show_default=False,
    ),
]
AllOption = Annotated[bool, typer.Option("--all", help="All vehicles of the swarm.")]
SwarmOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="The swarm's name, if several swarms fly on this machine.")
]
FlyingConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        "-c",
        metavar="FILE",
        help="The swarm's configuration, instead of --swarm. With communication.router or mesh the command "
        "goes to each vehicle's own agent.",
    ),
]
ConnectOption = Annotated[
    str | None,
    typer.Option(
        metavar="tcp/HOST:PORT",
        help="Endpoint of the flight or the router: on another machine, or of one of several flights with "
        "the same name.",
    ),
]


def send_or_exit(
    make_request: Callable[[], Request],
    swarm: str | None,
    config: Path | None,
    connect: str | None,
    line_of: Callable[[VehicleAnswer], str],
) -> None:
    """Send a command and print the answers; exit on a failure, or if a vehicle did not take the command."""
    with exit_on_failure(config):
        request = make_request()
        flight, answers = asyncio.run(send_command(request, swarm, config, connect))
    if swarm is None and config is None and connect is None:
        say(f"the only flight on this machine: {flight.swarm} at {flight.endpoint}", console=err)
    for vehicle in answers:
        say(line_of(vehicle), console=out if vehicle.outcome == "taken" else err)
    if commands.has_failed(request, answers):
        raise typer.Exit(FAILED)


@contextlib.contextmanager
def exit_on_failure(config: Path | None) -> Iterator[None]:
    """Exit with the error of a command to a flight: of usage, of keys, of the search, or of the answer."""
    try:
        yield
    except KeyringError as error:
        fail_for_keys(config, error)
    except (BusError, client.NoValidAnswer) as error:
        fail([str(error)], FAILED)
    except ValueError as error:
        fail([str(error)], USAGE)


async def send_command(
    request: Request, swarm: str | None, config: Path | None, connect: str | None
) -> tuple[FlightEndpoints, commands.Answers]:
    """Find the flight and send a command to it; return both the flight and the answers.

    Raises BusError, KeyringError, client.NoValidAnswer and ValueError.
    """
    flight, keyring = _find_flight_and_keys(swarm, config, connect)
    credentials = joining.credentials_for(flight.endpoint, keyring)
    return flight, await commands.send(flight, request, credentials, signing_for(flight, keyring))


def signing_for(flight: FlightEndpoints, keyring: Keyring | None) -> RequestSigning:
    """Return the signing of requests to a flight: by the operator's keys, or else by the receivers' tokens.

    Raises BusError for an unusable folder of running swarms, and KeyringError for an unusable token file.
    """
    if keyring is not None:
        return OperatorSigning(flight.swarm, keyring, time.time)
    if flight.agents:
        tokens = {uav: Token(text) for uav, text in directory.agent_tokens(flight.swarm).items()}
        return TokenSigning(flight.swarm, tokens, token_of_environment(), time.time)
    text = client.local_token(flight)
    token = token_of_environment() if text is None else Token(text)
    return TokenSigning(flight.swarm, {}, token, time.time)


def _find_flight_and_keys(
    swarm: str | None, config: Path | None, connect: str | None
) -> tuple[FlightEndpoints, Keyring | None]:
    """Return the flight, and the operator's keys if the flight needs keys.

    Raises BusError, KeyringError and ValueError.
    """
    roster = None if config is None else load_roster_or_exit(config)
    flight = client.find(swarm, roster, connect)
    # A process that flies all vehicles has a token instead of keys.
    if roster is None or not flight.agents:
        return flight, None
    return flight, joining.keyring_of(roster, OPERATOR, dt.datetime.now(dt.UTC))
