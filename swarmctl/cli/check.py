"""`swarmctl check`: what is wrong with a configuration."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path

import typer

from swarmctl.bus.transports.access import OPERATOR, ROUTER, name_of
from swarmctl.cli.calling import of_keys
from swarmctl.cli.console import ConfigOption, OutOption, out
from swarmctl.cli.loading import require_fit, scenario_of
from swarmctl.config.scenario import Scenario
from swarmctl.security import inspection


def register(cli: typer.Typer) -> None:
    cli.command()(check)


def check(config: ConfigOption, out_folder: OutOption = Path("runs")) -> None:
    """Say everything that is wrong with a configuration, here and now, without starting anything."""
    scenario = scenario_of(config)
    require_fit(config, scenario, out_folder, of_keys(config, _keys(scenario)))
    n, grid = len(scenario.specs), scenario.grid
    text = (
        f"{config}: good. {n} vehicle{'s' if n != 1 else ''}, {grid.rows} × {grid.cols} cells of "
        f"{grid.cell_size_m:g} m, {scenario.prior.count} hostiles announced."
    )
    out.print(text, highlight=False, soft_wrap=True)
    real = [spec.name for spec in scenario.specs if not spec.simulated]
    if real and scenario.config.preflight.endurance_s is None:
        text = f"preflight.endurance_s is not set: without it {', '.join(real)} fails the check `battery`"
        out.print(f"{text}, unless the built-in simulator plays it", highlight=False, soft_wrap=True)


def _keys(scenario: Scenario) -> Iterator[str]:
    """What the commands of a swarm on many machines would say of its keys."""
    communication = scenario.config.communication
    if communication.keys is None:
        return
    names = [name_of(spec.sysid) for spec in scenario.swarm] + [OPERATOR]
    names += [ROUTER] if communication.router is not None else []
    yield from inspection.troubles(Path(communication.keys), names, dt.datetime.now(dt.UTC))
