"""The operator's desk: commands come in by the bus, the agents' answers go back by it.

A command from a network moves aircraft, so what is not plainly a command for this desk and its vehicles is
refused as a whole, counted, and said; and whoever gave it is told what became of it, vehicle by vehicle. They
come no faster than a hand gives them, and what no operator gave uses up nothing of that. New weights cost a
plan, so no agent is given any before it has come to the last.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from swarmctl.bus import keys
from swarmctl.bus.rate import TokenBucket
from swarmctl.bus.transports.base import MAX_QUESTION_BYTES, Reply, Transport
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    GiveOrder,
    OperatorAnswer,
    Request,
    SetWeights,
    VehicleAnswer,
    decode_command,
    encode,
)
from swarmctl.core.texts import printable, resolve_vehicles

ANSWER_WITHIN_S = 3.0
"""An agent in the middle of a long search answers when it is through."""
MAX_WHY = 400
PER_S = 4.0
BURST = 8
"""Commands that open, good or bad: so many at once, and so many a second in the long run."""
OPENED_PER_S = 200.0
"""What is opened at all; to verify a signature takes 0.1 to 0.3 ms. More is neither read nor answered."""
OPENED_BURST = 100
SAID_PER_S, SAID_BURST = 0.1, 4
"""About what does not open: so much is said."""
TOO_FAST = encode(
    OperatorAnswer(
        refused=f"commands come faster than {PER_S:g} a second; nothing was changed, give it again later"
    )
)
KINDS: dict[type[Request], keys.Kind] = {SetWeights: "weights", GiveOrder: "order"}
"""Under which key each is asked."""
BEFORE = "the command before this one yet; give this one again later"


@dataclass(slots=True)
class CommandCounts:
    """How many commands came."""

    passed_on: int = 0
    refused: int = 0


@dataclass(slots=True)
class _Open:
    """A command that has been passed on."""

    uavs: list[int]
    reply: Reply
    answers: dict[int, VehicleAnswer] = field(default_factory=dict)


@dataclass(slots=True)
class _Gate:
    """How fast commands may come."""

    pace: TokenBucket = field(default_factory=lambda: TokenBucket(PER_S, BURST))
    said: bool = False
    """that they come too fast, since the last pause"""


AgentCommand = ev.WeightsChanged | ev.OperatorCommand
RefusalCheck = Callable[[Request], str]
"""why a command is not taken now; empty if it is"""
ReturnDelays = Callable[[Sequence[int]], Mapping[int, float]]
"""how long each of these vehicles, called back at once, waits for its turn to return [s]"""


def accept_all(_command: Request) -> str:
    return ""


def no_delays(_uavs: Sequence[int]) -> Mapping[int, float]:
    return {}


class CommandSeal(Protocol):
    """Tells who gives a command, and shows who answers it."""

    def open(self, key: str, payload: bytes) -> bytes:
        """The command in `payload`, which came under `key`. Raises BadMessage where the sender may not."""

    def close(self, key: str, payload: bytes, answer: bytes) -> bytes:
        """The bytes that answer it."""


class _Unsealed:
    def open(self, _key: str, payload: bytes) -> bytes:
        return payload

    def close(self, _key: str, _payload: bytes, answer: bytes) -> bytes:
        return answer


NO_SEAL: CommandSeal = _Unsealed()
"""Nobody is asked who it is."""


class OperatorService:
    """One a process; its agents `join`, and report with `answered`.

    It serves the keys of vehicle `uav`, or those of the station where one process flies the whole swarm.
    `unseal` opens payloads and closes answers.
    """

    def __init__(
        self,
        transport: Transport,
        swarm: str,
        say: Callable[[str], None],
        counts: CommandCounts,
        *,
        uav: int | None = None,
        closed: RefusalCheck = accept_all,
        turns: ReturnDelays = no_delays,
        unseal: CommandSeal = NO_SEAL,
    ) -> None:
        self._counts = counts
        self._keys = {keys.request(swarm, kind, uav): kind for kind in keys.KINDS}
        self._closed = closed
        self._turns = turns
        self._unseal = unseal
        self._say = say
        self._agents: dict[int, tuple[str, Callable[[AgentCommand], None]]] = {}
        self._open: dict[int, _Open] = {}
        self._busy: dict[int, int] = {}
        """by vehicle: the weights that it has not come to yet, perhaps long after its answer was due"""
        # Each key for itself: no flood of weights keeps an order to hold away.
        self._gates = {key: _Gate() for key in self._keys}
        self._wild = _Gate()
        self._opened = {key: TokenBucket(OPENED_PER_S, OPENED_BURST) for key in self._keys}
        self._said_of_strangers = TokenBucket(SAID_PER_S, SAID_BURST)
        for key in self._keys:
            transport.serve(key, self._asked)

    def join(self, uav: int, name: str, post: Callable[[AgentCommand], None]) -> None:
        """`post` hands an event to the agent, which answers with an effect."""
        self._agents[uav] = (name, post)

    def answered(self, command: int, answer: VehicleAnswer) -> None:
        """What an agent made of a command; too late an answer is nobody's any more."""
        if self._busy.get(answer.uav) == command:
            del self._busy[answer.uav]
        waiting = self._open.get(command)
        if waiting is None:
            return
        waiting.answers[answer.uav] = answer
        if len(waiting.answers) == len(waiting.uavs):
            self._close(command)

    def _asked(self, key: str, payload: bytes | None, reply: Reply) -> None:
        now_s = asyncio.get_running_loop().time()
        if key not in self._keys:
            # A wildcard asks many swarms at once; whoever means this one can say so.
            if self._in_pace(self._wild, now_s):
                self._refuse(f"asked under the key {key}, not {' or '.join(self._keys)}", None)
            return
        if not self._opened[key].try_take(now_s):
            self._counts.refused += 1
            return
        reply = self._sealed(key, payload, reply)
        try:
            opened = self._open_seal(key, payload)
        except BadMessage as error:
            self._refuse(str(error), reply, aloud=self._said_of_strangers.try_take(now_s))
            return
        # Only now: nobody else uses up the operator's pace.
        if self._in_pace(self._gates[key], now_s):
            self._do(key, opened, reply)
        else:
            reply(TOO_FAST)

    def _sealed(self, key: str, payload: bytes | None, reply: Reply) -> Reply:
        """Answers as one of this vehicle, to what was asked and nothing else."""
        if payload is None:
            return reply
        return lambda answer: reply(self._unseal.close(key, payload, answer))

    def _open_seal(self, key: str, payload: bytes | None) -> bytes:
        """Raises BadMessage."""
        if payload is None:
            raise BadMessage(f"a payload of more than {MAX_QUESTION_BYTES} bytes, which no command takes")
        return self._unseal.open(key, payload)

    def _do(self, key: str, opened: bytes, reply: Reply) -> None:
        try:
            command = self._command(key, opened)
            uavs = self._meant(command)
            past = self._past(command)
        except (BadMessage, ValueError) as error:
            self._refuse(str(error), reply)
            return
        # Each change of weights costs a plan; an order is not kept waiting for that.
        busy = set() if isinstance(command, GiveOrder) else self._busy.keys() & set(uavs)
        if len(busy) < len(uavs):
            self._pass_on(command, uavs, past, busy, reply)
        else:
            self._refuse(f"no vehicle named has come to {BEFORE}", reply)

    def _command(self, key: str, opened: bytes) -> Request:
        """Raises BadMessage."""
        command = decode_command(opened)
        kind = KINDS[type(command)]
        if kind != self._keys[key]:
            raise BadMessage(f"a command of the kind {kind} under the key {key}")
        if why := self._closed(command):
            raise BadMessage(why)
        return command

    def _pass_on(
        self, command: Request, uavs: list[int], past: tuple[int, ...], busy: Set[int], reply: Reply
    ) -> None:
        self._counts.passed_on += 1
        number = self._counts.passed_on
        self._open[number] = _Open(uavs, reply, {u: self._too_busy(u) for u in uavs if u in busy})
        asyncio.get_running_loop().call_later(ANSWER_WITHIN_S, partial(self._close, number))
        returns = isinstance(command, GiveOrder) and command.order == "return"
        turns = self._turns(uavs) if returns else {}
        for uav in (u for u in uavs if u not in busy):
            if isinstance(command, SetWeights):
                self._busy[uav] = number
            self._agents[uav][1](_event(number, command, turns.get(uav, 0.0), past))

    def _meant(self, command: Request) -> list[int]:
        """The vehicles, in the swarm's order. Raises ValueError where one is not of this swarm."""
        if command.uavs is None:
            return list(self._agents)
        try:
            return resolve_vehicles(command.uavs, {uav: name for uav, (name, _) in self._agents.items()})
        except ValueError as error:
            raise ValueError(f"nothing was changed: {error}") from None

    def _past(self, command: Request) -> tuple[int, ...]:
        """The system ids of those that a launch does not wait for. Raises ValueError for a name that is not
        known here, as all are only where one process flies the whole swarm."""
        words = command.ignore if isinstance(command, GiveOrder) else ()
        ids = tuple(word for word in words if isinstance(word, int))
        if len(ids) == len(words):
            return ids
        try:
            return tuple(resolve_vehicles(words, {uav: name for uav, (name, _) in self._agents.items()}))
        except ValueError as error:
            raise ValueError(f"nothing was changed: {error}") from None

    def _in_pace(self, gate: _Gate, now_s: float) -> bool:
        """What comes too fast is counted, and said once until there was a pause."""
        if gate.pace.is_full(now_s):
            gate.said = False
        if gate.pace.try_take(now_s):
            return True
        self._counts.refused += 1
        if not gate.said:
            self._say(f"operators' commands come faster than {PER_S:g} a second: what is too much is refused")
        gate.said = True
        return False

    def _close(self, number: int) -> None:
        """Answer with what there is."""
        waiting = self._open.pop(number, None)
        if waiting is None:
            return
        answers = (waiting.answers.get(uav) or self._unconfirmed(uav) for uav in waiting.uavs)
        waiting.reply(encode(OperatorAnswer(vehicles=tuple(answers))))

    def _unconfirmed(self, uav: int) -> VehicleAnswer:
        note = f"it has the command, and has not come to it within {ANSWER_WITHIN_S:g} s"
        return VehicleAnswer(uav, self._agents[uav][0], "unconfirmed", note=note)

    def _too_busy(self, uav: int) -> VehicleAnswer:
        return VehicleAnswer(uav, self._agents[uav][0], "refused", note=f"it has not come to {BEFORE}")

    def _refuse(self, why: str, reply: Reply | None, *, aloud: bool = True) -> None:
        self._counts.refused += 1
        # It may quote the sender, and is shown on a terminal.
        why = printable(why[:MAX_WHY])
        if aloud:
            self._say(f"an operator's command was refused ({self._counts.refused} so far): {why}")
        if reply is not None:
            reply(encode(OperatorAnswer(refused=why)))


def _event(number: int, command: Request, turn_s: float, past: tuple[int, ...]) -> AgentCommand:
    match command:
        case SetWeights():
            return ev.WeightsChanged(number, command.w, command.strength)
        case GiveOrder(order=order, after_s=after_s):
            return ev.OperatorCommand(ev.FlightOrder(order), number, max(after_s, turn_s), past)
