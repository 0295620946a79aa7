"""`swarmctl set`: new w and firing strengths for vehicles in flight."""

from __future__ import annotations

from typing import Annotated

import typer

from swarmctl.cli.console import USAGE, fail, split_items
from swarmctl.cli.operator_command import (
    AllOption,
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    UavsOption,
    send_or_exit,
)
from swarmctl.core.messages import CommunicationRange, SetWeights, VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.report.answers import weights_line
from swarmctl.station import client


def set_weights(
    uav: UavsOption = None,
    all_vehicles: AllOption = False,
    w: Annotated[
        float | None, typer.Option("--w", help="Weight of exposure: 0 shortest route, 1 least exposed route.")
    ] = None,
    firing_strength: Annotated[
        str,
        typer.Option(
            metavar="D,N1,N2",
            help="Firing strengths over a hostile's cell, the 4 adjacent cells and the 4 diagonal cells, "
            "such as 0.7,0.3,0.1.",
        ),
    ] = "",
    reach: Annotated[
        str | None,
        typer.Option(
            "--range", metavar="N|all", help="Send to the N nearest vehicles, in a simulated swarm only."
        ),
    ] = None,
    behaviours: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=WEIGHT,…",
            callback=split_items,
            help="Weights of a group's behaviours, such as goal=1,threat=0.8.",
        ),
    ] = None,
    swarm: SwarmOption = None,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
) -> None:
    """Change w and the firing strengths of vehicles in flight, from their next plans on.

    --range changes the range of communication at once, and --behaviours the flight of a group with the
    approach `behavioural`. There the weights of the leader count for all members.
    """
    strengths = _strengths_or_exit(firing_strength)
    weights = _behaviours_or_exit(behaviours or [])
    wanted: CommunicationRange | None = None if reach is None else _range_or_exit(reach)

    def command() -> SetWeights:
        uavs = client.chosen_vehicles(uav, all_vehicles)
        return SetWeights(uavs, w, strengths, wanted, behaviours=weights)

    def line(answer: VehicleAnswer) -> str:
        text = weights_line(
            w, None if strengths is None else FiringStrength(*strengths), answer, wanted, weights
        )
        if answer.outcome != "taken" or answer.note or (w is None and strengths is None):
            return text
        # The vehicle may stay on its route, or arrive before a new plan.
        return f"{text}; plan {answer.from_plan} is made only if another route is better"

    send_or_exit(command, swarm, config, connect, line)


def _strengths_or_exit(text: str) -> tuple[float, float, float] | None:
    if not text:
        return None
    try:
        direct, first_neighbour, second_neighbour = map(float, text.split(","))
    except ValueError:
        fail([f"--firing-strength {text}: expected three numbers, such as 0.7,0.3,0.1"], USAGE)
    return direct, first_neighbour, second_neighbour


def _behaviours_or_exit(parts: list[str]) -> dict[str, float]:
    found = {}
    for part in parts:
        name, _, weight = part.partition("=")
        try:
            found[name.strip()] = float(weight)
        except ValueError:
            fail([f"--behaviours {part}: expected a name and a weight, such as threat=0.8"], USAGE)
    return found


def _range_or_exit(text: str) -> CommunicationRange:
    if text == "all":
        return "all"
    if not text.isdecimal():
        fail([f"--range {text}: expected a number of vehicles, or all"], USAGE)
    return int(text)
