"""The operator's desk: commands come in by the bus, the agents' answers go back by it.

A command from a network moves aircraft, so what is not plainly a command for this swarm and these vehicles is
refused as a whole, counted, and said; and whoever gave it is told what became of it, vehicle by vehicle.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from swarmctl.bus import keys
from swarmctl.bus.base import Reply, Transport
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    SetWeights,
    VehicleAnswer,
    WeightsAnswer,
    decode_command,
    encode,
)

ANSWER_WITHIN_S = 3.0
"""An agent in the middle of a long search answers when it is through."""
MAX_WHY = 400


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
        transport.serve(self._key, self._asked)

    def join(self, uav: int, name: str, post: Callable[[ev.WeightsChanged], None]) -> None:
        """`post` hands an event to the agent, which answers with an effect."""
        self._agents[uav] = (name, post)

    def answered(self, command: int, answer: VehicleAnswer) -> None:
        """What an agent made of a command; too late an answer is nobody's any more."""
        waiting = self._open.get(command)
        if waiting is None:
            return
        waiting.answers[answer.uav] = answer
        if len(waiting.answers) == len(waiting.uavs):
            self._close(command)

    def _asked(self, key: str, payload: bytes, reply: Reply) -> None:
        if key != self._key:
            # A wildcard asks many swarms at once; whoever means this one can say so.
            self._refuse(f"asked under the key {key}, not {self._key}", None)
            return
        try:
            command = decode_command(payload)
            uavs = self._meant(command)
        except (BadMessage, ValueError) as error:
            self._refuse(str(error), reply)
            return
        self._tally.passed_on += 1
        number = self._tally.passed_on
        self._open[number] = _Open(uavs, reply)
        asyncio.get_running_loop().call_later(ANSWER_WITHIN_S, partial(self._close, number))
        for uav in uavs:
            self._agents[uav][1](ev.WeightsChanged(number, command.w, command.strength))

    def _meant(self, command: SetWeights) -> list[int]:
        """The vehicles, in the swarm's order. Raises ValueError where one is not of this swarm."""
        if command.uavs is None:
            return list(self._agents)
        unknown = sorted(set(command.uavs) - set(self._agents))
        if unknown:
            there = ", ".join(f"{uav} ({name})" for uav, (name, _) in self._agents.items())
            raise ValueError(
                f"no vehicle of this swarm has system id {', '.join(map(str, unknown))}: there is {there}; "
                "nothing was changed"
            )
        return [uav for uav in self._agents if uav in command.uavs]

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

    def _refuse(self, why: str, reply: Reply | None) -> None:
        self._tally.refused += 1
        # It may quote the sender, and is shown on a terminal.
        why = "".join(c if c.isprintable() else "?" for c in why[:MAX_WHY])
        self._say(f"an operator's command was refused ({self._tally.refused} so far): {why}")
        if reply is not None:
            reply(encode(WeightsAnswer(refused=why)))
