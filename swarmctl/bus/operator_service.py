"""Operator service: receives commands from the bus and returns the agents' answers.

A command from a network moves aircraft, so an invalid command changes nothing. The service counts each
refusal. The operator gets an answer for each vehicle of an accepted command. The rate limit of a key fits
commands typed by hand; only commands with a valid signature count. New weights cause a new plan. So an agent
gets new weights only after it has handled the previous weights.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from swarmctl.bus import keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.rate import TokenBucket
from swarmctl.bus.transports.base import MAX_QUERY_BYTES, Reply, Transport
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    ENDING_ORDERS,
    BadMessage,
    GiveOrder,
    OperatorAnswer,
    Request,
    SetWeights,
    VehicleAnswer,
    decode_command,
    encode,
    refused_names,
)
from swarmctl.core.operator_text import excerpt, name_problems, printable, resolve_vehicles

ANSWER_WITHIN_S = 3.0
"""longest wait for the agents' answers; an agent in a long search may answer too late"""
PER_S = 4.0
BURST = 8
"""limits on commands with a valid signature under one key, refused or not: PER_S a second, BURST at once"""
CHECKED_PER_S = 200.0
"""Limit on signature checks of 0.1 to 0.3 ms under one key; further commands get no check and no answer.
If checks are cheap, all commands are checked, and further invalid commands get no answer."""
CHECKED_BURST = 100
SHOWN_PER_S, SHOWN_BURST = 0.1, 4
"""limits on messages about invalid signatures"""
TOO_FAST = encode(
    OperatorAnswer(
        refused=f"operators send more than {PER_S:g} commands a second; this command changed nothing, repeat "
        "it later [commands-too-fast]"
    )
)
KINDS: dict[type[Request], keys.RequestKind] = {SetWeights: "weights", GiveOrder: "order"}
"""kind of each command, for its key"""
BUSY = (
    "the vehicle has not handled its previous weights yet; nothing was changed, repeat the command later "
    "[vehicle-busy]"
)


@dataclass(slots=True)
class CommandCounts:
    """Numbers of received commands."""

    passed_on: int = 0
    refused: int = 0


@dataclass(slots=True)
class _PendingCommand:
    """A command that some agents have not answered yet."""

    uavs: list[int]
    unknown: Mapping[str, str]
    """names that no vehicle has, and the reasons"""
    reply: Reply
    answers: dict[int, VehicleAnswer]


@dataclass(slots=True)
class _RateLimit:
    """A limit on commands, and whether an excess was reported."""

    bucket: TokenBucket = field(default_factory=lambda: TokenBucket(PER_S, BURST))
    is_reported: bool = False
    """True if an excess was reported since the last pause"""


AgentCommand = ev.WeightsChanged | ev.OperatorCommand


class Agent(Protocol):
    """The agent of a vehicle, which carries out commands."""

    @property
    def name(self) -> str: ...

    def command(self, event: AgentCommand, answer_to: Callable[[VehicleAnswer], None]) -> None:
        """Take a command, and later call `answer_to` with the answer."""


RefusalCheck = Callable[[Request], str]
"""function that returns the reason to refuse a command now; empty: the command is accepted"""
ReturnDelays = Callable[[Sequence[int]], Mapping[int, float]]
"""function that returns the delay of each vehicle's return if all these vehicles are recalled [s]"""


