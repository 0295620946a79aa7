"""What commands to vehicles in flight have in common: who is meant, where they are, what they answered."""

from __future__ import annotations

import asyncio
import datetime as dt
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.cli.calling import of_keys, roll_of
from swarmctl.cli.console import EXPECTED, USAGE, err, fail, out
from swarmctl.config import joining
from swarmctl.config.roster import Roster
from swarmctl.core.messages import OperatorAnswer, Request, VehicleAnswer
from swarmctl.security import requests
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import Keyring
from swarmctl.station import client
from swarmctl.station.client import Station

UavsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--uav", metavar="NAME", help="A vehicle's name or system id; may be repeated.", show_default=False
    ),
]
AllOption = Annotated[bool, typer.Option("--all", help="Every vehicle of the swarm.")]
SwarmOption = Annotated[str | None, typer.Option(help="Its name, where more than one flies on this machine.")]
FlyingConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        "-c",
        help="The swarm's configuration, instead of its name; with communication.router or mesh, "
        "each vehicle's own agent is asked.",
    ),
]
ConnectOption = Annotated[
    str | None,
    typer.Option(
        metavar="tcp/HOST:PORT", help="Where the flight, or the router, listens, if not on this machine."
    ),
]
Giving = Callable[[Station, Request, Credentials | None, client.Seals], Coroutine[Any, Any, OperatorAnswer]]
"""how a command is given"""


def give(
    command: Callable[[], Request],
    swarm: str | None,
    config: Path | None,
    connect: str | None,
    told: Callable[[VehicleAnswer], str],
    by: Giving = client.give,
) -> None:
    """Give it, say what became of it, and leave with an exit code. `command` raises ValueError."""
    try:
        wanted = command()
        station, keyring = _station(swarm, config, connect)
        credentials = joining.certified(station.endpoint, keyring)
        seals = client.UNSEALED if keyring is None else Seals(station.swarm, keyring)
        answer = asyncio.run(by(station, wanted, credentials, seals))
    except KeyringError as error:
        fail([str(error)] if config is None else of_keys(config, [str(error)]), EXPECTED)
    except (BusError, client.NoAnswer) as error:
        fail([str(error)], EXPECTED)
    except ValueError as error:
        fail([str(error)], USAGE)
    _say(wanted, answer, station, told)


@dataclass(frozen=True, slots=True)
class Seals:
    """Signs what the operator gives, and tells by their signatures what the vehicles answer."""

    swarm: str
    keyring: Keyring

    def close(self, key: str, command: bytes) -> bytes:
        return requests.seal(self.swarm, key, command, time.time(), self.keyring.signer.sign)

    def open(self, uav: int, key: str, asked: bytes, data: bytes) -> bytes:
        return requests.open_answer(self.swarm, key, asked, data, partial(self.keyring.verify, uav))


def station_of(swarm: str | None, known: Roster | None, connect: str | None) -> Station:
    """The flight that is meant, as `operate.find` has it. Raises Unclear and BusError."""
    if known is None:
        return client.find(swarm, None, connect)
    return client.find(swarm, known, connect, known.names)


def _station(swarm: str | None, config: Path | None, connect: str | None) -> tuple[Station, Keyring | None]:
    """Raises BusError, KeyringError and ValueError."""
    known = None if config is None else roll_of(config)
    station = station_of(swarm, known, connect)
    # Who flies all in one process, on this machine, asks for no seal.
    if known is None or not station.agents:
        return station, None
    return station, joining.keyring_of(known, OPERATOR, dt.datetime.now(dt.UTC))


def _say(
    wanted: Request, answer: OperatorAnswer, station: Station, told: Callable[[VehicleAnswer], str]
) -> None:
    if answer.refused:
        fail([f"{station.swarm} refused: {answer.refused}"], EXPECTED)
    for vehicle in answer.vehicles:
        where = out if vehicle.outcome == "taken" else err
        where.print(told(vehicle), highlight=False, markup=False, soft_wrap=True)
    if client.has_failed(wanted, answer):
        raise typer.Exit(EXPECTED)
