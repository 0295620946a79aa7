"""Operator service: receives commands from the bus and returns the agents' answers.

Each vehicle has keys of its own, so a command reaches one agent and has one answer. A command from a network
moves aircraft, so an invalid command changes nothing. The service counts each refusal. The rate limit of a
key fits commands typed by hand; only commands with a valid signature count. New weights cause a new plan. So
an agent gets new weights only after it has handled the previous weights.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from swarmctl.bus import keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.rate import TokenBucket
from swarmctl.bus.transports.base import MAX_QUERY_BYTES, Reply, Transport
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    GiveOrder,
    Refusal,
    Request,
    SetWeights,
    SwarmVehicles,
    VehicleAnswer,
    decode_command,
    encode,
)
from swarmctl.core.operator_text import excerpt, listed, printable

ANSWER_WITHIN_S = 3.0
"""longest wait for an agent's answer; an agent in a long search may answer too late"""
PER_S = 4.0
BURST = 8
"""limits on commands with a valid signature under one key, refused or not: PER_S a second, BURST at once"""
CHECKED_PER_S = 200.0
"""Limit on signature checks of 0.1 to 0.3 ms under one key; further commands get no check and no answer.
If checks are cheap, all commands are checked, and further invalid commands get no answer."""
CHECKED_BURST = 100
SHOWN_PER_S, SHOWN_BURST = 0.1, 4
"""limits on messages about refused commands"""
TOO_FAST = (
    f"operators send more than {PER_S:g} commands a second to one vehicle; this command changed nothing, "
    "repeat it later [commands-too-fast]"
)
KINDS: dict[type[Request], keys.RequestKind] = {SetWeights: "weights", GiveOrder: "order"}
"""kind of each command, for its key"""
BUSY = (
    "the vehicle has not handled its previous weights yet; nothing was changed, repeat the command later "
    "[vehicle-busy]"
)
UNCONFIRMED = (
    f"the agent received the command but did not handle it within {ANSWER_WITHIN_S:g} s; watch the vehicle, "
    "or repeat the command [not-handled-yet]"
)


@dataclass(slots=True)
class CommandCounts:
    """Numbers of received commands, each to one vehicle."""

    passed_on: int = 0
    refused: int = 0


@dataclass(slots=True)
class _ServedKey:
    execute: Callable[[bytes, Reply], None]
    """function that executes a request with a valid signature; raises BadMessage for a refused request"""
    checks: TokenBucket = field(default_factory=lambda: TokenBucket(CHECKED_PER_S, CHECKED_BURST))


AgentCommand = ev.WeightsChanged | ev.OperatorCommand


class Agent(Protocol):
    """The agent of a vehicle, which carries out commands."""

    @property
    def name(self) -> str: ...

    def command(self, event: AgentCommand, answer_to: Callable[[VehicleAnswer], None]) -> None:
        """Take a command, and later call `answer_to` with the answer."""


RefusalCheck = Callable[[Request], str]
"""function that returns the reason to refuse a command now; empty: the command is accepted"""