class OperatorService:
    """The operator service of a process.

    `agents`: the agents of the process, by system id
    `uav`: the vehicle whose keys are served; None: the station's keys, if one process flies the whole swarm.
    """

    def __init__(
        self,
        transport: Transport,
        swarm: str,
        say: Callable[[str], None],
        agents: Mapping[int, Agent],
        *,
        uav: int | None = None,
        refusal: RefusalCheck = lambda _command: "",
        delays: ReturnDelays = lambda _uavs: {},
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.counts = CommandCounts()
        self._keys = {keys.request(swarm, kind, uav): kind for kind in keys.REQUEST_KINDS}
        self._refusal = refusal
        self._return_delays = delays
        self._authentication = authentication
        self._say = say
        self._agents = dict(agents)
        self._pending: dict[int, _PendingCommand] = {}
        self._busy: dict[int, int] = {}
        """vehicle -> number of the SetWeights command that the vehicle has not handled yet"""
        # Each key has its own limit: a flood of weights must not block an order to hold.
        self._limits = {key: _RateLimit() for key in self._keys}
        self._wildcard_limit = _RateLimit()
        self._signature_checks = {key: TokenBucket(CHECKED_PER_S, CHECKED_BURST) for key in self._keys}
        self._shown_invalid = TokenBucket(SHOWN_PER_S, SHOWN_BURST)
        for key in self._keys:
            transport.serve(key, self._receive)

    def _answered(self, command: int, answer: VehicleAnswer) -> None:
        """Record an agent's answer; an answer after the time-out is dropped."""
        if self._busy.get(answer.uav) == command:
            del self._busy[answer.uav]
        waiting = self._pending.get(command)
        if waiting is None:
            return
        waiting.answers[answer.uav] = answer
        if len(waiting.answers) == len(waiting.uavs):
            self._close(command)

    def _receive(self, key: str, payload: bytes | None, reply: Reply) -> None:
        now_s = asyncio.get_running_loop().time()
        if key not in self._keys:
            # A wildcard addresses many swarms at once.
            if self._is_within_rate(self._wildcard_limit, now_s):
                self._refuse(f"the key is {key}, expected {' or '.join(self._keys)}", None)
            return
        is_within_limit = self._signature_checks[key].try_take(now_s)
        if not (is_within_limit or self._authentication.is_cheap):
            self.counts.refused += 1
            return
        reply = self._signed_reply(key, payload, reply)
        try:
            verified = self._verified(key, payload)
        except BadMessage as error:
            is_shown = is_within_limit and self._shown_invalid.try_take(now_s)
            self._refuse(str(error), reply if is_within_limit else None, is_shown=is_shown)
            return
        # After the signature check: other senders must not use up the operator's rate.
        if self._is_within_rate(self._limits[key], now_s):
            self._execute(key, verified, reply)
        else:
            reply(TOO_FAST)

    def _signed_reply(self, key: str, payload: bytes | None, reply: Reply) -> Reply:
        if payload is None:
            return reply
        return lambda answer: reply(self._authentication.sign_answer(key, payload, answer))

    def _verified(self, key: str, payload: bytes | None) -> bytes:
        if payload is None:
            raise BadMessage(f"the payload is above the limit of {MAX_QUERY_BYTES} bytes")
        return self._authentication.verify(key, payload)

    def _execute(self, key: str, verified: bytes, reply: Reply) -> None:
        try:
            command = self._command(key, verified)
            uavs, unknown = self._vehicles(command)
            ignored = self._ignored_vehicles(command)
        except (BadMessage, ValueError) as error:
            self._refuse(str(error), reply)
            return
        # A change of weights causes a new plan; an order does not wait for that plan.
        busy = set() if isinstance(command, GiveOrder) else self._busy.keys() & set(uavs)
        if len(busy) < len(uavs):
            self._pass_on(command, uavs, unknown, ignored, busy, reply)
        else:
            self._refuse(f"no vehicle of the command is free: {BUSY}", reply)

    def _command(self, key: str, verified: bytes) -> Request:
        command = decode_command(verified)
        kind = KINDS[type(command)]
        if kind != self._keys[key]:
            raise BadMessage(f"the command is of kind {kind}, but arrived under the key {key}")
        if why := self._refusal(command):
            raise BadMessage(why)
        return command

    def _pass_on(
        self,
        command: Request,
        uavs: list[int],
        unknown: Mapping[str, str],
        ignored: tuple[int, ...],
        busy: Set[int],
        reply: Reply,
    ) -> None:
        self.counts.passed_on += 1
        number = self.counts.passed_on
        refusals = {u: VehicleAnswer(u, self._agents[u].name, "refused", note=BUSY) for u in busy}
        self._pending[number] = _PendingCommand(uavs, unknown, reply, refusals)
        asyncio.get_running_loop().call_later(ANSWER_WITHIN_S, partial(self._close, number))
        is_recall = isinstance(command, GiveOrder) and command.order == "return" and len(uavs) > 1
        delays = self._return_delays(uavs) if is_recall else {}
        for uav in (u for u in uavs if u not in busy):
            if isinstance(command, SetWeights):
                self._busy[uav] = number
            event = _event(number, command, delays.get(uav), ignored)
            self._agents[uav].command(event, partial(self._answered, number))

    def _vehicles(self, command: Request) -> tuple[list[int], dict[str, str]]:
        """Return the command's vehicles in the swarm's order, and the names that no vehicle has.

        An order that ends flights is for the vehicles with valid names: a misspelt name must not keep the
        others in the air. Raises ValueError for another command with such a name, and if no name is valid.
        """
        words, names = command.uavs, self._names()
        if words is None:
            return list(self._agents), {}
        ends_flights = isinstance(command, GiveOrder) and command.order in ENDING_ORDERS
        unknown = name_problems(words, names) if ends_flights else {}
        valid = [word for word in words if str(word) not in unknown]
        try:
            return resolve_vehicles(valid or words, names), unknown
        except ValueError as error:
            raise ValueError(f"nothing was changed: {error}") from None

    def _ignored_vehicles(self, command: Request) -> tuple[int, ...]:
        """Return the system ids of the vehicles that a launch ignores. Raises ValueError for an unknown name.

        This service has all names only if one process flies the whole swarm.
        """
        words = command.ignore if isinstance(command, GiveOrder) else ()
        ids = tuple(word for word in words if isinstance(word, int))
        if len(ids) == len(words):
            return ids
        try:
            return tuple(resolve_vehicles(words, self._names()))
        except ValueError as error:
            raise ValueError(f"nothing was changed: {error}") from None

    def _names(self) -> dict[int, str]:
        return {uav: agent.name for uav, agent in self._agents.items()}

    def _is_within_rate(self, limit: _RateLimit, now_s: float) -> bool:
        """Return whether a command is within the limit; report the first excess after each pause."""
        if limit.bucket.is_full(now_s):
            limit.is_reported = False
        if limit.bucket.try_take(now_s):
            return True
        self.counts.refused += 1
        if not limit.is_reported:
            self._say(
                f"operators send more than {PER_S:g} commands a second; the commands above this limit are "
                "refused [commands-too-fast]"
            )
        limit.is_reported = True
        return False

    def _close(self, number: int) -> None:
        """Reply with the vehicles' answers; a vehicle without an answer is unconfirmed."""
        waiting = self._pending.pop(number, None)
        if waiting is None:
            return
        answers = [waiting.answers.get(uav) or self._unconfirmed(uav) for uav in waiting.uavs]
        answers += refused_names(waiting.unknown)
        waiting.reply(encode(OperatorAnswer(vehicles=tuple(answers))))

    def _unconfirmed(self, uav: int) -> VehicleAnswer:
        note = (
            f"the agent received the command but did not handle it within {ANSWER_WITHIN_S:g} s; watch the "
            "vehicle, or repeat the command [not-handled-yet]"
        )
        return VehicleAnswer(uav, self._agents[uav].name, "unconfirmed", note=note)

    def _refuse(self, why: str, reply: Reply | None, *, is_shown: bool = True) -> None:
        self.counts.refused += 1
        why = excerpt(why)
        if is_shown:
            self._say(f"an operator's command was refused ({self.counts.refused} so far): {why}")
        if reply is not None:
            reply(encode(OperatorAnswer(refused=why)))


def _event(number: int, command: Request, delay_s: float | None, ignored: tuple[int, ...]) -> AgentCommand:
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
        case GiveOrder(order=order, after_s=after_s):
            by = printable(command.by)
            after_s = max((s for s in (after_s, delay_s) if s is not None), default=None)
            return ev.OperatorCommand(ev.FlightOrder(order), number, after_s, ignored, by=by)
