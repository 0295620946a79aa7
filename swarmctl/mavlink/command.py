"""One command and its acknowledgement: https://mavlink.io/en/services/command.html

An acknowledgement says that the vehicle took the command, not that anything happened; procedures look at
the telemetry for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.conversation import Conversation, Peer, State

FORCE_CODES = (21196.0, 2989.0)
"""param2 of MAV_CMD_COMPONENT_ARM_DISARM that skips all checks, or drops a flying vehicle"""


class CommandOutcome(Enum):
    ACCEPTED = "accepted"
    REFUSED = "refused"
    NO_ANSWER = "no answer"


@dataclass(frozen=True, slots=True)
class CommandResult:
    outcome: CommandOutcome
    text: str
    """for people: the command and the vehicle's MAV_RESULT by name"""

    @property
    def accepted(self) -> bool:
        return self.outcome is CommandOutcome.ACCEPTED


def command_long(peer: Peer, command: int, params: Sequence[float], confirmation: int = 0) -> Message:
    """COMMAND_LONG with missing parameters 0. Raises ValueError for a forced arming or disarming."""
    p = (*params, *(0.0,) * (7 - len(params)))
    _refuse_force(command, p)
    return mavlink.MAVLink_command_long_message(peer.sysid, peer.compid, command, confirmation, *p)


@dataclass(frozen=True, slots=True)
class PositionCommand:
    """What COMMAND_INT carries besides param1-4."""

    frame: int
    x: int
    """latitude [degE7]"""
    y: int
    """longitude [degE7]"""
    z: float
    """altitude [m]"""


def command_int(peer: Peer, command: int, params: Sequence[float], position: PositionCommand) -> Message:
    """COMMAND_INT with missing parameters 0. Raises ValueError for a forced arming or disarming."""
    p = (*params, *(0.0,) * (4 - len(params)))
    _refuse_force(command, p)
    at = (position.x, position.y, position.z)
    return mavlink.MAVLink_command_int_message(
        peer.sysid, peer.compid, position.frame, command, 0, 0, *p, *at
    )


def _refuse_force(command: int, params: Sequence[float]) -> None:
    if command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and params[1] in FORCE_CODES:
        raise ValueError(f"forced arming and disarming (param2 = {params[1]:g}) is never sent")


class Command(Conversation[CommandResult]):
    """Send until answered: COMMAND_LONG, or COMMAND_INT where `position` is given."""

    RETRY_S = 1.0
    TRIES = 5
    IN_PROGRESS_S = 10.0
    """how long one IN_PROGRESS keeps us waiting"""
    IN_PROGRESS_LIMIT = 6

    def __init__(
        self, peer: Peer, command: int, *params: float, position: PositionCommand | None = None
    ) -> None:
        super().__init__()
        self._peer = peer
        self._command = command
        self._params = params
        self._position = position
        self._sent = 0
        self._in_progress = 0
        self._last_word = ""
        self._message()  # a forbidden command fails here, where it was written

    def _begin(self, now: float) -> list[Message]:
        return self._send(now)

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() != "COMMAND_ACK" or message.command != self._command:
            return []
        if not self._peer.is_for_us(message):
            return []
        code = int(message.result)
        self._last_word = name_of("MAV_RESULT", code)
        if code == mavlink.MAV_RESULT_ACCEPTED:
            self._finish(CommandResult(CommandOutcome.ACCEPTED, self._text()))
        elif code == mavlink.MAV_RESULT_IN_PROGRESS and self._in_progress < self.IN_PROGRESS_LIMIT:
            self._in_progress += 1
            if self.state is State.WAITING:
                self._enter(State.EXCHANGING)
            self.next_deadline = now + self.IN_PROGRESS_S
        elif code == mavlink.MAV_RESULT_TEMPORARILY_REJECTED and self._sent < self.TRIES:
            self.next_deadline = now + self.RETRY_S
        else:
            self._finish(CommandResult(CommandOutcome.REFUSED, self._text()))
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        if self._sent < self.TRIES:
            return self._send(now)
        self._finish(CommandResult(CommandOutcome.NO_ANSWER, self._text()))
        return []

    def _send(self, now: float) -> list[Message]:
        message = self._message()
        self._sent += 1
        self.next_deadline = now + self.RETRY_S
        return [message]

    def _message(self) -> Message:
        if self._position is not None:
            return command_int(self._peer, self._command, self._params, self._position)
        return command_long(self._peer, self._command, self._params, confirmation=self._sent)

    def _text(self) -> str:
        return f"{name_of('MAV_CMD', self._command)}: {self._last_word or 'no answer'}"


def name_of(enum: str, value: int) -> str:
    """A MAVLink enum's entry without the enum's own prefix, e.g. MAV_RESULT 4 -> FAILED."""
    entry = mavlink.enums[enum].get(value)
    return f"{enum} {value}" if entry is None else str(entry.name).removeprefix(f"{enum}_")
