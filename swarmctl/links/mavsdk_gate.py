"""What passes between MAVSDK and one vehicle: only what was asked of it. Pure.

MAVSDK repeats a command that is not answered by itself, and says and asks things nobody wants. A repeated
command would reach a vehicle that a pilot has taken over meanwhile, so each one passes once, exactly as it
was asked for; MAVSDK hears answers only to what it has sent.
"""

from __future__ import annotations

import struct

from swarmctl.mavlink.protocol.codec import Message

_ALWAYS_IN = ("HEARTBEAT", "AUTOPILOT_VERSION")
_TRANSFER_OUT = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT")
_TRANSFER_IN = (
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
)


class MavsdkGate:
    """Of one vehicle. `transfer` is whether MAVSDK moves a mission at the moment."""

    def __init__(self) -> None:
        self.transfer = False
        self._may_leave: set[tuple[int, bytes]] = set()
        self._asked: set[int] = set()

    def permit(self, command: Message) -> None:
        """Let this COMMAND_LONG out once, and its acknowledgements in."""
        self._may_leave.add(_content(command))
        self._asked.add(int(command.command))

    def revoke(self, command: Message) -> None:
        """It is over: nothing of it goes out any more."""
        self._may_leave.discard(_content(command))
        self._asked.discard(int(command.command))

    def lets_out(self, message: Message) -> bool:
        """Whether MAVSDK's message goes to the vehicle; a command uses up its permission."""
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            content = _content(message)
            permitted = content in self._may_leave
            self._may_leave.discard(content)
            return permitted
        # The last word of a transfer comes when it is over already.
        return kind == "MISSION_ACK" or (self.transfer and kind in _TRANSFER_OUT)

    def lets_in(self, message: Message) -> bool:
        """Whether MAVSDK is told what the vehicle says."""
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            return int(message.command) in self._asked
        return kind in _ALWAYS_IN or (self.transfer and kind in _TRANSFER_IN)


def _content(command: Message) -> tuple[int, bytes]:
    """All that matters of it, rounded as it is on the wire."""
    params = (getattr(command, f"param{i}") for i in range(1, 8))
    return int(command.command), struct.pack("<7f", *params)
