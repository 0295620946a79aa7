"""`swarmctl observe`: report an operator's observation to the agent of a vehicle."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
from typing import Annotated

import typer

from swarmctl.bus.authentication import NO_AUTHENTICATION, RequestSigning
from swarmctl.bus.sensor_reports import (
    MANUAL_SOURCE,
    VERSION,
    Report,
    ReportAnswer,
    ReportedPoint,
    report_schema,
)
from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.cli.configuration import load_roster_or_exit
from swarmctl.cli.console import FAILED, fail, out, say
from swarmctl.cli.operator_command import (
    ConnectOption,
    FlyingConfigOption,
    SwarmOption,
    exit_on_failure,
    signing_for,
)
from swarmctl.config import joining
from swarmctl.config.communication import mesh_endpoints, vehicle_of
from swarmctl.config.roster import Roster
from swarmctl.core.grid import Cell
from swarmctl.core.messages import MAX_SYSTEM_ID
from swarmctl.core.records import replace
from swarmctl.station import client
from swarmctl.station.client import BadOptions, FlightEndpoints

MAX_INDEX = 2**31
"""a number greater than the rows and columns of any area"""


def observe(
    uav: Annotated[
        str,
        typer.Option(
            "--uav",
            metavar="NAME",
            help="The receiving vehicle: system id, or name with --config.",
        ),
    ] = "",
    cell: Annotated[
        list[str] | None, typer.Option("--cell", metavar="ROW,COL", help="Observed cell; repeatable.")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option("--at", metavar="LAT,LON", help="Position [deg] instead of --cell; repeatable."),
    ] = None,
    occupied: Annotated[
        bool | None,
        typer.Option(
            "--occupied/--clear",
            help="occupied: a hostile is in the cell; clear: no hostile is in the cell.",
            show_default=False,
        ),
    ] = None,
    swarm: SwarmOption = None,
    config: FlyingConfigOption = None,
    connect: ConnectOption = None,
    show_schema: Annotated[
        bool,
        typer.Option("--schema", help="Print the JSON schema of payloads' reports and exit."),
    ] = False,
) -> None:
    """Report an observation to a vehicle in flight; the vehicle's agent uses and shares the observation.

    For swarms with `sensor: {source: external}` or `both`. Payloads report the same way: see --schema, and
    configs/detector.py for an example.
    """
    if show_schema:
        out.print_json(json.dumps(report_schema()))
        return
    roster = None if config is None else load_roster_or_exit(config)
    with exit_on_failure(config):
        report = make_report(cell or [], at or [], occupied)
        receiver = _vehicle(uav, roster)
        flight, credentials, signing = _find_flight(swarm, roster, connect, receiver)
        answer = asyncio.run(_report(flight, credentials, receiver, report, signing))
    if not answer.taken:
        fail([f"vehicle {uav} of {flight.swarm} refused the report: {answer.why}"], FAILED)
    states = ((row, col, "occupied" if is_occupied else "clear") for row, col, is_occupied in answer.cells)
    cells = ", ".join(f"({row}, {col}) {state}" for row, col, state in states)
    say(f"vehicle {uav} of {flight.swarm} accepted: {cells}")


def make_report(cells: list[str], positions: list[str], occupied: bool | None) -> Report:
    """Return the report that the options describe. Raises BadOptions."""
    if bool(cells) == bool(positions):
        raise BadOptions(
            "give either --cell ROW,COL (row 0 is the southernmost) or --at LAT,LON [which-cell]"
        )
    if occupied is None:
        raise BadOptions("give --occupied (a hostile is in the cell) or --clear [occupied-or-clear]")
    if cells:
        return Report(VERSION, cells=tuple((*_cell(word), occupied) for word in cells), source=MANUAL_SOURCE)
    return Report(VERSION, points=tuple(_point(word, occupied) for word in positions), source=MANUAL_SOURCE)


def _pair(word: str, option: str, such_as: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in word.split(","))
    except ValueError:
        raise BadOptions(f"{option} {word!r}: expected two numbers, such as {such_as}") from None
    return first, second


def _cell(word: str) -> Cell:
    row, col = _pair(word, "--cell", "4,7")
    if not (row.is_integer() and col.is_integer() and max(abs(row), abs(col)) < MAX_INDEX):
        raise BadOptions(f"--cell {word!r}: expected whole numbers, such as 4,7")
    return int(row), int(col)


def _point(word: str, occupied: bool) -> ReportedPoint:
    lat_deg, lon_deg = _pair(word, "--at", "46.0512,14.4071")
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise BadOptions(f"--at {word!r}: expected a latitude and a longitude [deg], such as 46.0512,14.4071")
    return ReportedPoint(lat_deg, lon_deg, occupied)


def _vehicle(word: str, roster: Roster | None) -> int:
    """Return the vehicle's system id. Raises ValueError."""
    if not word:
        raise BadOptions("give --uav with the vehicle's system id, or its name with --config [which-vehicle]")
    if roster is not None:
        return vehicle_of(word, roster.names)
    if word.isascii() and word.isdigit() and 1 <= int(word) <= MAX_SYSTEM_ID:
        return int(word)
    raise BadOptions(f"--uav {word!r}: expected a system id from 1 to {MAX_SYSTEM_ID}; names need --config")


def _find_flight(
    swarm: str | None, roster: Roster | None, connect: str | None, receiver: int
) -> tuple[FlightEndpoints, Credentials | None, RequestSigning]:
    """Return the flight, the credentials for it and the signing of reports.

    Raises BusError, KeyringError and ValueError.
    """
    flight = client.find(swarm, roster, connect)
    if roster is None:
        return flight, joining.credentials_for(flight.endpoint, None), signing_for(flight, None)
    endpoint = mesh_endpoints(roster.communication.mesh, roster.names).get(receiver)
    if endpoint is not None and connect is None and flight.agents:
        # Mesh nodes do not relay reports.
        flight = replace(flight, endpoint=endpoint, others=())
    is_certified = flight.endpoint.is_certified
    keyring = joining.keyring_of(roster, OPERATOR, dt.datetime.now(dt.UTC)) if is_certified else None
    # Over a certified link the certificate authenticates the sender.
    signing = NO_AUTHENTICATION if is_certified else signing_for(flight, None)
    return flight, joining.credentials_for(flight.endpoint, keyring), signing


async def _report(
    flight: FlightEndpoints,
    credentials: Credentials | None,
    uav: int,
    report: Report,
    signing: RequestSigning,
) -> ReportAnswer:
    """Connect, send a report and return the answer. Raises BusError and NoValidAnswer."""
    with client.connected(flight, credentials) as bus:
        return await client.report(bus, flight, uav, report, signing)
