"""`swarmctl abort`: vehicles in flight hold, return or land, whoever flies them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from functools import partial
from typing import Annotated

import msgspec
import typer

from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.cli.asking import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    Giving,
    SwarmOption,
    UavsOption,
    give,
)
from swarmctl.core.messages import GiveOrder, OperatorAnswer, Request, VehicleAnswer
from swarmctl.core.texts import meant_by
from swarmctl.report.answers import ordered
from swarmctl.station import client, recall
from swarmctl.station.client import Seals, Station


class How(StrEnum):
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


def register(cli: typer.Typer) -> None:
    cli.command("abort")(abort)


def abort(
    how: Annotated[How, typer.Argument(metavar="hold|return|land", show_default=False)],
    uav: UavsOption = None,
    everyone: AllOption = False,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    swarm: SwarmOption = None,
) -> None:
    """End the flight of vehicles: hold where they are, return, or land where they are.

    Reaches a swarm that `swarmctl fly` flies as well as vehicles flown by `swarmctl agent`. Who returns holds
    until its turn, so that no two meet. To give it again changes nothing for those that do so already.
    """
    give(
        lambda: GiveOrder(client.meant(uav or [], everyone), how.value),
        swarm,
        config,
        connect,
        partial(ordered, how.value),
        by=partial(whoever_is_there, recall.give),
    )


async def whoever_is_there(
    by: Giving, station: Station, command: Request, credentials: Credentials | None, seals: Seals
) -> OperatorAnswer:
    """A name that is misspelt keeps nobody else in the air: the others are ordered, and it is said.

    `by` gives the command. Raises what that raises.
    """
    words = tuple(map(str, command.uavs or ()))
    if station.agents:  # each answers for itself, and all are known here
        wrong = {word: why for word in words if (why := _why_nobody(word, station.agents))}
        good = tuple(word for word in words if word not in wrong)
        if not wrong or not good:
            return await by(station, command, credentials, seals)
        answer = await by(station, _to(command, good), credentials, seals)
        return _with(answer, wrong)
    answer = await by(station, command, credentials, seals)
    if not answer.refused or len(words) < 2:
        return answer
    answers = {word: await by(station, _to(command, (word,)), credentials, seals) for word in words}
    vehicles = tuple(vehicle for each in answers.values() for vehicle in each.vehicles)
    wrong = {
        word: each.refused.removeprefix("nothing was changed: ")
        for word, each in answers.items()
        if each.refused
    }
    return _with(OperatorAnswer(vehicles), wrong) if vehicles else answer


def _to(command: Request, words: tuple[str, ...]) -> Request:
    return msgspec.structs.replace(command, uavs=words)


def _with(answer: OperatorAnswer, wrong: dict[str, str]) -> OperatorAnswer:
    said = (VehicleAnswer(0, word, "refused", note=why) for word, why in wrong.items())
    return msgspec.structs.replace(answer, vehicles=(*answer.vehicles, *said))


def _why_nobody(word: str, names: Mapping[int, str]) -> str:
    try:
        meant_by([word], names)
    except ValueError as error:
        return str(error)
    return ""
