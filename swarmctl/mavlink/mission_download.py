"""Reading a mission back: https://mavlink.io/en/services/mission.html#download_mission"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import name_of
from swarmctl.mavlink.conversation import Conversation, Peer, State
from swarmctl.mavlink.mission_upload import MISSION


class DownloadOutcome(Enum):
    COMPLETE = "complete"
    REFUSED = "refused"
    """the vehicle answered with an error; DENIED while it is still in an upload"""
    NO_ANSWER = "no answer"


@dataclass(frozen=True, slots=True)
class DownloadResult:
    outcome: DownloadOutcome
    items: tuple[MissionItem, ...]
    """all of them, item 0 included; empty unless COMPLETE"""
    text: str


class Download(Conversation[DownloadResult]):
    """One attempt to read all items, each asked for until it comes."""

    REPEAT_S = 1.0
    TRIES = 6

    def __init__(self, peer: Peer) -> None:
        super().__init__()
        self._peer = peer
        self._count = 0
        self._items: list[MissionItem] = []
        self._tries = 0

    def _begin(self, now: float) -> list[Message]:
        return self._ask(now)

    def _ask(self, now: float) -> list[Message]:
        self._tries += 1
        self.next_deadline = now + self.REPEAT_S
        to = (self._peer.sysid, self._peer.compid)
        if self.state is State.WAITING:
            return [mavlink.MAVLink_mission_request_list_message(*to, mission_type=MISSION)]
        return [mavlink.MAVLink_mission_request_int_message(*to, len(self._items), mission_type=MISSION)]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind not in ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"):
            return []
        if message.mission_type != MISSION or not self._peer.is_for_us(message):
            return []
        if kind == "MISSION_COUNT" and self.state is State.WAITING:
            self._enter(State.EXCHANGING)
            self._count = int(message.count)
            return self._proceed(now)
        if kind == "MISSION_ITEM_INT" and self.state is State.EXCHANGING and message.seq == len(self._items):
            self._items.append(item_of(message))
            return self._proceed(now)
        if kind == "MISSION_ACK":
            self._on_ack(int(message.type))
        return []

    def _proceed(self, now: float) -> list[Message]:
        if len(self._items) < self._count:
            self._tries = 0
            return self._ask(now)
        self._end(DownloadOutcome.COMPLETE, f"{self._count} items")
        return [self._ack(mavlink.MAV_MISSION_ACCEPTED)]

    def _on_ack(self, code: int) -> None:
        # Positive ones, cancellations and complaints about duplicates belong to an upload before.
        stale = (
            mavlink.MAV_MISSION_ACCEPTED,
            mavlink.MAV_MISSION_OPERATION_CANCELLED,
            mavlink.MAV_MISSION_INVALID_SEQUENCE,
        )
        if code not in stale:
            name = name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")
            self._end(DownloadOutcome.REFUSED, name)

    def _on_deadline(self, now: float) -> list[Message]:
        if self._tries < self.TRIES:
            return self._ask(now)
        farewell = self._farewell(now)
        what = "the number of items" if self.state is State.WAITING else f"item {len(self._items)}"
        self._end(DownloadOutcome.NO_ANSWER, f"asked {self._tries} times for {what}")
        return farewell

    def _end(self, outcome: DownloadOutcome, reason: str) -> None:
        items = tuple(self._items) if outcome is DownloadOutcome.COMPLETE else ()
        self._finish(DownloadResult(outcome, items, f"read-back {outcome.value}: {reason}"))

    def _farewell(self, now: float) -> list[Message]:
        return [self._ack(mavlink.MAV_MISSION_OPERATION_CANCELLED)]

    def _ack(self, code: int) -> Message:
        return mavlink.MAVLink_mission_ack_message(self._peer.sysid, self._peer.compid, code, MISSION)


def item_of(message: Message) -> MissionItem:
    """The item that a MISSION_ITEM_INT carries."""
    return MissionItem(
        command=int(message.command),
        frame=int(message.frame),
        x=int(message.x),
        y=int(message.y),
        z=float(message.z),
        param1=float(message.param1),
        param2=float(message.param2),
        param3=float(message.param3),
        param4=float(message.param4),
        autocontinue=int(message.autocontinue),
    )
