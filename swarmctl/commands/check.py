"""`swarmctl check`: what is wrong with a configuration."""

from __future__ import annotations

from pathlib import Path

import typer

from swarmctl import preflight
from swarmctl.commands.shared import EXPECTED, ConfigOption, OutOption, fail, out, scenario_of


def register(cli: typer.Typer) -> None:
    cli.command()(check)


def check(config: ConfigOption, out_folder: OutOption = Path("runs")) -> None:
    """Say everything that is wrong with a configuration, here and now, without starting anything."""
    scenario = scenario_of(config)
    found = list(preflight.troubles(scenario, out_folder))
    if found:
        fail(found, EXPECTED)
    n, grid = len(scenario.specs), scenario.grid
    text = (
        f"{config}: good. {n} vehicle{'s' if n != 1 else ''}, {grid.rows} × {grid.cols} cells of "
        f"{grid.cell_size_m:g} m, {scenario.prior.count} hostiles announced."
    )
    out.print(text, highlight=False, soft_wrap=True)
