"""`swarmctl set`: new weights for vehicles in flight."""

from __future__ import annotations

from typing import Annotated

import typer

from swarmctl.cli.asking import AllOption, ConnectOption, FlyingConfigOption, SwarmOption, UavsOption, give
from swarmctl.core.messages import SetWeights, VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.report.answers import told
from swarmctl.station import client


def register(cli: typer.Typer) -> None:
    cli.command("set")(set_weights)


def set_weights(
    uav: UavsOption = None,
    everyone: AllOption = False,
    w: Annotated[
        float | None, typer.Option("--w", help="Distance anxiety: 0 the shortest route, 1 the least exposed.")
    ] = None,
    firing_strength: Annotated[
        str,
        typer.Option(metavar="D,N1,N2", help="The three below in one: 0.7,0.3,0.1."),
    ] = "",
    direct: Annotated[float | None, typer.Option(help="Firing strength over a hostile's cell.")] = None,
    first_neighbour: Annotated[float | None, typer.Option(help="Over the 4 nearest cells.")] = None,
    second_neighbour: Annotated[float | None, typer.Option(help="Over the 4 diagonal cells.")] = None,
    swarm: SwarmOption = None,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
) -> None:
    """Change w and the firing strengths of vehicles in flight, from their next plans on."""

    def command() -> SetWeights:
        strengths = client.strengths(firing_strength, (direct, first_neighbour, second_neighbour))
        return SetWeights(client.meant(uav or [], everyone), w, strengths)

    def line(answer: VehicleAnswer) -> str:
        strengths = client.strengths(firing_strength, (direct, first_neighbour, second_neighbour))
        said = told(w, None if strengths is None else FiringStrength(*strengths), answer)
        if answer.outcome != "taken":
            return said
        # What keeps its route is not planned anew, and a vehicle may be over its goal before.
        return f"{said}; plan {answer.from_plan} follows if another route is better"

    give(command, swarm, config, connect, line)
