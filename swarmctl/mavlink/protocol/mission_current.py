"""Set current item by message: https://mavlink.io/en/services/mission.html#current_mission_item"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import CommandOutcome, CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer


class SetCurrent(Conversation[CommandResult]):
    """One try of MISSION_SET_CURRENT, for PX4, which lacks MAV_CMD_DO_SET_MISSION_CURRENT.

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
