"""`swarmctl keys`: certificates and signing keys for a swarm on many machines."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from swarmctl.bus.access import OPERATOR, ROUTER, name_of
from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.commands.shared import EXPECTED, USAGE, ConfigOption, fail, out, say, scenario_of
from swarmctl.core.roster import meant_by
from swarmctl.keyring.files import KeyringError
from swarmctl.keyring.make import AUTHORITY, Made, make
from swarmctl.scenario import Scenario


def register(cli: typer.Typer) -> None:
    cli.command("keys")(make_keys)


def make_keys(
    config: ConfigOption,
    out_folder: Annotated[
        Path, typer.Option("--out", help="Where they are made; what is there already is kept.")
    ] = Path("keys"),
    days: Annotated[int, typer.Option(min=1, max=3650, help="How long certificates are valid.")] = 365,
    host: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME=HOST",
            help="Where a participant (router, or a vehicle of a mesh) is found, besides the endpoints of "
            "the configuration; may be repeated.",
        ),
    ] = None,
) -> None:
    """Make a folder of keys for each vehicle, the operator and the router, to be copied to their machines."""
    scenario = scenario_of(config)
    participants = {name_of(spec.sysid): spec.name for spec in scenario.swarm}
    names = [*participants, OPERATOR, ROUTER]
    try:
        hosts = _hosts(scenario, names, host or [])
    except ValueError as error:
        fail([f"--host {error}"], USAGE)
    try:
        made = make(out_folder, names, days, dt.datetime.now(dt.UTC), hosts)
    except KeyringError as error:
        fail([str(error)], EXPECTED)
    out.print(_table(made, participants))
    say(
        f"Copy each folder to its machine, below the folder that communication.keys names there. "
        f"{out_folder / AUTHORITY} stays here, secret: who has its key can make participants."
    )


def _hosts(scenario: Scenario, names: list[str], given: list[str]) -> dict[str, list[str]]:
    """Where participants listen, by the configuration and as given. Raises ValueError."""
    hosts: dict[str, list[str]] = {name: [] for name in names}
    for name, host in _configured(scenario):
        hosts[name].append(host)
    for text in given:
        name, _, host = text.partition("=")
        if name not in hosts or not host:
            raise ValueError(f"{text!r}: expected NAME=HOST with a name of {', '.join(names)}")
        hosts[name].append(host)
    return hosts


def _configured(scenario: Scenario) -> Iterator[tuple[str, str]]:
    communication = scenario.config.communication
    if communication.router is not None:
        yield ROUTER, parse_endpoint(communication.router).host
    by_sysid = {spec.sysid: spec.name for spec in scenario.swarm}
    for word, endpoint in communication.mesh.items():
        (uav,) = meant_by([word], by_sysid)
        yield name_of(uav), parse_endpoint(endpoint).host


def _table(made: list[Made], participants: dict[str, str]) -> Table:
    table = Table(title="keys", title_justify="left")
    for heading in ("folder", "for", "", "valid until (UTC)", "names"):
        table.add_column(heading)
    for one in made:
        whom = participants.get(one.name, "the ground station" if one.name == OPERATOR else "the router")
        state = "made" if one.is_new else "kept"
        until = f"{one.until:%Y-%m-%d %H:%M}"
        table.add_row(str(one.folder), whom, state, until, ", ".join(one.hosts))
    return table