class OperatorService:
    """The operator service of a process, under the keys of its vehicles.

    `agents`: the agents of the process, by system id
    `flies_all`: the process flies the whole swarm, and also answers which vehicles the swarm has.
    """

    def __init__(
        self,
        transport: Transport,
        swarm: str,
        say: Callable[[str], None],
        agents: Mapping[int, Agent],
        *,
        flies_all: bool,
        refusal: RefusalCheck = lambda _command: "",
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.counts = CommandCounts()
        self._refusal = refusal
        self._authentication = authentication
        self._say = say
        self._agents = dict(agents)
        self._pending: dict[int, Reply] = {}
        """command number -> reply to a command without an answer yet"""
        self._busy: dict[int, int] = {}
        """vehicle -> number of the SetWeights command that the vehicle has not handled yet"""
        self._shown = TokenBucket(SHOWN_PER_S, SHOWN_BURST)
        self._keys = {
            # Each key has its own limit: a flood of weights must not block an order to hold.
            keys.request(swarm, kind, uav): _ServedKey(
                partial(self._command, uav, kind, TokenBucket(PER_S, BURST))
            )
            for uav in agents
            for kind in keys.REQUEST_KINDS
        }
        if flies_all:
            self._keys[keys.swarm_vehicles(swarm)] = _ServedKey(self._answer_vehicles)
        for key in self._keys:
            transport.serve(key, self._receive)

    def _receive(self, key: str, payload: bytes | None, reply: Reply) -> None:
        now_s = asyncio.get_running_loop().time()
        served = self._keys.get(key)
        if served is None:
            # A wildcard addresses many vehicles at once.
            self._refuse(f"the key is {key}, expected the key of one vehicle", now_s)
            return
        is_within_limit = served.checks.try_take(now_s)
        if not (is_within_limit or self._authentication.is_cheap):
            self.counts.refused += 1
            return
        reply = self._signed_reply(key, payload, reply)
        try:
            verified = self._verified(key, payload)
        except BadMessage as error:
            self._refuse(str(error), now_s, reply if is_within_limit else None)
            return
        try:
            served.execute(verified, reply)
        except BadMessage as error:
            self._refuse(str(error), now_s, reply)

    def _signed_reply(self, key: str, payload: bytes | None, reply: Reply) -> Reply:
        if payload is None:
            return reply
        return lambda answer: reply(self._authentication.sign_answer(key, payload, answer))

    def _verified(self, key: str, payload: bytes | None) -> bytes:
        if payload is None:
            raise BadMessage(f"the payload is above the limit of {MAX_QUERY_BYTES} bytes")
        return self._authentication.verify(key, payload)

    def _answer_vehicles(self, _request: bytes, reply: Reply) -> None:
        reply(encode(SwarmVehicles({uav: agent.name for uav, agent in self._agents.items()})))

    def _command(
        self, uav: int, kind: keys.RequestKind, limit: TokenBucket, verified: bytes, reply: Reply
    ) -> None:
        """Pass a command to the agent of vehicle `uav`. Raises BadMessage for a refused command."""
        loop = asyncio.get_running_loop()
        # After the signature check: other senders must not use up the operator's rate.
        if not limit.try_take(loop.time()):
            raise BadMessage(TOO_FAST)
        command = decode_command(verified)
        found = KINDS[type(command)]
        if found != kind or command.uavs != (uav,):
            named = "all vehicles" if command.uavs is None else listed(map(str, command.uavs))
            raise BadMessage(f"the command is of kind {found} for {named}, expected {kind} for vehicle {uav}")
        if why := self._refusal(command):
            raise BadMessage(why)
        # A change of weights causes a new plan; an order does not wait for that plan.
        if isinstance(command, SetWeights) and uav in self._busy:
            raise BadMessage(BUSY)
        agent, number = self._agents[uav], self.counts.passed_on + 1
        event = _event(number, command)
        self.counts.passed_on = number
        if isinstance(command, SetWeights):
            self._busy[uav] = number
        self._pending[number] = reply
        unconfirmed = VehicleAnswer(uav, agent.name, "unconfirmed", note=UNCONFIRMED)
        loop.call_later(ANSWER_WITHIN_S, self._reply, number, unconfirmed)
        agent.command(event, partial(self._answered, number))

    def _answered(self, number: int, answer: VehicleAnswer) -> None:
        if self._busy.get(answer.uav) == number:
            del self._busy[answer.uav]
        self._reply(number, answer)

    def _reply(self, number: int, answer: VehicleAnswer) -> None:
        """Reply to a command once; an answer after the time-out is dropped."""
        if (reply := self._pending.pop(number, None)) is not None:
            reply(encode(answer))

    def _refuse(self, why: str, now_s: float, reply: Reply | None = None) -> None:
        self.counts.refused += 1
        why = excerpt(why)
        if self._shown.try_take(now_s):
            self._say(f"an operator's command was refused ({self.counts.refused} so far): {why}")
        if reply is not None:
            reply(encode(Refusal(why)))


def _event(number: int, command: Request) -> AgentCommand:
    """Return the event for the agent. Raises BadMessage."""
    match command:
        case SetWeights():
            return ev.WeightsChanged(
                number,
                command.w,
                command.strength,
                command.range,
                printable(command.by),
                {printable(name): weight for name, weight in command.behaviours.items()},
            )
        case GiveOrder(order=order, after_s=after_s, ignore=ignore):
            ids = tuple(word for word in ignore if isinstance(word, int))
            if len(ids) < len(ignore):
                raise BadMessage(f"vehicles to ignore are {listed(map(str, ignore))}, expected system ids")
            return ev.OperatorCommand(ev.FlightOrder(order), number, after_s, ids, by=printable(command.by))
