"""Uploading a mission: https://mavlink.io/en/services/mission.html#uploading_mission

The vehicle asks for the items; we only answer, and repeat the announcement until it asks. What its
acknowledgements are worth differs between autopilots, so ACCEPTED is believed only after every item was sent
in this transfer, and success is told for certain only by reading back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import name_of
from swarmctl.mavlink.conversation import Conversation, Peer, State

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)


class UploadOutcome(Enum):
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    """by the vehicle, for a reason that a repetition does not cure"""
    DENIED = "denied"
    """it is busy with another transfer"""
    CANCELLED = "cancelled by the vehicle"
    UNCONFIRMED = "unconfirmed"
    """everything was sent, but the last word is missing: it may be on the vehicle"""
    INCOMPLETE = "incomplete"
    """the vehicle stopped asking: a part may be on it"""
    NO_ANSWER = "no answer"
    """it never asked for an item"""
    TOO_LATE = "too late"
    """it was broken off, because it is of no use any more"""


@dataclass(frozen=True, slots=True)
class UploadResult:
    outcome: UploadOutcome
    text: str


class Upload(Conversation[UploadResult]):
    """One attempt to put `items` of a MAV_MISSION_TYPE on the vehicle.

    `current` is the one marked as the one to fly, if any; `flown` the one that is flown now, for whoever has
    to mark one. Where the vehicle is `too_late` for them when it asks for the last, it does not get that.
    """

    COUNT_REPEAT_S = 1.0
    IDLE_LIMIT_S = 6.0
    STUCK_LIMIT_S = 30.0
    """Asked for the same items for so long it gives up. ArduPilot does so after 8 s without one, PX4 after 5;
    how long all of them take is the link's matter: 3 s each where a fifth is lost and an answer takes 2 s."""

    def __init__(
        self,
        peer: Peer,
        items: Sequence[MissionItem],
        mission_type: int = MISSION,
        current: int | None = None,
        flown: int | None = None,
        too_late: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__()
        self._too_late = too_late
        self._peer = peer
        self._current, self._flown = current, flown
        self._type = mission_type
        self._items = tuple(items)
        self._unsent = set(range(len(self._items)))
        self._last_nack = ""
        self._idle_at = 0.0
        self._stuck_at = 0.0

    @property
    def items(self) -> tuple[MissionItem, ...]:
        return self._items

    @property
    def mission_type(self) -> int:
        return self._type

    @property
    def current(self) -> int | None:
        return self._current

    @property
    def flown(self) -> int | None:
        return self._flown

    def _begin(self, now: float) -> list[Message]:
        self._idle_at = now + self.IDLE_LIMIT_S
        self._stuck_at = now + self.STUCK_LIMIT_S
        return self._announce(now)

    def _announce(self, now: float) -> list[Message]:
        self.next_deadline = min(now + self.COUNT_REPEAT_S, self._idle_at)
        return [
            mavlink.MAVLink_mission_count_message(
                self._peer.sysid, self._peer.compid, len(self._items), mission_type=self._type
            )
        ]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind not in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"):
            return []
        if message.mission_type != self._type or not self._peer.is_for_us(message):
            return []
        if kind == "MISSION_ACK":
            self._on_ack(int(message.type))
            return []
        return self._on_request(int(message.seq), now)

    def _on_request(self, seq: int, now: float) -> list[Message]:
        if seq >= len(self._items):
            return []  # from an earlier, longer transfer
        if self.state is State.WAITING:
            if seq != 0:
                # It still asks for an earlier transfer: what we sent now would land in that one.
                return []
            self._enter(State.EXCHANGING)
        if seq == len(self._items) - 1 and self._too_late():
            self._end(UploadOutcome.TOO_LATE, "the last item was kept back")
            return self._farewell(now)
        self._idle_at = now + self.IDLE_LIMIT_S
        if seq in self._unsent:
            self._unsent.remove(seq)
            self._stuck_at = now + self.STUCK_LIMIT_S
        self.next_deadline = min(self._idle_at, self._stuck_at)
        item = self._items[seq]
        return [item_message(self._peer, seq, item, self._type, current=seq == self._current)]

    def _on_ack(self, code: int) -> None:
        name = name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if not self._unsent:
                self._end(UploadOutcome.ACCEPTED, name)
        elif code == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            # ArduPilot says so for each duplicate and goes on asking.
            self._last_nack = name
        elif code == mavlink.MAV_MISSION_ERROR:
            # ArduPilot's answer to a repeated last item, after it has accepted the first one: in this
            # transfer, or late in the one before. Where it means more, it stops asking.
            self._last_nack = name
            if not self._unsent:
                self._end(UploadOutcome.UNCONFIRMED, name)
        elif code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            if self.state is State.EXCHANGING:  # else the end of an earlier transfer
                self._end(UploadOutcome.CANCELLED, name)
        elif code == mavlink.MAV_MISSION_DENIED:
            self._end(UploadOutcome.DENIED, name)
        else:
            self._end(UploadOutcome.REJECTED, name)

    def _on_deadline(self, now: float) -> list[Message]:
        if now < self._idle_at and now < self._stuck_at:
            return self._announce(now) if self.state is State.WAITING else []
        farewell = self._farewell(now)
        if self.state is State.WAITING:
            self._end(UploadOutcome.NO_ANSWER, "it did not ask for the first item")
        elif self._unsent:
            self._end(UploadOutcome.INCOMPLETE, f"it stopped asking before item {min(self._unsent)}")
        else:
            self._end(UploadOutcome.UNCONFIRMED, "no acknowledgement after the last item")
        return farewell

    def _end(self, outcome: UploadOutcome, reason: str) -> None:
        nack = f", earlier {self._last_nack}" if self._last_nack and outcome is not outcome.ACCEPTED else ""
        self._finish(UploadResult(outcome, f"upload {outcome.value}: {reason}{nack}"))

    def _farewell(self, now: float) -> list[Message]:
        return [
            mavlink.MAVLink_mission_ack_message(
                self._peer.sysid, self._peer.compid, mavlink.MAV_MISSION_OPERATION_CANCELLED, self._type
            )
        ]


def item_message(
    peer: Peer, seq: int, item: MissionItem, mission_type: int = MISSION, *, current: bool = False
) -> Message:
    """MISSION_ITEM_INT, the answer to both kinds of request."""
    return mavlink.MAVLink_mission_item_int_message(
        peer.sysid,
        peer.compid,
        seq,
        item.frame,
        item.command,
        int(current),
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        mission_type,
    )
