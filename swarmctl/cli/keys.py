"""`swarmctl keys`: certificates and signing keys for a swarm on many machines."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.transports.access import OPERATOR, ROUTER, name_of
from swarmctl.cli.calling import roll_of
from swarmctl.cli.console import EXPECTED, USAGE, ConfigOption, fail, out, say
from swarmctl.config.communication import mesh_endpoints
from swarmctl.config.roster import Roster
from swarmctl.security.files import KeyringError
from swarmctl.security.issue import AUTHORITY, Made, make


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
    known = roll_of(config)
    participants = {name_of(uav): name for uav, name in known.names.items()}
    names = [*participants, OPERATOR, ROUTER]
    try:
        hosts = _hosts(known, names, host or [])
    except ValueError as error:
        fail([f"--host {error}"], USAGE)
    try:
        made = make(out_folder, names, days, dt.datetime.now(dt.UTC), hosts)
    except KeyringError as error:
        fail([str(error)], EXPECTED)
    out.print(_table(made, participants))
    say(_what_to_copy(made))
    say(f"{out_folder / AUTHORITY} stays here, secret: who has its key can make participants.")


def _what_to_copy(made: list[Made]) -> str:
    new = [str(one.folder) for one in made if one.is_new or one.is_changed]
    if not new:
        return "Nothing has changed: what their machines have stays good."
    where = "to its machine, below the folder that communication.keys names there"
    if all(one.is_new for one in made):
        return f"Copy each folder {where}."
    refusing = "Who does not know a new key refuses what its owner says."
    return f"Copy again, each {where}: {', '.join(new)}. {refusing}"


def _hosts(known: Roster, names: list[str], given: list[str]) -> dict[str, list[str]]:
    """Where participants listen, by the configuration and as given. Raises ValueError."""
    hosts: dict[str, list[str]] = {name: [] for name in names}
    for name, host in _configured(known):
        hosts[name].append(host)
    for text in given:
        name, _, host = text.partition("=")
        if name not in hosts or not host:
            raise ValueError(f"{text!r}: expected NAME=HOST with a name of {', '.join(names)}")
        hosts[name].append(host)
    return hosts


def _configured(known: Roster) -> Iterator[tuple[str, str]]:
    if known.communication.router is not None:
        yield ROUTER, parse_endpoint(known.communication.router).host
    for uav, endpoint in mesh_endpoints(known.communication.mesh, known.names).items():
        yield name_of(uav), endpoint.host


def _table(made: list[Made], participants: dict[str, str]) -> Table:
    table = Table(title="keys", title_justify="left")
    for heading in ("folder", "for", "", "valid until (UTC)", "names"):
        table.add_column(heading)
    for one in made:
        whom = participants.get(one.name, "the ground station" if one.name == OPERATOR else "the router")
        state = "made" if one.is_new else "changed" if one.is_changed else "kept"
        until = f"{one.until:%Y-%m-%d %H:%M}"
        table.add_row(str(one.folder), whom, state, until, ", ".join(one.hosts))
    return table
