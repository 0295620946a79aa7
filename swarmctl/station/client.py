"""Client of the operator service: finds a swarm in flight, sends commands, and decodes the answers."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from collections.abc import Iterator, Mapping, Sequence

import msgspec

from swarmctl.bus import directory, keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, NotAuthorised, RequestSigning
from swarmctl.bus.endpoint import NO_ENDPOINT, BusEndpoint, parse_endpoint
from swarmctl.bus.operator_service import ANSWER_WITHIN_S, KINDS
from swarmctl.bus.transports import BUSES, zenoh_config
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.config.roster import Roster
from swarmctl.core.messages import (
    ENDING_ORDERS,
    BadMessage,
    GiveOrder,
    OperatorAnswer,
    Request,
    VehicleAnswer,
    decode_answer,
    encode,
)
from swarmctl.core.operator_text import did_you_mean, extended, resolve_vehicles
from swarmctl.core.records import replace

TIMEOUT_S = ANSWER_WITHIN_S + 2.0


class BadOptions(ValueError):
    """Missing, invalid or contradictory options of a command; the text has the remedy."""


class NoValidAnswer(Exception):
    """A command without a valid answer; the text states whether the command may have had an effect."""


class FlightEndpoints(msgspec.Struct, frozen=True):
    """Endpoints of a swarm in flight, and the agents that answer at these endpoints."""

    swarm: str
    endpoint: BusEndpoint
    others: tuple[BusEndpoint, ...] = ()
    """further endpoints, tried in order"""
    agents: Mapping[int, str] = msgspec.field(default_factory=dict)
    """vehicles (system id: name) with separate agents; empty: one process answers for all vehicles"""


def chosen_vehicles(uavs: Sequence[str] | None, all_vehicles: bool) -> tuple[str, ...] | None:
    """Return the vehicles as given, by name or system id; None for all vehicles. Raises BadOptions."""
    if all_vehicles == bool(uavs):
        raise BadOptions("give either --uav NAME,NAME (or system ids) or --all [which-vehicles]")
    return tuple(uavs) if uavs else None


def find(swarm: str | None, config: Roster | None, connect: str | None) -> FlightEndpoints:
    """Return the flight that the options select: by endpoint, by name, or the only flight on this machine.

    Each agent may run on a separate machine. Raises BadOptions, and BusError if this machine has no such
    flight.
    """
    swarm = _swarm_name(swarm, config)
    agents = config.names if config is not None and config.communication.spans_machines else {}
    if connect is not None:
        endpoint = _endpoint(connect)
        swarm = swarm or _swarm_at(endpoint)
        return FlightEndpoints(swarm, endpoint, agents=agents)
    if config is not None and not agents:
        if not BUSES[config.communication.bus].is_networked or config.communication.listen == NO_ENDPOINT:
            raise BadOptions(
                f"{swarm} takes no commands: `communication` has bus: memory, or listen: none [not-listening]"
            )
        listen = parse_endpoint(config.communication.listen)
        if listen.port != 0:
            return FlightEndpoints(config.name, listen.client_endpoint)
    running = directory.running_swarms()
    named = [entry for entry in running if swarm in (None, entry.swarm)]
    if named:  # one process on this machine flies all vehicles
        return _only(named)
    if config is not None and agents:
        points = entry_points(config)
        return FlightEndpoints(config.name, points[0], tuple(points[1:]), agents)
    others = f"; running: {', '.join(map(describe, running))}" if running else ""
    if hint := did_you_mean(swarm or "", (entry.swarm for entry in running)):
        others += f"; {hint}"
    raise BusError(
        f"this user has no flight {f'of swarm {swarm} ' if swarm else ''}on this machine that takes "
        f"commands{others}; no command was sent. The flight may have ended. A flight with --clock virtual, "
        "bus: memory or listen: none takes no commands. For agents on other machines, give --config "
        "[no-swarm]"
    )


def _only(flights: Sequence[directory.RunningSwarm]) -> FlightEndpoints:
    """Return the only flight. Raises BadOptions if there are several."""
    if len(flights) == 1:
        return FlightEndpoints(flights[0].swarm, flights[0].endpoint)
    are_unlike = len({flight.swarm for flight in flights}) == len(flights)
    option = "--swarm NAME" if are_unlike else f"--connect, such as --connect {flights[0].endpoint}"
    raise BadOptions(
        f"{len(flights)} swarms fly on this machine: {', '.join(map(describe, flights))}; choose one with "
        f"{option} [which-swarm]"
    )


def _swarm_at(endpoint: BusEndpoint) -> str:
    """Return the name of this user's flight at an endpoint. Raises BadOptions and BusError."""
    for flight in directory.running_swarms():
        if flight.endpoint == endpoint:
            return flight.swarm
    raise BadOptions(
        f"this user has no flight at {endpoint} on this machine; add --swarm NAME or --config FILE "
        "[which-swarm]"
    )


