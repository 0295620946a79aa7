"""Client of a flight: finds a swarm, sends signed requests, and decodes the answers."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Literal, TypeVar

import msgspec

from swarmctl.bus import directory, keys, sensor_reports
from swarmctl.bus.authentication import NO_AUTHENTICATION, NotAuthorised, RequestSigning
from swarmctl.bus.endpoint import NO_ENDPOINT, BusEndpoint, parse_endpoint
from swarmctl.bus.operator_service import ANSWER_WITHIN_S
from swarmctl.bus.sensor_reports import Report, ReportAnswer
from swarmctl.bus.transports import BUSES, zenoh_config
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.config.roster import Roster
from swarmctl.core.messages import BadMessage, Refusal, SwarmVehicles, decode_answer
from swarmctl.core.operator_text import did_you_mean

TIMEOUT_S = ANSWER_WITHIN_S + 2.0
A = TypeVar("A")


class BadOptions(ValueError):
    """Missing, invalid or contradictory options of a command; the text has the remedy."""


class NoValidAnswer(Exception):
    """A request without a valid answer; the text states whether the request may have had an effect."""

    def __init__(
        self, text: str, outcome: Literal["refused", "silent", "unconfirmed"] = "unconfirmed"
    ) -> None:
        super().__init__(text)
        self.outcome = outcome


class FlightEndpoints(msgspec.Struct, frozen=True):
    """Endpoints of a swarm in flight, and its vehicles."""

    swarm: str
    endpoint: BusEndpoint
    others: tuple[BusEndpoint, ...] = ()
    """further endpoints, tried in order"""
    agents: Mapping[int, str] = msgspec.field(default_factory=dict)
    """vehicles (system id: name) with agents in separate processes; empty: one process flies all vehicles,
    and knows them"""

    @property
    def text(self) -> str:
        """Swarm and endpoint, for messages."""
        return f"{self.swarm} at {self.endpoint}"


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


class Receiver(msgspec.Struct, frozen=True):
    """The receiver of a request."""

    key: str
    name: str
    """the receiver, for messages"""
    absent: str
    """message if no process serves the key"""
    advice: str
    """effect of a request without an answer in time, and what to do"""
    uav: int | None = None
    """vehicle whose agent answers; None: the process that flies all vehicles"""


async def exchange(
    bus: Transport,
    receiver: Receiver,
    request: bytes,
    signing: RequestSigning,
    decode: Callable[[bytes], A],
) -> tuple[A, str]:
    """Send a signed request over an open bus; return its only valid answer, and a note about dropped answers.

    In a mesh any node may answer for any key, so only the receiver's signature counts. Raises NoValidAnswer.
    """
    name = receiver.name
    try:
        payload = signing.sign(receiver.uav, receiver.key, request)
        answers = await bus.ask(receiver.key, payload, TIMEOUT_S)
    except NotAuthorised as error:
        raise NoValidAnswer(str(error), "refused") from None
    except TimeoutError:
        raise NoValidAnswer(
            f"{name} did not answer within {TIMEOUT_S:g} s. {receiver.advice} [no-answer]"
        ) from None
    if not answers:
        raise NoValidAnswer(receiver.absent, "silent")
    verified = []
    for data in answers:
        with contextlib.suppress(BadMessage):
            verified.append(signing.verify_answer(receiver.uav, receiver.key, payload, data))
    n_dropped = len(answers) - len(verified)
    dropped = f"answers without the receiver's signature: {n_dropped}"
    if not verified:
        raise NoValidAnswer(
            f"{name} gives no valid answer; {dropped}. The receiver has another token or other keys and "
            "refused the request, or another program answers. Send the request as the user of the flight, or "
            "set SWARMCTL_TOKEN_FILE for both [wrong-token]"
        )
    if len(verified) > 1:
        raise NoValidAnswer(
            f"{len(verified)} processes answer for {name}, so the result of the request is unknown; end all "
            "processes but one, and check the remaining flight's table"
        )
    try:
        answer = decode(verified[0])
    except ValueError as error:
        raise NoValidAnswer(
            f"{name} sent an invalid answer: {error}. The request may have had an effect; the receiver may "
            "run another version of this program"
        ) from error
    return answer, f"{dropped}; another program answers, and was ignored" if n_dropped else ""


async def vehicles_of(
    bus: Transport, flight: FlightEndpoints, signing: RequestSigning = NO_AUTHENTICATION
) -> Mapping[int, str]:
    """Return the names of a flight's vehicles, by system id. Raises NoValidAnswer."""
    if flight.agents:
        return flight.agents
    absent = (
        f"no swarm {flight.swarm} answers at {flight.endpoint}, or the swarm's queue of commands is full; "
        "nothing was changed [not-served]"
    )
    receiver = Receiver(keys.swarm_vehicles(flight.swarm), flight.text, absent, "Nothing was changed")
    answer, _ = await exchange(bus, receiver, b"", signing, partial(decode_answer, kind=SwarmVehicles))
    if isinstance(answer, Refusal):
        raise NoValidAnswer(answer.why, "refused")
    return answer.names


async def report(
    bus: Transport,
    flight: FlightEndpoints,
    uav: int,
    observed: Report,
    signing: RequestSigning = NO_AUTHENTICATION,
) -> ReportAnswer:
    """Send a report of observations over an open bus and return the answer. Raises NoValidAnswer."""
    absent = (
        f"vehicle {uav} of {flight.swarm} accepts no reports at {flight.endpoint}: its flight may have "
        "ended, or the vehicle is not of this swarm, or its configuration lacks `sensor: {source: external}` "
        "or `both` [no-report-receiver]"
    )
    key = keys.sensor_report(flight.swarm, uav)
    advice = "The vehicle may have accepted the report; a repeated report counts as a second observation"
    receiver = Receiver(key, flight.text, absent, advice, uav)
    encoded, decode = sensor_reports.encode(observed), sensor_reports.decode_answer
    answer, _ = await exchange(bus, receiver, encoded, signing, decode)
    return answer
