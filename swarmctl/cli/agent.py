"""`swarmctl agent`: fly one vehicle of a swarm."""

from __future__ import annotations

import datetime as dt
import time
from pathlib import Path
from typing import Annotated, Literal

import typer

from swarmctl.bus.endpoint import NO_ENDPOINT
from swarmctl.bus.transports.access import name_of
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.cli.configuration import fail_for_keys, load_scenario_or_exit, require_flyable
from swarmctl.cli.console import (
    FAILED,
    USAGE,
    ConfigOption,
    ConnectOption,
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
    terminal,
    uninterrupted,
    with_forwarding,
)
from swarmctl.cli.resume import LAST, ResumeOption, load_or_exit
from swarmctl.config import joining
from swarmctl.config.communication import vehicle_of
from swarmctl.config.scenario import Scenario
from swarmctl.core.operator_text import extended
from swarmctl.core.records import replace
from swarmctl.flight import companion
from swarmctl.links.url import parse_url
from swarmctl.report import unfinished_run
from swarmctl.report.unfinished_run import UnfinishedRun
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import Keyring

Launch = Literal["ordered", "when-ready"]


def agent(
    config: ConfigOption,
    uav: Annotated[
        str, typer.Option(metavar="NAME", help="Name or system id of the vehicle.", show_default=False)
    ],
    url: Annotated[
        str | None,
        typer.Option(
            metavar="MAVLINK_URL", help="The vehicle's URL from this machine, instead of the configuration's."
        ),
    ] = None,
    launch: Annotated[
        Launch,
        typer.Option(
            help="ordered: at `swarmctl order launch`; when-ready: after the checks and the vehicle's delay."
        ),
    ] = "ordered",
    connect: ConnectOption = None,
    real: RealOption = False,
    confirm: ConfirmOption = None,
    forward: ForwardOption = None,
    waive: WaiveOption = None,
    resume: ResumeOption = None,
    out_folder: OutOption = Path("runs"),
    verbose: VerboseOption = False,
) -> None:
    """Fly one vehicle of the swarm; agents on other machines fly the other vehicles.

    The agent uploads the mission and, by default, waits for the order to launch. Without the network the
    agent continues the flight with its own knowledge, and synchronises after the network returns.

    With `--resume last`, an agent that is started anew after a crash takes its vehicle over. If its last run
    has ended in order, is older than an hour, or does not exist, it begins a new flight.
    """
    swarm_scenario = load_scenario_or_exit(config)
    alone = companion.scenario_for(swarm_scenario, _vehicle(swarm_scenario, uav), _url(url))
    unfinished = _unfinished_run(resume, out_folder, alone)
    scenario = with_forwarding(alone, forward or [])
    may_arm = arming_permission(scenario, real=real, confirm=confirm)
    keyring = _keyring(config, scenario)
    network = _network(scenario, connect, launch, keyring)
    require_flyable(config, _without_listen(scenario), out_folder)
    waivers = parse_waivers_or_exit(waive, scenario)
    (spec,) = scenario.specs
    folder = run_folder(out_folder, f"{scenario.config.name}-{spec.name}")
    display = terminal(verbose=verbose, with_time=True)
    with uninterrupted(display) as run:
        try:
            report = run(
                companion.fly(
                    scenario,
                    folder,
                    display,
                    clock="real",
                    permission=may_arm,
                    launch=launch,
                    network=network,
                    keyring=keyring,
                    waivers=waivers,
                    resumes=unfinished,
                )
            )
        except (BusError, KeyringError) as error:
            fail([str(error)], FAILED)
        conclude(report, scenario, folder)


def _unfinished_run(resume: str | None, runs: Path, scenario: Scenario) -> UnfinishedRun | None:
    if resume is None:
        return None
    if resume != LAST:
        return load_or_exit(Path(resume), scenario)[1]
    (spec,) = scenario.specs
    run = unfinished_run.last_run(runs, f"{scenario.config.name}-{spec.name}")
    if run is not None and unfinished_run.is_unfinished(run, time.time()):
        return load_or_exit(run, scenario)[1]
    say(f"{spec.name}: {runs} has no unfinished run of this vehicle; a new flight begins")
    return None


def _vehicle(scenario: Scenario, uav: str) -> int:
    try:
        return vehicle_of(uav, scenario.config.names)
    except ValueError as error:
        fail([f"--uav: {error}"], USAGE)


def _url(url: str | None) -> str | None:
    try:
        if url is not None:
            parse_url(url)
    except ValueError as error:
        fail([f"--url: {error}"], USAGE)
    return url


def _keyring(config: Path, scenario: Scenario) -> Keyring | None:
    (spec,) = scenario.specs
    try:
        return joining.keyring_of(scenario.config, name_of(spec.sysid), dt.datetime.now(dt.UTC))
    except KeyringError as error:
        fail_for_keys(config, error)


def _network(
    scenario: Scenario, connect: str | None, launch: Launch, keyring: Keyring | None
) -> Configuration | None:
    (spec,) = scenario.specs
    is_isolated = not scenario.config.communication.spans_machines
    if connect is None and is_isolated and launch == "when-ready":
        say(f"{spec.name} flies without a network: `communication` has neither router nor mesh [no-network]")
        return None
    try:
        return joining.as_agent(scenario.config, spec.sysid, connect, keyring)
    except joining.NoNetwork as error:
        advice = ", or give --connect tcp/HOST:PORT, or fly alone with --launch when-ready"
        fail([extended(str(error), advice if is_isolated and connect is None else "")], USAGE)


def _without_listen(scenario: Scenario) -> Scenario:
    """Return the scenario without `communication.listen`, because an agent does not use that endpoint."""
    config = scenario.config
    closed = config.communication.model_copy(update={"listen": NO_ENDPOINT})
    return replace(scenario, config=config.model_copy(update={"communication": closed}))
