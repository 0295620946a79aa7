"""`swarmctl fly`: a whole swarm in one process."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.calling import of_keys
from swarmctl.cli.console import EXPECTED, USAGE, ConfigOption, OutOption, VerboseOption, fail, run_folder
from swarmctl.cli.finishing import unbroken
from swarmctl.cli.flying import (
    ForwardOption,
    RealOption,
    WaiveOption,
    conclude,
    confirmed,
    forwarded,
    permission,
    terminal,
    waivers_of,
)
from swarmctl.cli.loading import require_fit, scenario_of
from swarmctl.config.scenario import Scenario
from swarmctl.flight import app, evidence_log
from swarmctl.flight.gc_tuning import settle
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.evidence.book import Signer
from swarmctl.security.files import KeyringError


class Clock(StrEnum):
    REAL = "real"
    VIRTUAL = "virtual"


ClockOption = Annotated[
    Clock,
    typer.Option(help="virtual: simulated vehicles in this process, as fast as it computes, repeatable."),
]


def register(cli: typer.Typer) -> None:
    cli.command()(fly)


def fly(
    config: ConfigOption,
    clock: ClockOption = Clock.REAL,
    real: RealOption = False,
    confirm: Annotated[
        str,
        typer.Option(metavar="NAME,NAME", help="With --real, for scripts: the vehicles that may be armed."),
    ] = "",
    forward: ForwardOption = None,
    waive: WaiveOption = None,
    out_folder: OutOption = Path("runs"),
    verbose: VerboseOption = False,
) -> None:
    """Fly the swarm, simulated or real, from the ground to the last landing."""
    scenario = forwarded(scenario_of(config), forward or [])
    if clock is Clock.VIRTUAL and scenario.config.vehicles:
        fail(
            [f"{config}: vehicles with a URL fly in real time; `--clock virtual` is for `simulate` only"],
            USAGE,
        )
    if clock is Clock.VIRTUAL and scenario.config.simulate and scenario.config.simulate.link == "mavsdk":
        fail(
            [
                f"{config}: simulate.link: MAVSDK keeps to the machine's clock; fly in real time (without "
                "`--clock virtual`) or with `link: direct`"
            ],
            USAGE,
        )
    allowed = confirmed(scenario, confirm) if real else frozenset()
    if clock is Clock.REAL:
        require_fit(config, scenario, out_folder)
    manner = replace(app.ALL_IN_ONE, signer=_signer(config, scenario), waivers=waivers_of(waive, scenario))
    folder = run_folder(out_folder, scenario.config.name)
    shown = terminal(verbose=verbose)
    settle()
    with unbroken() as run:
        with shown.shown():
            flight = app.fly(
                scenario, folder, shown, clock=clock.value, permission=permission(allowed), manner=manner
            )
            report = run_virtual(flight) if clock is Clock.VIRTUAL else run(flight)
        conclude(report, scenario, folder)


def _signer(config: Path, scenario: Scenario) -> Signer | None:
    try:
        return evidence_log.operators_witness(scenario)
    except KeyringError as error:
        fail(of_keys(config, [str(error)]), EXPECTED)
