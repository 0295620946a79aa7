"""`swarmctl order`: launch, resume, hold, return or land vehicles, mainly vehicles of `swarmctl agent`."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from swarmctl.cli.console import split_items
from swarmctl.cli.operator_command import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
    send_or_exit,
)
from swarmctl.core.messages import GiveOrder, OrderKind
from swarmctl.report.answers import order_line
from swarmctl.station import client


def order(
    kind: Annotated[OrderKind, typer.Argument(metavar="launch|resume|hold|return|land", show_default=False)],
    uav: UavsOption = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            "--ignore",
            metavar="NAME,…",
            callback=split_items,
            help="Launch although the route conflicts with the flights of these vehicles (name or system "
            "id). The last resort in flight still covers these vehicles.",
            show_default=False,
        ),
    ] = None,
    all_vehicles: AllOption = False,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    swarm: SwarmOption = None,
) -> None:
    """Order vehicles of a running flight to launch, resume, hold, return or land.

    The order reaches the vehicles of `swarmctl agent` and of `swarmctl fly`. `fly` refuses an order to launch
    real vehicles. An order to hold, return or land prevents the take-off of a vehicle on the ground until an
    order to launch. In flight the same order ends the vehicle's route; after a hold, an order to resume lets
    the vehicle plan a new route from its position. A launch waits on the
    ground for 3 min at most while another vehicle conflicts with the route. After 3 min the order to launch
    expires; give the order again.
    """
    send_or_exit(
        lambda: GiveOrder(client.chosen_vehicles(uav, all_vehicles), kind, ignore=tuple(ignore or ())),
        swarm,
        config,
        connect,
        partial(order_line, kind),
    )
