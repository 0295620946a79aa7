"""Adding items behind a mission: https://mavlink.io/en/messages/common.html#MISSION_WRITE_PARTIAL_LIST

ArduPilot takes a partial list that begins at most one behind the last item, and ends there as well: so each
item is announced by itself. It is sent along with its announcement, without waiting for the request: that
halves the time in which the vehicle flies on, and where it comes too early it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import name_of
from swarmctl.mavlink.conversation import Conversation, Peer, State
from swarmctl.mavlink.mission_upload import MISSION, item_message


@dataclass(frozen=True, slots=True)
class AppendResult:
    """`failure` is None when every item was acknowledged; only reading back tells what is there."""

    failure: str | None


class Append(Conversation[AppendResult]):
    """One attempt to put `items` behind the `count` items that a vehicle holds."""

    REPEAT_S = 0.5
    LIMIT_S = 4.0
    """a route that comes later than this begins behind the vehicle"""
    SILENCE_S = 1.5
    """who has answered nothing by then does not know partial lists, or is not reached"""

    def __init__(self, peer: Peer, count: int, items: Sequence[MissionItem]) -> None:
        super().__init__()
        self._peer = peer
        self._count = count
        self._items = tuple(items)
        self._next = 0
        self._end_s = self._silent_s = 0.0
        self._last_nack = ""

    def _begin(self, now: float) -> list[Message]:
        self._end_s, self._silent_s = now + self.LIMIT_S, now + self.SILENCE_S
        return self._announce(now)

    def _announce(self, now: float) -> list[Message]:
        self.next_deadline = min(now + self.REPEAT_S, self._end_s)
        seq, to = self._count + self._next, (self._peer.sysid, self._peer.compid)
        self._last_nack = ""
        return [
            mavlink.MAVLink_mission_write_partial_list_message(*to, seq, seq, MISSION),
            item_message(self._peer, seq, self._items[self._next]),
        ]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind not in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"):
            return []
        if message.mission_type != MISSION or not self._peer.is_for_us(message):
            return []
        return self._on_ack(int(message.type), now) if kind == "MISSION_ACK" else self._on_request(message)

    def _on_request(self, message: Message) -> list[Message]:
        # Also for one that it has already: an announcement that came twice is asked about again.
        index = int(message.seq) - self._count
        if not 0 <= index <= self._next:
            return []
        if self.state is State.WAITING:
            self._enter(State.EXCHANGING)
        if index == self._next and not self._last_nack:
            return []  # it is on its way
        return [item_message(self._peer, self._count + index, self._items[index])]

    def _on_ack(self, code: int, now: float) -> list[Message]:
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if self.state is State.WAITING:
                return []  # of an earlier transfer: its request comes before
            self._next += 1
            if self._next < len(self._items):
                return self._announce(now)
            self._finish(AppendResult(None))
            return []
        if self.state is State.WAITING:
            return []  # of an earlier transfer
        # ERROR and INVALID_SEQUENCE are also its answers to what comes twice: the announcement is repeated.
        self._last_nack = name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")
        if code not in (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE):
            self._end(f"{self._last_nack} for item {self._count + self._next}")
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        if self.state is State.WAITING and now >= self._silent_s:
            self._end(f"no answer within {self.SILENCE_S:g} s")
            return []
        if now < self._end_s:
            if self._last_nack:
                # One acknowledgement was taken for another: the list ends before this item.
                self._next = max(self._next - 1, 0)
            return self._announce(now)
        said = f", last {self._last_nack}" if self._last_nack else ""
        self._end(f"{self._next} of {len(self._items)} items within {self.LIMIT_S:g} s{said}")
        return []

    def _end(self, why: str) -> None:
        self._finish(AppendResult(f"the new route was not written behind the old one: {why}"))
