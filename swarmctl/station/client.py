"""An operator's commands to a swarm that another process flies: find it, ask it, hear what it says."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import msgspec

from swarmctl.bus import directory, keys
from swarmctl.bus.endpoint import NOBODY, BusEndpoint, parse_endpoint
from swarmctl.bus.operator_service import ANSWER_WITHIN_S, KINDS
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.config.joining import Swarm
from swarmctl.core.messages import (
    BadMessage,
    GiveOrder,
    OperatorAnswer,
    Request,
    VehicleAnswer,
    decode_answer,
    encode,
)
from swarmctl.core.texts import meant_by

TIMEOUT_S = ANSWER_WITHIN_S + 2.0


class Unclear(ValueError):
    """It is not said what is meant; the text says what to add."""


class NoAnswer(Exception):
    """Nobody has answered, or nothing that can be understood; the text says what is known then."""


@dataclass(frozen=True, slots=True)
class Station:
    """Where a swarm is found, and who answers there."""

    swarm: str
    endpoint: BusEndpoint
    others: tuple[BusEndpoint, ...] = ()
    """tried where nobody is at the first"""
    agents: Mapping[int, str] = field(default_factory=dict)
    """the vehicles (system id: name) whose agents answer each for itself; empty: one answers for all"""


class Seals(Protocol):
    """Shows who gives a command, and tells who answers it."""

    def close(self, key: str, command: bytes) -> bytes:
        """The payload to ask `key` with."""

    def open(self, uav: int, key: str, asked: bytes, data: bytes) -> bytes:
        """What `uav` answered to the payload `asked`. Raises BadMessage where that is not its answer."""


class _Unsealed:
    def close(self, _key: str, command: bytes) -> bytes:
        return command

    def open(self, _uav: int, _key: str, _asked: bytes, data: bytes) -> bytes:
        return data


UNSEALED: Seals = _Unsealed()
"""Nobody shows who it is, and everybody is believed."""


def meant(uavs: list[str], everyone: bool) -> tuple[str, ...] | None:
    """Names or system ids, as given: the swarm knows which is which. None for all. Raises Unclear."""
    if everyone == bool(uavs):
        raise Unclear("which vehicles? give --uav NAME (or its system id), which may be repeated, or --all")
    return None if everyone else tuple(uavs)


def strengths(text: str, single: tuple[float | None, ...]) -> tuple[float, float, float] | None:
    """All three or none: the swarm's own are not known here. Raises Unclear."""
    if text and any(value is not None for value in single):
        raise Unclear("--firing-strength says all three; leave the others away")
    try:
        values = [float(part) for part in text.split(",")] if text else [v for v in single if v is not None]
    except ValueError:
        raise Unclear(f"--firing-strength {text!r}: expected three numbers, such as 0.7,0.3,0.1") from None
    if not values:
        return None
    if len(values) != 3:
        raise Unclear(
            f"firing strengths: found {len(values)}, expected three: --firing-strength 0.7,0.3,0.1, or "
            "--direct, --first-neighbour and --second-neighbour"
        )
    return values[0], values[1], values[2]


