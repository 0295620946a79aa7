"""`swarmctl preflight`: whether every vehicle might be armed now, without arming any."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import typer

from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.routes import SaidOnce
from swarmctl.cli.console import EXPECTED, INTERRUPTED, USAGE, ConfigOption, VerboseOption, err, fail, out
from swarmctl.cli.finishing import unbroken
from swarmctl.cli.fly import Clock, ClockOption
from swarmctl.cli.flying import WaiveOption, terminal, waivers_of
from swarmctl.cli.loading import require_fit, scenario_of
from swarmctl.config.scenario import Scenario
from swarmctl.flight import app
from swarmctl.flight.gc_tuning import settle
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.preflight import report
from swarmctl.report.outcome import Report


def register(cli: typer.Typer) -> None:
    cli.command()(preflight)


def preflight(
    config: ConfigOption,
    clock: ClockOption = Clock.REAL,
    waive: WaiveOption = None,
    verbose: VerboseOption = False,
) -> None:
    """Connect, check every vehicle as `fly` does before it arms, and print what was found; arms nothing.

    The fence and the first mission are uploaded; no parameter is set, whatever the configuration lets `fly`
    set.
    """
    scenario = scenario_of(config)
    if clock is Clock.VIRTUAL and scenario.config.vehicles:
        fail([f"{config}: `--clock virtual` is for `simulate` only; leave it away"], USAGE)
    manner = replace(app.ALL_IN_ONE, launch="never", waivers=waivers_of(waive, scenario))
    with tempfile.TemporaryDirectory(prefix="swarmctl-preflight-") as name:
        folder = Path(name)
        if clock is Clock.REAL:
            require_fit(config, scenario, folder)
        shown = terminal(verbose=verbose)
        settle()
        with unbroken() as run, shown.shown():
            flight = app.fly(
                scenario,
                folder,
                shown,
                clock=clock.value,
                permission=lambda _: None,
                bus=MemoryBus(SaidOnce(shown.say)),
                manner=manner,
            )
            checks = run_virtual(flight) if clock is Clock.VIRTUAL else run(flight)
    _conclude(checks, scenario)


def _conclude(checks: Report, scenario: Scenario) -> None:
    if checks.bug is not None:
        raise checks.bug
    if checks.checked:
        out.print(report.overview(checks.checked))
    if not all(found.finding.ok for findings in checks.checked.values() for found in findings):
        out.print(report.failures(checks.checked))
    told = {str(found) for findings in checks.checked.values() for found in findings}
    for text in checks.trouble:
        if text not in told:  # else the tables say it
            err.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    if checks.ended in ("stopped", "abandoned"):
        raise typer.Exit(INTERRUPTED)
    if checks.trouble or len(checks.checked) < len(scenario.specs):
        raise typer.Exit(EXPECTED)
    out.print("every vehicle might be armed; nothing was", highlight=False)
