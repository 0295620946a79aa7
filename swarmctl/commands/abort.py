"""`swarmctl abort`: vehicles in flight hold, return or land, whoever flies them."""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from typing import Annotated

import typer

from swarmctl import calling_back, operate
from swarmctl.answers import ordered
from swarmctl.commands.asking import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
    give,
)
from swarmctl.core.messages import GiveOrder


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
        lambda: GiveOrder(operate.meant(uav or [], everyone), how.value),
        swarm,
        config,
        connect,
        partial(ordered, how.value),
        by=calling_back.give,
    )
