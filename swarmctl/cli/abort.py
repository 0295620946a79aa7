"""`swarmctl abort`: end the flight of vehicles of `swarmctl fly` and `swarmctl agent`."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Literal

import msgspec
import typer

from swarmctl.bus import directory
from swarmctl.bus.authentication import RequestSigning
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.cli.console import err, say
from swarmctl.cli.operator_command import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
    send_or_exit,
)
from swarmctl.core.messages import GiveOrder, OperatorAnswer, Request, VehicleAnswer
from swarmctl.core.operator_text import resolve_vehicles
from swarmctl.report.answers import order_line
from swarmctl.station import client, recall
from swarmctl.station.client import FlightEndpoints


def _print_running() -> None:
    """Print this user's flights on this machine, with their ages."""
    with contextlib.suppress(BusError):  # reported by the search for the flight
        for flight in directory.running_swarms():
            say(f"found {client.describe(flight)}", console=err)


def abort(
    manoeuvre: Annotated[
        Literal["hold", "return", "land"], typer.Argument(metavar="hold|return|land", show_default=False)
    ],
    uav: UavsOption = None,
    all_vehicles: AllOption = False,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    swarm: SwarmOption = None,
) -> None:
    """End the flight of vehicles: hold in place, return, or land in place.

    The command reaches vehicles of `swarmctl fly` and of `swarmctl agent`. A returning vehicle holds until
    its turn, so that return routes do not conflict. A repeated command changes nothing for vehicles that
    already follow the command.
    """
    if swarm is None and config is None and connect is None:
        _print_running()
    send_or_exit(
        lambda: GiveOrder(client.chosen_vehicles(uav or [], all_vehicles), manoeuvre),
        swarm,
        config,
        connect,
        partial(order_line, manoeuvre),
        send=send_to_valid_names,
    )


async def send_to_valid_names(
    flight: FlightEndpoints,
    command: Request,
    credentials: Credentials | None,
    signing: RequestSigning,
) -> OperatorAnswer:
    """Send a command to all vehicles with valid names; unknown names become refused answers.

    A misspelt name must not keep the other vehicles in the air. Raises the errors of `recall.send`.
    """
    words = tuple(map(str, command.uavs or ()))
    if flight.agents:  # each agent answers for one vehicle, and the configuration has all names
        problems = {word: why for word in words if (why := _name_problem(word, flight.agents))}
        valid = tuple(word for word in words if word not in problems)
        if not problems or not valid:
            return await recall.send(flight, command, credentials, signing)
        answer = await recall.send(flight, _addressed(command, valid), credentials, signing)
        return _with_refused(answer, problems)
    answer = await recall.send(flight, command, credentials, signing)
    if not answer.refused or len(words) < 2:
        return answer
    answers = {
        word: await recall.send(flight, _addressed(command, (word,)), credentials, signing) for word in words
    }
    vehicles = tuple(vehicle for each in answers.values() for vehicle in each.vehicles)
    problems = {
        word: each.refused.removeprefix("nothing was changed: ")
        for word, each in answers.items()
        if each.refused
    }
    return _with_refused(OperatorAnswer(vehicles), problems) if vehicles else answer


def _addressed(command: Request, words: tuple[str, ...]) -> Request:
    return msgspec.structs.replace(command, uavs=words)


def _with_refused(answer: OperatorAnswer, problems: dict[str, str]) -> OperatorAnswer:
    refused = (VehicleAnswer(0, word, "refused", note=why) for word, why in problems.items())
    return msgspec.structs.replace(answer, vehicles=(*answer.vehicles, *refused))


def _name_problem(word: str, names: Mapping[int, str]) -> str:
    try:
        resolve_vehicles([word], names)
    except ValueError as error:
        return str(error)
    return ""
