"""`swarmctl fly`: a whole swarm in one process."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarmctl import app, preflight
from swarmctl.clock import run_virtual
from swarmctl.commands.finishing import unbroken
from swarmctl.commands.flying import RealOption, conclude, confirmed, permission, settle, terminal
from swarmctl.commands.loading import scenario_of
from swarmctl.commands.shared import (
    EXPECTED,
    USAGE,
    ConfigOption,
    OutOption,
    VerboseOption,
    fail,
    run_folder,
)


class Clock(StrEnum):
    REAL = "real"
    VIRTUAL = "virtual"


def register(cli: typer.Typer) -> None:
    cli.command()(fly)


def fly(
    config: ConfigOption,
    clock: Annotated[
        Clock,
        typer.Option(help="virtual: simulated vehicles in this process, as fast as it computes, repeatable."),
    ] = Clock.REAL,
    real: RealOption = False,
    confirm: Annotated[
        str,
        typer.Option(metavar="NAME,NAME", help="With --real, for scripts: the vehicles that may be armed."),
    ] = "",
    out_folder: OutOption = Path("runs"),
    verbose: VerboseOption = False,
) -> None:
    """Fly the swarm, simulated or real, from the ground to the last landing."""
    scenario = scenario_of(config)
    if clock is Clock.VIRTUAL and scenario.config.vehicles:
        fail(
            [f"{config}: vehicles with a URL fly in real time; `--clock virtual` is for `simulate` only"],
            USAGE,
        )
    allowed = confirmed(scenario, confirm) if real else frozenset()
    if clock is Clock.REAL and (found := list(preflight.troubles(scenario, out_folder))):
        fail(found, EXPECTED)
    folder = run_folder(out_folder, scenario.config.name)
    shown = terminal(verbose=verbose)
    settle()
    with unbroken() as run:
        with shown.shown():
            flight = app.fly(scenario, folder, shown, clock=clock.value, permission=permission(allowed))
            report = run_virtual(flight) if clock is Clock.VIRTUAL else run(flight)
        conclude(report, scenario, folder)
