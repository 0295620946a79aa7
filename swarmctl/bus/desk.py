"""The operator's desk: commands come in by the bus, the agents' answers go back by it.

A command from a network moves aircraft, so what is not plainly a command for this swarm and these vehicles is
refused as a whole, counted, and said; and whoever gave it is told what became of it, vehicle by vehicle. They
come no faster than a hand gives them, for each costs a plan, and no agent is given one before it has come to
the last.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from swarmctl.bus import keys
from swarmctl.bus.base import MAX_QUESTION_BYTES, Reply, Transport
from swarmctl.bus.pace import Pace
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    SetWeights,
    VehicleAnswer,
    WeightsAnswer,
    decode_command,
    encode,
)
from swarmctl.core.roster import meant_by

ANSWER_WITHIN_S = 3.0
"""An agent in the middle of a long search answers when it is through."""
MAX_WHY = 400
PER_S = 4.0
BURST = 8
"""Commands, good or bad: so many at once, and so many a second in the long run."""
TOO_FAST = encode(
    WeightsAnswer(
        refused=f"commands come faster than {PER_S:g} a second; nothing was changed, give it again later"
    )
)
BEFORE = "the command before this one yet; give this one again later"


@dataclass(slots=True)
class Tally:
    """How many commands came."""

    passed_on: int = 0
    refused: int = 0


@dataclass(slots=True)
class _Open:
    """A command that has been passed on."""

    uavs: list[int]
    reply: Reply
    answers: dict[int, VehicleAnswer] = field(default_factory=dict)


class Desk:
    """One a process; its agents `join`, and report with `answered`."""

    def __init__(self, transport: Transport, swarm: str, say: Callable[[str], None], tally: Tally) -> None:
        self._tally = tally
        self._key = keys.weights(swarm)
        self._say = say
        self._agents: dict[int, tuple[str, Callable[[ev.WeightsChanged], None]]] = {}
        self._open: dict[int, _Open] = {}
        self._busy: dict[int, int] = {}
        """by vehicle: the command that it has not come to yet, perhaps long after its answer was due"""
        self._pace = Pace(PER_S, BURST)
        self._too_fast = False
        transport.serve(self._key, self._asked)

    def join(self, uav: int, name: str, post: Callable[[ev.WeightsChanged], None]) -> None:
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
        if not self._in_pace(asyncio.get_running_loop().time()):
            if key == self._key:
                reply(TOO_FAST)
            return
        if key != self._key:
            # A wildcard asks many swarms at once; whoever means this one can say so.
            self._refuse(f"asked under the key {key}, not {self._key}", None)
            return
        try:
            command = _command(payload)
            uavs = self._meant(command)
        except (BadMessage, ValueError) as error:
            self._refuse(str(error), reply)
            return
        free = [uav for uav in uavs if uav not in self._busy]
        if free:
            self._pass_on(command, uavs, free, reply)
        else:
            self._refuse(f"no vehicle named has come to {BEFORE}", reply)

    def _pass_on(self, command: SetWeights, uavs: list[int], free: list[int], reply: Reply) -> None:
        self._tally.passed_on += 1
        number = self._tally.passed_on
        self._open[number] = _Open(uavs, reply, {u: self._too_busy(u) for u in uavs if u in self._busy})
        asyncio.get_running_loop().call_later(ANSWER_WITHIN_S, partial(self._close, number))
        for uav in free:
            self._busy[uav] = number
            self._agents[uav][1](ev.WeightsChanged(number, command.w, command.strength))

    def _meant(self, command: SetWeights) -> list[int]:
        """The vehicles, in the swarm's order. Raises ValueError where one is not of this swarm."""
        if command.uavs is None:
            return list(self._agents)
        try:
            return meant_by(command.uavs, {uav: name for uav, (name, _) in self._agents.items()})
        except ValueError as error:
            raise ValueError(f"nothing was changed: {error}") from None

    def _in_pace(self, now_s: float) -> bool:
        """What comes too fast is counted, and said once until there was a pause."""
        if self._pace.rested(now_s):
            self._too_fast = False
        if self._pace.takes(now_s):
            return True
        self._tally.refused += 1
        if not self._too_fast:
            self._say(f"operators' commands come faster than {PER_S:g} a second: what is too much is refused")
        self._too_fast = True
        return False

    def _close(self, number: int) -> None:
        """Answer with what there is."""
        waiting = self._open.pop(number, None)
        if waiting is None:
            return
        answers = (waiting.answers.get(uav) or self._unconfirmed(uav) for uav in waiting.uavs)
        waiting.reply(encode(WeightsAnswer(vehicles=tuple(answers))))

    def _unconfirmed(self, uav: int) -> VehicleAnswer:
        note = f"it has the command, and has not come to it within {ANSWER_WITHIN_S:g} s"
        return VehicleAnswer(uav, self._agents[uav][0], "unconfirmed", note=note)

    def _too_busy(self, uav: int) -> VehicleAnswer:
        return VehicleAnswer(uav, self._agents[uav][0], "refused", note=f"it has not come to {BEFORE}")

    def _refuse(self, why: str, reply: Reply | None) -> None:
        self._tally.refused += 1
        # It may quote the sender, and is shown on a terminal.
        why = "".join(c if c.isprintable() else "?" for c in why[:MAX_WHY])
        self._say(f"an operator's command was refused ({self._tally.refused} so far): {why}")
        if reply is not None:
            reply(encode(WeightsAnswer(refused=why)))


def _command(payload: bytes | None) -> SetWeights:
    """Raises BadMessage."""
    if payload is None:
        raise BadMessage(f"a payload of more than {MAX_QUESTION_BYTES} bytes, which no command takes")
    return decode_command(payload)
