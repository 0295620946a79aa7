"""`swarmctl order`: what vehicles flown by agents of their own are to do now."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from swarmctl import operate
from swarmctl.answers import ordered
from swarmctl.commands.asking import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
    give,
)
from swarmctl.core.events import Order
from swarmctl.core.messages import GiveOrder


def register(cli: typer.Typer) -> None:
    cli.command("order")(order)


def order(
    what: Annotated[Order, typer.Argument(metavar="launch|hold|return|land", show_default=False)],
    uav: UavsOption = None,
    everyone: AllOption = False,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    swarm: SwarmOption = None,
) -> None:
    """Order vehicles flown by `swarmctl agent` to launch, hold, return or land.

    On the ground, hold, return and land keep a vehicle there until it is ordered to launch. After each of
    them in flight it takes up its route no more.
    """
    give(
        lambda: GiveOrder(operate.meant(uav or [], everyone), what.value),
        swarm,
        config,
        connect,
        partial(ordered, what.value),
    )