def find(
    swarm: str | None,
    config: Swarm | None,
    connect: str | None,
    names: Mapping[int, str] | None = None,
) -> Station:
    """The flight that is meant: by where it listens, by name, or the only one of this machine.

    `names` are the vehicles of `config`, which answer each for itself where their agents run on machines of
    their own. Raises Unclear, and BusError where no such swarm flies.
    """
    swarm = _name(swarm, config)
    apart = config is not None and is_apart(config)
    if connect is not None:
        if swarm is None:
            raise Unclear("--connect says where; --swarm NAME or --config F says which swarm")
        return Station(swarm, _endpoint(connect), agents=names or {} if apart else {})
    if config is not None and apart:
        here = [entry for entry in directory.flying() if entry.swarm == swarm]
        if len(here) == 1:  # somebody flies all of it in one process, on this machine
            return Station(here[0].swarm, here[0].endpoint)
        points = meeting_points(config)
        return Station(config.name, points[0], tuple(points[1:]), names or {})
    if config is not None:
        if config.communication.bus != "zenoh" or config.communication.listen == NOBODY:
            raise Unclear(f"{swarm} listens to nobody: `communication` has bus: memory, or listen: none")
        listen = parse_endpoint(config.communication.listen)
        if listen.port != 0:
            return Station(config.name, listen.reachable)
    flying = directory.flying()
    meant = [entry for entry in flying if swarm in (None, entry.swarm)]
    if len(meant) == 1:
        return Station(meant[0].swarm, meant[0].endpoint)
    if meant:
        there = ", ".join(f"{e.swarm} at {e.endpoint} (process {e.pid})" for e in meant)
        raise Unclear(f"{len(meant)} swarms fly here: {there}; --swarm NAME or --connect says which is meant")
    others = f"; there is {', '.join(e.swarm for e in flying)}" if flying else ""
    raise BusError(
        f"no swarm {swarm or ''}".rstrip() + f" of this user flies on this machine{others}; a flight takes "
        "commands in real time only (not with --clock virtual), and not with bus: memory or listen: none; "
        "agents on machines of their own are found with --config"
    )


def is_apart(config: Swarm) -> bool:
    """Whether its agents may run on machines of their own."""
    return config.communication.router is not None or bool(config.communication.mesh)


def meeting_points(config: Swarm) -> list[BusEndpoint]:
    """Where a swarm on many machines is joined: the router, or any node of the mesh."""
    c = config.communication
    return [parse_endpoint(text) for text in ([c.router] if c.router is not None else c.mesh.values())]


def _name(swarm: str | None, config: Swarm | None) -> str | None:
    if swarm is not None and not re.fullmatch(keys.SWARM_NAME, swarm):
        raise Unclear(f"--swarm {swarm!r}: expected a name as in a configuration: {keys.SWARM_NAME}")
    if swarm is not None and config is not None and swarm != config.name:
        raise Unclear(f"--swarm {swarm}, but the configuration is that of {config.name}; give one of them")
    return config.name if config is not None else swarm


def _endpoint(text: str) -> BusEndpoint:
    try:
        endpoint = parse_endpoint(text)
    except ValueError as error:
        raise Unclear(f"--connect: {error}") from None
    if endpoint.port == 0:
        raise Unclear("--connect: nobody is found at port 0; give the port that the flight listens at")
    return endpoint


async def give(
    station: Station,
    command: Request,
    credentials: Credentials | None = None,
    seals: Seals = UNSEALED,
) -> OperatorAnswer:
    """Give the command and wait for the answer. Raises BusError, Unclear and NoAnswer."""
    with visited(station, credentials) as bus:
        return await ask(bus, station, command, seals)


@contextlib.contextmanager
def visited(station: Station, credentials: Credentials | None = None) -> Iterator[ZenohBus]:
    """A bus for a moment, at the first of the station's endpoints where somebody is. Raises BusError."""
    failures: list[str] = []
    for endpoint in (station.endpoint, *station.others):
        try:
            bus = ZenohBus(zenoh_config.visitor(endpoint, credentials))
        except BusError as error:
            failures.append(str(error))
            continue
        with bus:
            yield bus
        return
    raise BusError("; ".join(failures))


async def ask(bus: Transport, station: Station, command: Request, seals: Seals = UNSEALED) -> OperatorAnswer:
    """The same on a bus that is open. Raises Unclear and NoAnswer.

    A station where one process flies all asks for no seal, and signs nothing.
    """
    kind = KINDS[type(command)]
    if station.agents:
        return await _ask_each(bus, station, kind, command, seals)
    key = keys.request(station.swarm, kind)
    try:
        answers = await bus.ask(key, encode(command), TIMEOUT_S)
    except TimeoutError:
        raise NoAnswer(
            f"{station.swarm} at {station.endpoint} did not answer within {TIMEOUT_S:g} s: whether it took "
            "the command is not known; look at its table, or give it again"
        ) from None
    if not answers:
        raise NoAnswer(
            f"no swarm {station.swarm} is at {station.endpoint}, or it is asked more than it can answer; "
            "nothing was changed"
        )
    if len(answers) > 1:
        raise NoAnswer(
            f"{len(answers)} processes answer for {station.swarm} at {station.endpoint}: what became of the "
            "command is not known; end all but one, and look at its table"
        )
    try:
        return decode_answer(answers[0])
    except BadMessage as error:
        raise NoAnswer(
            f"{station.swarm} at {station.endpoint} answered what cannot be understood: {error}; is it of "
            "another version of this program?"
        ) from error


