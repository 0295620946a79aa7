"""An operator's commands to a swarm that another process flies: find it, ask it, hear what it says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from swarmctl.bus import directory, keys
from swarmctl.bus.base import BusError, Transport
from swarmctl.bus.desk import ANSWER_WITHIN_S
from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.open import NOBODY
from swarmctl.bus.zenoh_bus import ZenohBus
from swarmctl.config import Config
from swarmctl.core.messages import BadMessage, SetWeights, WeightsAnswer, decode_answer, encode

TIMEOUT_S = ANSWER_WITHIN_S + 2.0


class Unclear(ValueError):
    """It is not said what is meant; the text says what to add."""


class NoAnswer(Exception):
    """Nobody has answered, or nothing that can be understood; the text says what is known then."""


@dataclass(frozen=True, slots=True)
class Station:
    """A ground station and the swarm it flies."""

    swarm: str
    endpoint: BusEndpoint


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


def find(swarm: str | None, config: Config | None, connect: str | None) -> Station:
    """The flight that is meant: by where it listens, by name, or the only one of this machine.

    Raises Unclear, and BusError where no such swarm flies.
    """
    swarm = _name(swarm, config)
    if connect is not None:
        if swarm is None:
            raise Unclear("--connect says where; --swarm NAME or --config F says which swarm")
        return Station(swarm, _endpoint(connect))
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
        "commands in real time only (not with --clock virtual), and not with bus: memory or listen: none"
    )


def _name(swarm: str | None, config: Config | None) -> str | None:
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


async def set_weights(station: Station, command: SetWeights) -> WeightsAnswer:
    """Give the command and wait for the answer. Raises BusError and NoAnswer."""
    with ZenohBus(connect=station.endpoint) as bus:
        return await ask(bus, station, command)


async def ask(bus: Transport, station: Station, command: SetWeights) -> WeightsAnswer:
    """The same on a bus that is open. Raises NoAnswer."""
    try:
        answers = await bus.ask(keys.weights(station.swarm), encode(command), TIMEOUT_S)
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
    try:
        return decode_answer(answers[0])
    except BadMessage as error:
        raise NoAnswer(
            f"{station.swarm} at {station.endpoint} answered what cannot be understood: {error}; is it of "
            "another version of this program?"
        ) from error


def has_failed(command: SetWeights, answer: WeightsAnswer) -> bool:
    """Whether it is not as ordered. Of a whole swarm those that plan no more need not take it."""
    outcomes = {vehicle.outcome for vehicle in answer.vehicles}
    fine = {"taken", "over"} if command.uavs is None else {"taken"}
    return bool(answer.refused) or "taken" not in outcomes or not outcomes <= fine
