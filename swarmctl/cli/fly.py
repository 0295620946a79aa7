"""`swarmctl fly`: a whole swarm in one process."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.configuration import (
    config_or_example,
    describe,
    fail_for_keys,
    load_scenario_or_exit,
    require_flyable,
)
from swarmctl.cli.console import (
    FAILED,
    USAGE,
    ConfigOrExampleOption,
    ExampleOption,
    OutOption,
    VerboseOption,
    fail,
    run_folder,
    say,
)
from swarmctl.cli.flights import (
    ConfirmOption,
    ForwardOption,
    RealOption,
    WaiveOption,
    arming_permission,
    conclude,
    parse_waivers_or_exit,
    require_simulated_clock,
    terminal,
    uninterrupted,
    with_forwarding,
)
from swarmctl.cli.live_dashboard import live_dashboard
from swarmctl.cli.resume import ResumeOption, load_or_exit, run_or_exit
from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace
from swarmctl.flight import app
from swarmctl.flight.run import DEFAULT_OPTIONS, Clock
from swarmctl.preflight import host
from swarmctl.report.evidence.log import Signer
from swarmctl.security.evidence_keys import operator_evidence_signer
from swarmctl.security.files import KeyringError

ClockOption = Annotated[
    Clock,
    typer.Option(help="virtual: simulated vehicles in this process, faster than real time and repeatable."),
]


def fly(
    config: ConfigOrExampleOption = None,
    example: ExampleOption = None,
    clock: ClockOption = "real",
    real: RealOption = False,
    confirm: ConfirmOption = None,
    forward: ForwardOption = None,
    waive: WaiveOption = None,
    resume: ResumeOption = None,
    out_folder: OutOption = Path("runs"),
    verbose: VerboseOption = False,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="Show the flight in a browser on this machine.")
    ] = False,
    folder: Annotated[
        Path | None, typer.Option("--run-folder", hidden=True, help="An empty folder for the run.")
    ] = None,
) -> None:
    """Fly the swarm, simulated or real, from the ground to the last landing."""
    if resume is None or config is not None or example is not None:
        config = config_or_example(config, example)
    given = None if config is None else load_scenario_or_exit(config)
    scenario, unfinished = given, None
    if resume is not None:
        name = "" if given is None else given.config.name
        run = run_or_exit(resume, out_folder, name)
        if clock == "virtual":
            fail(["--resume: a flight on the virtual clock ends with its program [virtual-clock]"], USAGE)
        scenario, unfinished = load_or_exit(run, given)
    assert scenario is not None
    scenario = with_forwarding(scenario, forward or [])
    if config is not None and clock == "virtual":
        require_simulated_clock(config, scenario)
    if dashboard and clock == "virtual":
        fail(["--dashboard shows flights in real time; open the run with `swarmctl dashboard RUN`"], USAGE)
    may_arm = arming_permission(scenario, real=real, confirm=confirm)
    if config is None:
        if troubles := list(host.troubles(scenario, out_folder)):
            fail(troubles, FAILED)
    elif clock == "real":
        require_flyable(config, scenario, out_folder)
    options = replace(
        DEFAULT_OPTIONS,
        signer=_signer(config, scenario),
        waivers=parse_waivers_or_exit(waive, scenario),
        resumes=unfinished,
    )
    folder = folder or run_folder(out_folder, scenario.config.name)
    subject = config if unfinished is None else unfinished.folder
    say(f"{subject}: {describe(scenario)}; connecting")
    display = terminal(verbose=verbose)
    with (
        live_dashboard(folder) if dashboard else contextlib.nullcontext(),
        uninterrupted(display, clock) as run_flight,
    ):
        report = run_flight(
            app.fly(scenario, folder, display, clock=clock, permission=may_arm, options=options)
        )
        conclude(report, scenario, folder)


def _signer(config: Path | None, scenario: Scenario) -> Signer | None:
    try:
        return operator_evidence_signer(scenario.config.communication.keys)
    except KeyringError as error:
        fail_for_keys(config, error)