def local_token(flight: FlightEndpoints) -> str | None:
    """Return the token of this user's flight at an endpoint on this machine; None if there is none.

    Raises BusError.
    """
    running = [entry for entry in directory.running_swarms() if entry.swarm == flight.swarm]
    # The host may be written in several ways.
    return next((entry.token for entry in running if entry.endpoint.port == flight.endpoint.port), None)


def describe(flight: directory.RunningSwarm) -> str:
    """Return the swarm, endpoint, age and process of a running flight as text."""
    age = duration_text(time.time() - flight.started_unix_s)
    return f"{flight.swarm} at {flight.endpoint} (flying for {age}, process {flight.pid})"


def duration_text(seconds: float) -> str:
    """Return a duration as text: in hours from 2 h on, in minutes from 2 min on, else in seconds."""
    for unit, unit_s in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * unit_s:
            return f"{seconds / unit_s:.0f} {unit}"
    return f"{max(seconds, 0.0):.0f} s"


def entry_points(config: Roster) -> list[BusEndpoint]:
    """Return the endpoints of a swarm on many machines: the router, or all nodes of the mesh."""
    c = config.communication
    return [parse_endpoint(text) for text in ([c.router] if c.router is not None else c.mesh.values())]


def _swarm_name(swarm: str | None, config: Roster | None) -> str | None:
    if swarm is not None and not re.fullmatch(keys.SWARM_NAME, swarm):
        raise BadOptions(f"--swarm {swarm!r}: expected a swarm's name, which matches {keys.SWARM_NAME}")
    if swarm is not None and config is not None and swarm != config.name:
        raise BadOptions(
            f"--swarm is {swarm}, but the swarm of --config is {config.name}; remove one of the two options"
        )
    return config.name if config is not None else swarm


def _endpoint(text: str) -> BusEndpoint:
    try:
        endpoint = parse_endpoint(text)
    except ValueError as error:
        raise BadOptions(f"--connect: {error}") from None
    if endpoint.port == 0:
        raise BadOptions("--connect: port 0 is not a port; give the port at which the flight listens")
    return endpoint


@contextlib.contextmanager
def connected(flight: FlightEndpoints, credentials: Credentials | None = None) -> Iterator[ZenohBus]:
    """Yield a connection to the first endpoint of the flight that answers. Raises BusError."""
    failures: list[str] = []
    for endpoint in (flight.endpoint, *flight.others):
        try:
            bus = ZenohBus(zenoh_config.visitor(endpoint, credentials))
        except BusError as error:
            failures.append(str(error))
            continue
        with bus:
            yield bus
        return
    raise BusError("; ".join(failures))


async def ask(
    bus: Transport, flight: FlightEndpoints, command: Request, signing: RequestSigning = NO_AUTHENTICATION
) -> OperatorAnswer:
    """Send a command over an open bus and return the answer. Raises BadOptions and NoValidAnswer."""
    kind = KINDS[type(command)]
    if flight.agents:
        return await _ask_each(bus, flight, kind, command, signing)
    key = keys.request(flight.swarm, kind)
    try:
        payload = signing.sign(None, key, encode(command))
    except NotAuthorised as error:
        raise NoValidAnswer(str(error)) from None
    try:
        answers = await bus.ask(key, payload, TIMEOUT_S)
    except TimeoutError:
        raise NoValidAnswer(
            f"{flight.swarm} at {flight.endpoint} did not answer within {TIMEOUT_S:g} s. The command may "
            "have had an effect; check the flight's table, or repeat the command [no-answer]"
        ) from None
    if not answers:
        raise NoValidAnswer(
            f"no swarm {flight.swarm} answers at {flight.endpoint}, or the swarm's queue of commands is "
            "full; nothing was changed [not-served]"
        )
    if len(answers) > 1:
        raise NoValidAnswer(
            f"{len(answers)} processes answer for {flight.swarm} at {flight.endpoint}, so the result of "
            "the command is unknown; end all processes but one, and check the remaining flight's table"
        )
    try:
        answer = signing.verify_answer(None, key, payload, answers[0])
    except BadMessage:
        raise NoValidAnswer(unverified(flight)) from None
    try:
        return decode_answer(answer)
    except BadMessage as error:
        raise NoValidAnswer(
            f"{flight.swarm} at {flight.endpoint} sent an invalid answer: {error}. The command may have "
            "had an effect; the flight may run another version of this program"
        ) from error


