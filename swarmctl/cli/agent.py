"""`swarmctl agent`: one vehicle of a swarm, on a machine of its own."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.bus.endpoint import NOBODY
from swarmctl.bus.transports.access import name_of
from swarmctl.bus.transports.base import BusError
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.cli.calling import of_keys
from swarmctl.cli.console import (
    EXPECTED,
    USAGE,
    ConfigOption,
    OutOption,
    VerboseOption,
    fail,
    run_folder,
    say,
)
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
from swarmctl.config import joining
from swarmctl.config.scenario import Scenario
from swarmctl.core.texts import meant_by
from swarmctl.flight import companion
from swarmctl.flight.director import Permission
from swarmctl.flight.gc_tuning import settle
from swarmctl.links.url import parse_url
from swarmctl.preflight.waivers import Waiver
from swarmctl.security.files import KeyringError
from swarmctl.security.participant import Keyring


class Launch(StrEnum):
    ORDERED = "ordered"
    WHEN_READY = "when-ready"


def register(cli: typer.Typer) -> None:
    cli.command("agent")(agent)


def agent(
    config: ConfigOption,
    uav: Annotated[
        str, typer.Option(metavar="NAME", help="The vehicle; its name or system id.", show_default=False)
    ],
    url: Annotated[
        str | None,
        typer.Option(
            metavar="MAVLINK_URL", help="Where it is reached from here, instead of by the configuration."
        ),
    ] = None,
    launch: Annotated[
        Launch,
        typer.Option(
            help="ordered: when `swarmctl order launch` says so, at once; when-ready: by itself, after its "
            "delay_s."
        ),
    ] = Launch.ORDERED,
    connect: Annotated[
        str | None,
        typer.Option(metavar="tcp/HOST:PORT", help="The router, instead of communication.router."),
    ] = None,
    real: RealOption = False,
    confirm: Annotated[
        str, typer.Option(metavar="NAME", help="With --real, for scripts: the vehicle that may be armed.")
    ] = "",
    forward: ForwardOption = None,
    waive: WaiveOption = None,
    out_folder: OutOption = Path("runs"),
    verbose: VerboseOption = False,
) -> None:
    """Fly one vehicle of the swarm; the others' agents run elsewhere, and tell it what they see.

    It uploads its mission and waits for the order to launch. Where the network is missing or ends it flies on
    by what it knows, and by what it is told when the network is there again.
    """
    whole = scenario_of(config)
    scenario = forwarded(companion.only(whole, _meant(whole, uav), _url(url)), forward or [])
    allowed = confirmed(scenario, confirm) if real else frozenset()
    keyring = _keyring(config, scenario)
    network = _network(scenario, connect, launch, keyring)
    require_fit(config, _without_door(scenario), out_folder)
    waivers = waivers_of(waive, scenario)
    _fly(scenario, out_folder, launch, network, keyring, permission(allowed), waivers, verbose=verbose)


def _fly(
    scenario: Scenario,
    out_folder: Path,
    launch: Launch,
    network: Configuration | None,
    keyring: Keyring | None,
    may_arm: Permission,
    waivers: tuple[Waiver, ...],
    *,
    verbose: bool,
) -> None:
    """Leaves with the flight's exit code."""
    (spec,) = scenario.specs
    folder = run_folder(out_folder, f"{scenario.config.name}-{spec.name}")
    shown = terminal(verbose=verbose, with_time=True)
    settle()
    with unbroken() as run:
        try:
            with shown.shown():
                report = run(
                    companion.fly(
                        scenario,
                        folder,
                        shown,
                        clock="real",
                        permission=may_arm,
                        launch=launch.value,
                        network=network,
                        keyring=keyring,
                        waivers=waivers,
                    )
                )
        except BusError as error:
            fail([str(error)], EXPECTED)
        conclude(report, scenario, folder)


def _meant(scenario: Scenario, uav: str) -> int:
    try:
        (sysid,) = meant_by([uav], {spec.sysid: spec.name for spec in scenario.swarm})
    except ValueError as error:
        fail([f"--uav {uav}: {error}"], USAGE)
    return sysid


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
        fail(of_keys(config, [str(error)]), EXPECTED)


def _network(
    scenario: Scenario, connect: str | None, launch: Launch, keyring: Keyring | None
) -> Configuration | None:
    (spec,) = scenario.specs
    nowhere = scenario.config.communication.router is None and not scenario.config.communication.mesh
    if connect is None and nowhere and launch is Launch.WHEN_READY:
        say(f"`communication` has neither router nor mesh: {spec.name} flies in touch with nobody")
        return None
    try:
        names = {other.sysid: other.name for other in scenario.swarm}
        return joining.as_agent(scenario.config, spec.sysid, names, connect, keyring)
    except joining.NoNetwork as error:
        advice = f"; or --connect tcp/HOST:PORT, or --launch {Launch.WHEN_READY} to fly by itself"
        fail([f"{error}{advice if nowhere and connect is None else ''}"], USAGE)


def _without_door(scenario: Scenario) -> Scenario:
    """An agent opens none: what has the port of `communication.listen` is not in its way."""
    config = scenario.config
    closed = config.communication.model_copy(update={"listen": NOBODY})
    return replace(scenario, config=config.model_copy(update={"communication": closed}))
