"""`swarmctl abort`: end the flight of vehicles of `swarmctl fly` and `swarmctl agent`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from swarmctl.cli.operator_command import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
)
from swarmctl.cli.order import order


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
    order(manoeuvre, uav, all_vehicles=all_vehicles, config=config, connect=connect, swarm=swarm)
