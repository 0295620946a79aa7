"""`swarmctl order`: what vehicles flown by agents of their own are to do now."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from swarmctl.cli.asking import AllOption, ConnectOption, FlyingConfigOption, SwarmOption, UavsOption, give
from swarmctl.core.events import Order
from swarmctl.core.messages import GiveOrder
from swarmctl.report.answers import ordered
from swarmctl.station import client


def register(cli: typer.Typer) -> None:
    cli.command("order")(order)


def order(
    what: Annotated[Order, typer.Argument(metavar="launch|hold|return|land", show_default=False)],
    uav: UavsOption = None,
    past: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Launch though this vehicle (or system id) says it flies in the way; may be repeated. It is "
            "kept clear of in the air as ever.",
            show_default=False,
        ),
    ] = None,
    everyone: AllOption = False,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    swarm: SwarmOption = None,
) -> None:
    """Order vehicles flown by `swarmctl agent` to launch, hold, return or land.

    Reaches those of a running `swarmctl fly` as well, which launches real ones only by itself.
    On the ground, hold, return and land keep a vehicle there until it is ordered to launch. After each of
    them in flight it takes up its route no more. Who is to launch waits on the ground for who would be in
    its way, for three minutes at most, and is then not launched; ordered again it waits anew.
    """
    give(
        lambda: GiveOrder(client.meant(uav or [], everyone), what.value, past=tuple(past or ())),
        swarm,
        config,
        connect,
        partial(ordered, what.value),
    )