async def _ask_each(
    bus: Transport, station: Station, kind: keys.Kind, command: Request, seals: Seals
) -> OperatorAnswer:
    """Every vehicle's own agent, all at once: a silent one keeps nobody waiting. Raises Unclear."""
    try:
        uavs = list(station.agents if command.uavs is None else meant_by(command.uavs, station.agents))
        if isinstance(command, GiveOrder) and command.past:  # an agent knows nobody's name but its own
            past = tuple(meant_by(command.past, station.agents))
            command = msgspec.structs.replace(command, past=past)
    except ValueError as error:
        raise Unclear(f"nothing was changed: {error}") from None

    async def one(uav: int) -> VehicleAnswer:
        key, name = keys.request(station.swarm, kind, uav), station.agents[uav]
        payload = seals.close(key, encode(msgspec.structs.replace(command, uavs=(uav,))))
        try:
            answers = await bus.ask(key, payload, TIMEOUT_S)
        except TimeoutError:
            note = f"its agent did not answer within {TIMEOUT_S:g} s"
            return VehicleAnswer(uav, name, "unconfirmed", note=note)
        own = list(_own(seals, uav, key, payload, answers))
        return _of_one(uav, name, own, len(answers) - len(own))

    return OperatorAnswer(tuple(await asyncio.gather(*map(one, uavs))))


def _own(seals: Seals, uav: int, key: str, asked: bytes, answers: Sequence[bytes]) -> Iterator[bytes]:
    """Those that the vehicle itself has given."""
    for data in answers:
        with contextlib.suppress(BadMessage):
            yield seals.open(uav, key, asked, data)


def _of_one(uav: int, name: str, answers: Sequence[bytes], dropped: int) -> VehicleAnswer:
    """What one agent answered; `dropped` were given in its name, and not by it."""
    if not dropped:
        return _answer_of_one(uav, name, answers)
    warning = (
        f"{dropped} answer{'s' if dropped > 1 else ''} in its name that it did not sign "
        "(somebody else serves its key, or it has other keys)"
    )
    if not answers:
        return VehicleAnswer(uav, name, "unconfirmed", note=f"none of its own, and {warning}")
    answer = _answer_of_one(uav, name, answers)
    note = f"{answer.note}; " if answer.note else ""
    return msgspec.structs.replace(answer, note=f"{note}dropped: {warning}")


def _answer_of_one(uav: int, name: str, answers: Sequence[bytes]) -> VehicleAnswer:
    if not answers:
        note = "no agent of it is in touch: is `swarmctl agent` running there, and does it reach the network?"
        return VehicleAnswer(uav, name, "silent", note=note)
    if len(answers) > 1:
        note = f"{len(answers)} agents answer for it: end all but one"
        return VehicleAnswer(uav, name, "unconfirmed", note=note)
    try:
        answer = decode_answer(answers[0])
    except BadMessage as error:
        note = f"its answer cannot be understood: {error}; is it of another version of this program?"
        return VehicleAnswer(uav, name, "unconfirmed", note=note)
    if answer.refused:
        return VehicleAnswer(uav, name, "refused", note=answer.refused)
    if [vehicle.uav for vehicle in answer.vehicles] != [uav]:
        return VehicleAnswer(uav, name, "unconfirmed", note="its agent answered for another vehicle")
    return answer.vehicles[0]


def has_failed(command: Request, answer: OperatorAnswer) -> bool:
    """Whether it is not as ordered. Of a whole swarm those whose flight is over need not take it."""
    outcomes = {vehicle.outcome for vehicle in answer.vehicles}
    fine = {"taken", "over"} if command.uavs is None else {"taken"}
    return bool(answer.refused) or "taken" not in outcomes or not outcomes <= fine
