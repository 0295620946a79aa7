"""`swarmctl preflight`: the checks before arming, without arming a vehicle."""

from __future__ import annotations

import tempfile
from pathlib import Path

import typer

from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.subscriptions import ReportOnce
from swarmctl.cli.configuration import config_or_example, load_scenario_or_exit, require_flyable
from swarmctl.cli.console import (
    FAILED,
    INTERRUPTED,
    ConfigOrExampleOption,
    ExampleOption,
    VerboseOption,
    out,
    say,
    say_error,
)
from swarmctl.cli.flights import (
    WaiveOption,
    parse_waivers_or_exit,
    require_simulated_clock,
    terminal,
    uninterrupted,
)
from swarmctl.cli.fly import ClockOption
from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace
from swarmctl.flight import app
from swarmctl.flight.run import DEFAULT_OPTIONS
from swarmctl.preflight import report
from swarmctl.report.outcome import FlightReport


def preflight(
    config: ConfigOrExampleOption = None,
    example: ExampleOption = None,
    clock: ClockOption = "real",
    waive: WaiveOption = None,
    verbose: VerboseOption = False,
) -> None:
    """Run the preflight checks of `fly` on every vehicle and print the results, without arming.

    The fence and the first mission are uploaded. No parameter is set, even if the configuration allows `fly`
    to set parameters.
    """
    config = config_or_example(config, example)
    scenario = load_scenario_or_exit(config)
    if clock == "virtual":
        require_simulated_clock(config, scenario)
    options = replace(DEFAULT_OPTIONS, launch="never", waivers=parse_waivers_or_exit(waive, scenario))
    with tempfile.TemporaryDirectory(prefix="swarmctl-preflight-") as name:
        folder = Path(name)
        if clock == "real":
            require_flyable(config, scenario, folder)
        display = terminal(verbose=verbose)
        with uninterrupted(display, clock) as run:
            flight = app.fly(
                scenario,
                folder,
                display,
                clock=clock,
                permission=lambda _: None,
                bus=MemoryBus(ReportOnce(display.say)),
                options=options,
            )
            checks = run(flight)
    _conclude(checks, scenario)


def _conclude(checks: FlightReport, scenario: Scenario) -> None:
    if checks.bug is not None:
        raise checks.bug
    if checks.checked:
        out.print(report.overview(checks.checked))
    if not all(found.finding.ok for findings in checks.checked.values() for found in findings):
        out.print(report.failures(checks.checked))
    listed = {str(found) for findings in checks.checked.values() for found in findings}
    for text in checks.trouble:
        if text not in listed:  # the tables show the listed problems
            say_error(text)
    if checks.ended in ("stopped", "abandoned"):
        raise typer.Exit(INTERRUPTED)
    if checks.trouble or len(checks.checked) < len(scenario.specs):
        raise typer.Exit(FAILED)
    say("no check prevents the launch; no vehicle was armed")