def unverified(flight: FlightEndpoints) -> str:
    """Return the error for an answer that does not have the flight's token."""
    return (
        f"{flight.swarm} at {flight.endpoint} has another token and refused the request, or another program "
        "answers there; send the request as the user of the flight, or set SWARMCTL_TOKEN_FILE for both "
        "[wrong-token]"
    )


async def _ask_each(
    bus: Transport, flight: FlightEndpoints, kind: keys.RequestKind, command: Request, signing: RequestSigning
) -> OperatorAnswer:
    """Send a command to the agents of the vehicles in `command.uavs`, all at once. Raises BadOptions."""
    try:
        uavs = list(flight.agents if command.uavs is None else resolve_vehicles(command.uavs, flight.agents))
        if isinstance(command, GiveOrder) and command.ignore:  # an agent knows no other vehicle's name
            ignored = tuple(resolve_vehicles(command.ignore, flight.agents))
            command = replace(command, ignore=ignored)
    except ValueError as error:
        raise BadOptions(f"nothing was changed: {error}") from None

    async def ask_agent(uav: int) -> VehicleAnswer:
        key, name = keys.request(flight.swarm, kind, uav), flight.agents[uav]
        try:
            payload = signing.sign(uav, key, encode(replace(command, uavs=(uav,))))
        except NotAuthorised as error:
            return VehicleAnswer(uav, name, "refused", note=str(error))
        try:
            answers = await bus.ask(key, payload, TIMEOUT_S)
        except TimeoutError:
            note = f"the vehicle's agent did not answer within {TIMEOUT_S:g} s"
            return VehicleAnswer(uav, name, "unconfirmed", note=note)
        verified = list(_verified_answers(signing, uav, key, payload, answers))
        n_dropped = len(answers) - len(verified)
        return _one_answer(uav, name, verified, n_dropped)

    return OperatorAnswer(tuple(await asyncio.gather(*map(ask_agent, uavs))))


def _verified_answers(
    signing: RequestSigning, uav: int, key: str, asked: bytes, answers: Sequence[bytes]
) -> Iterator[bytes]:
    for data in answers:
        with contextlib.suppress(BadMessage):
            yield signing.verify_answer(uav, key, asked, data)


def _one_answer(uav: int, name: str, answers: Sequence[bytes], n_dropped: int) -> VehicleAnswer:
    """Return an agent's answer; `n_dropped` answers did not have the vehicle's signature."""
    if not n_dropped:
        return _decode_one(uav, name, answers)
    warning = (
        f"{n_dropped} answer{'s' if n_dropped > 1 else ''} without the vehicle's signature "
        "(another process answers for the vehicle, or the vehicle has other keys or another token)"
    )
    if not answers:
        return VehicleAnswer(uav, name, "unconfirmed", note=f"no signed answer, and {warning}")
    answer = _decode_one(uav, name, answers)
    dropped_text = f"dropped: {warning}"
    note = extended(answer.note, f"; {dropped_text}") if answer.note else dropped_text
    return replace(answer, note=note)


def _decode_one(uav: int, name: str, answers: Sequence[bytes]) -> VehicleAnswer:
    if not answers:
        note = (
            "the vehicle's agent does not answer: the flight has ended, or `swarmctl agent` does not run or "
            "has no connection to the network [agent-silent]"
        )
        return VehicleAnswer(uav, name, "silent", note=note)
    if len(answers) > 1:
        note = f"{len(answers)} agents answer for this vehicle; end all agents but one"
        return VehicleAnswer(uav, name, "unconfirmed", note=note)
    try:
        answer = decode_answer(answers[0])
    except BadMessage as error:
        note = f"the agent's answer is invalid: {error}; the agent may run another version of this program"
        return VehicleAnswer(uav, name, "unconfirmed", note=note)
    if answer.refused:
        return VehicleAnswer(uav, name, "refused", note=answer.refused)
    if [vehicle.uav for vehicle in answer.vehicles] != [uav]:
        return VehicleAnswer(
            uav, name, "unconfirmed", note="the vehicle's agent answered for another vehicle"
        )
    return answer.vehicles[0]


def has_failed(command: Request, answer: OperatorAnswer) -> bool:
    """Return whether no vehicle took the command, or a vehicle has another outcome than `taken`.

    If the command is for all vehicles, the outcome `over` of some vehicles is no failure. An order that ends
    flights is fulfilled even if all flights are over.
    """
    outcomes = {vehicle.outcome for vehicle in answer.vehicles}
    accepted = {"taken", "over"} if command.uavs is None else {"taken"}
    ends_flights = isinstance(command, GiveOrder) and command.order in ENDING_ORDERS
    expected = accepted if ends_flights else {"taken"}
    return bool(answer.refused) or not outcomes & expected or not outcomes <= accepted
