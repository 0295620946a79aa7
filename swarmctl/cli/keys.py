"""`swarmctl keys`: certificates and signing keys for a swarm on many machines."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.transports.access import OPERATOR, ROUTER, name_of
from swarmctl.cli.configuration import load_roster_or_exit
from swarmctl.cli.console import FAILED, USAGE, ConfigOption, fail, out, say, split_items
from swarmctl.config.communication import mesh_endpoints
from swarmctl.config.roster import Roster
from swarmctl.security.files import AUTHORITY, KeyringError
from swarmctl.security.issue import ParticipantFolder, make_keys


def keys(
    config: ConfigOption,
    out_folder: Annotated[
        Path, typer.Option("--out", help="Folder for the keys; existing keys are kept.")
    ] = Path("keys"),
    days: Annotated[int, typer.Option(min=1, max=3650, help="Validity of new certificates [days].")] = 365,
    host: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME=HOST,…",
            callback=split_items,
            help="Further host names or addresses of participants (the router, or a vehicle of a mesh).",
        ),
    ] = None,
    revoke: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME,…",
            callback=split_items,
            help="Revoke the keys of vehicles, of `operator` or of `router`, and make new ones.",
        ),
    ] = None,
    share: Annotated[
        bool, typer.Option("--share", help="Use the keys of another swarm's folder for this swarm too.")
    ] = False,
) -> None:
    """Make a folder of keys for each vehicle, the operator and the router, to copy to their machines."""
    swarm = load_roster_or_exit(config)
    participants = {name_of(uav): name for uav, name in swarm.names.items()}
    names = [*participants, OPERATOR, ROUTER]
    try:
        hosts = _hosts(swarm, names, host or [])
    except ValueError as error:
        fail([f"--host {error}"], USAGE)
    try:
        now, revoked = dt.datetime.now(dt.UTC), _participants(revoke or [], participants)
        made = make_keys(out_folder, names, days, now, hosts, swarm=swarm.name, share=share, revoke=revoked)
    except KeyringError as error:
        fail([str(error)], FAILED)
    out.print(_table(made, participants))
    say(_what_to_copy(made))
    if revoked:
        say(
            f"Revoked: {', '.join(revoked)}. Copy the folders to all machines now: running agents refuse the "
            "old keys a second after the copy. Restart the router and, in a mesh, the agents on the ground."
        )
    say(f"Keep {out_folder / AUTHORITY} on this machine and secret: its key can certify new participants.")


def _participants(words: list[str], participants: dict[str, str]) -> list[str]:
    """Return the participants that vehicles' names or participants' names stand for."""
    by_name = {vehicle: participant for participant, vehicle in participants.items()}
    return list(dict.fromkeys(by_name.get(word, word) for word in words))


def _what_to_copy(made: list[ParticipantFolder]) -> str:
    to_copy = [
        str(participant.folder) for participant in made if participant.is_new or participant.is_changed
    ]
    if not to_copy:
        return "No folder has changed; the machines need no new copies."
    where = "into the folder communication.keys of its participant's machine, under the same name"
    if all(participant.is_new for participant in made):
        return f"Copy each folder {where}."
    refusing = "A machine with an old copy refuses the messages of participants with new keys."
    return f"Copy these folders again, each {where}: {', '.join(to_copy)}. {refusing}"


def _hosts(swarm: Roster, names: list[str], given: list[str]) -> dict[str, list[str]]:
    """Return the participants' hosts, from the configuration and the options. Raises ValueError."""
    hosts: dict[str, list[str]] = {name: [] for name in names}
    for name, host in _configured_hosts(swarm):
        hosts[name].append(host)
    for text in given:
        name, _, host = text.partition("=")
        if name not in hosts or not host:
            raise ValueError(f"{text!r}: expected NAME=HOST with a name of {', '.join(names)}")
        hosts[name].append(host)
    return hosts


def _configured_hosts(swarm: Roster) -> Iterator[tuple[str, str]]:
    if swarm.communication.router is not None:
        yield ROUTER, parse_endpoint(swarm.communication.router).host
    for uav, endpoint in mesh_endpoints(swarm.communication.mesh, swarm.names).items():
        yield name_of(uav), endpoint.host


def _table(made: list[ParticipantFolder], participants: dict[str, str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("folder", "for", "keys", "valid until (UTC)", "hosts"):
        table.add_column(heading)
    for found in made:
        owner = participants.get(found.name, "the operator" if found.name == OPERATOR else "the router")
        state = "made" if found.is_new else "changed" if found.is_changed else "kept"
        until = f"{found.until:%Y-%m-%d %H:%M}"
        table.add_row(str(found.folder), owner, state, until, ", ".join(found.hosts))
    return table
