"""One command and its acknowledgement: https://mavlink.io/en/services/command.html

An acknowledgement shows whether the vehicle accepts the command; only telemetry shows the effect.
`procedures.guarded` repeats a command that is unanswered or temporarily rejected.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer


class CommandOutcome(Enum):
    ACCEPTED = "accepted"
    REFUSED = "refused"
    NOT_NOW = "not now"
    """MAV_RESULT_TEMPORARILY_REJECTED"""
    NO_ANSWER = "no answer"


class CommandResult(msgspec.Struct, frozen=True):
    """Outcome of one try of a command."""

    outcome: CommandOutcome
    text: str
    """the command and the vehicle's answer, for messages"""

    @property
    def final(self) -> bool:
        """Return whether another try would bring the same answer."""
        return self.outcome in (CommandOutcome.ACCEPTED, CommandOutcome.REFUSED)

    @property
    def may_have_happened(self) -> bool:
        """Return whether the command may have taken effect; NO_ANSWER may mean a lost answer."""
        return self.outcome in (CommandOutcome.ACCEPTED, CommandOutcome.NO_ANSWER)


def command_long(peer: MavlinkPeer, command: int, params: Sequence[float], confirmation: int = 0) -> Message:
    """Return a COMMAND_LONG; missing parameters are 0.

    Raises ValueError for a forced arming or disarming.
    """
    all_params = (*params, *(0.0,) * (7 - len(params)))
    if _is_forced(command, all_params[1]):
        raise ValueError(f"forced arming or disarming (param2 = {all_params[1]:g}) is never sent")
    return mavlink.MAVLink_command_long_message(peer.sysid, peer.compid, command, confirmation, *all_params)


def is_forced_arming(message: Message) -> bool:
    """Return whether a message commands arming without checks, or disarming in flight."""
    is_command = message.get_type() in ("COMMAND_LONG", "COMMAND_INT")
    return is_command and _is_forced(int(message.command), message.param2)


def _is_forced(command: int, param2: float) -> bool:
    # 21196 forces; 2989 forces the arming of an ArduPilot. PX4 rounds, so every value but 0 counts as forced.
    return command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and param2 != 0.0


class Command(Conversation[CommandResult]):
    """One try of a COMMAND_LONG and its acknowledgement; `confirmation` is the number of earlier tries."""

    ANSWER_WAIT_S, IN_PROGRESS_WAIT_S = 1.0, 10.0
    """longest wait for the first answer, and after each IN_PROGRESS"""
    IN_PROGRESS_LIMIT = 6
    """greatest number of IN_PROGRESS answers to one try; a further IN_PROGRESS counts as a refusal"""

    def __init__(self, peer: MavlinkPeer, command: int, *params: float, confirmation: int = 0) -> None:
        super().__init__()
        self._peer = peer
        self._command = command
        # A forced arming raises ValueError in the caller.
        self._message = command_long(peer, command, params, confirmation)
        self._outcome = CommandOutcome.NO_ANSWER
        self._in_progress = 0
        self._last_answer = ""

    def _begin(self, now: float) -> list[Message]:
        self.next_deadline = now + self.ANSWER_WAIT_S
        return [self._message]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() != "COMMAND_ACK" or message.command != self._command:
            return []
        if not self._peer.is_for_us(message):
            return []
        code = int(message.result)
        self._last_answer = name_of("MAV_RESULT", code)
        if code == mavlink.MAV_RESULT_ACCEPTED:
            self._end(CommandOutcome.ACCEPTED)
        elif code == mavlink.MAV_RESULT_IN_PROGRESS and self._in_progress < self.IN_PROGRESS_LIMIT:
            self._in_progress += 1
            if self.state is ConversationState.WAITING:
                self._enter(ConversationState.EXCHANGING)
            self.next_deadline = now + self.IN_PROGRESS_WAIT_S
        elif code == mavlink.MAV_RESULT_TEMPORARILY_REJECTED:
            # An immediate retry would get the same answer, so the try lasts ANSWER_WAIT_S longer.
            self._outcome = CommandOutcome.NOT_NOW
            self.next_deadline = now + self.ANSWER_WAIT_S
        else:
            self._end(CommandOutcome.REFUSED)
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        self._end(self._outcome)
        return []

    def _end(self, outcome: CommandOutcome) -> None:
        text = f"{name_of('MAV_CMD', self._command)}: {self._last_answer or 'no answer'}"
        self._finish(CommandResult(outcome, text))


def name_of(enum: str, value: int) -> str:
    """Return the name of an enum's entry without the enum's prefix, e.g. MAV_RESULT 4 -> FAILED."""
    entry = mavlink.enums[enum].get(value)
    return f"{enum} {value}" if entry is None else str(entry.name).removeprefix(f"{enum}_")


class SetCurrent(Conversation[CommandResult]):
    """One try of MISSION_SET_CURRENT, for PX4, which lacks MAV_CMD_DO_SET_MISSION_CURRENT.

    https://mavlink.io/en/services/mission.html#current_mission_item
    The answer is a MISSION_CURRENT with the item's number.
    """

    ANSWER_WAIT_S = 1.0

    def __init__(self, peer: MavlinkPeer, seq: int) -> None:
        super().__init__()
        self._peer = peer
        self._seq = seq

    def _begin(self, now: float) -> list[Message]:
        self.next_deadline = now + self.ANSWER_WAIT_S
        return [mavlink.MAVLink_mission_set_current_message(self._peer.sysid, self._peer.compid, self._seq)]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() == "MISSION_CURRENT" and message.seq == self._seq:
            self._end(CommandOutcome.ACCEPTED, f"item {self._seq} is current")
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        self._end(CommandOutcome.NO_ANSWER, "no answer")
        return []

    def _end(self, outcome: CommandOutcome, answer: str) -> None:
        self._finish(CommandResult(outcome, f"MISSION_SET_CURRENT {self._seq}: {answer}"))
