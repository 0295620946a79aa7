"""Uploading a mission: https://mavlink.io/en/services/mission.html#uploading_mission

The vehicle asks for the items, and we repeat the announcement until it asks. One after the other they would
take as many answers of a slow link, so the items behind the one that it asks for go along. ArduPilot takes an
item for the number that it expects whether it has asked for it or not (MissionItemProtocol.cpp
handle_mission_item), and so does PX4 (mavlink_mission.cpp handle_mission_item_both); any other ArduPilot
refuses by INVALID_SEQUENCE, and PX4 ignores it. The last item goes only to who asks for it: until then nobody
has the whole mission.

What acknowledgements are worth differs between autopilots, so ACCEPTED is believed only after every item was
sent in this transfer, and success is told for certain only by reading back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer

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
    is_lossy: bool = False
    """something had to be sent again"""


WINDOW = 8
"""Items on their way at a time: some 400 bytes, which the receive buffer of a serial port holds. Where each
goes twice it is double that, and what is dropped is sent again."""


class Upload(Conversation[UploadResult]):
    """One attempt to put `items` of a MAV_MISSION_TYPE on the vehicle.

    `current` is the one marked as the one to fly, if any; `flown` the one that is flown now, for whoever has
    to mark one. Where the vehicle is `too_late` for them when it asks for the last, it does not get that;
    `too_late` is told how long it takes from a message to its answer [s].
    """

    OVERDUE = 1.25
    MAX_OVERDUE_S = 2.5
    """Times as long as an answer takes, and no longer, since how long that is is known once items were taken:
    then what was sent is taken for lost, and from then on each goes twice."""
    REPEAT_S = 1.0
    """so often goes the count until it asks, and an item on its way that it goes on asking for"""
    FIRST_LIMIT_S = 12.0
    """until it asks: where 30 % of all is lost and an answer takes 2 s, one in twenty has not after six"""
    IDLE_LIMIT_S = 6.0
    STUCK_LIMIT_S = 30.0
    """Asked for the same items for so long it gives up. ArduPilot does so after 8 s without one, PX4 after 5;
    how long all of them take is the link's matter."""

    def __init__(
        self,
        peer: MavlinkPeer,
        items: Sequence[MissionItem],
        mission_type: int = MISSION,
        current: int | None = None,
        flown: int | None = None,
        too_late: Callable[[float], bool] = lambda _round_trip_s: False,
    ) -> None:
        super().__init__()
        self._too_late = too_late
        self._peer = peer
        self._current, self._flown = current, flown
        self._type = mission_type
        self._items = tuple(items)
        self._max_requested = -1
        """the item that it has got to in asking"""
        self._last_requested = 0
        """what it asked for last"""
        self._next_to_send = 0
        """the one to send after those on their way"""
        self._sent_s: dict[int, float] = {}
        """when each was sent last"""
        self._requested: set[int] = set()
        """for which it has asked since they were sent"""
        self._resent: set[int] = set()
        """those sent more than once: nobody knows which of them was answered"""
        self._round_trip_s = 0.0
        """from a message to its answer, over this link: no less than that"""
        self._is_lossy = False
        self._repeated_s = 0.0
        """when an item was sent once more by itself"""
        self._last_nack = ""
        self._begin_s = self._idle_at = self._stuck_at = 0.0

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
        self._begin_s = now
        self._idle_at = now + self.FIRST_LIMIT_S
        self._stuck_at = now + self.STUCK_LIMIT_S
        return self._announce(now)

    def _announce(self, now: float) -> list[Message]:
        self.next_deadline = min(now + self.REPEAT_S, self._idle_at)
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
            self._on_ack(int(message.type), now)
            return []
        return self._on_request(int(message.seq), now)

    def _on_request(self, seq: int, now: float) -> list[Message]:
        if seq >= len(self._items):
            return []  # from an earlier, longer transfer
        if self.state is ConversationState.WAITING:
            if seq != 0:
                # It still asks for an earlier transfer: what we sent now would land in that one.
                return []
            self._enter(ConversationState.EXCHANGING)
            self._round_trip_s = now - self._begin_s
        self._idle_at = now + self.IDLE_LIMIT_S
        if seq > self._max_requested:
            self._advance_to(seq, now)
        self.next_deadline = min(self._idle_at, self._stuck_at)
        if seq == len(self._items) - 1 and self._too_late(self._round_trip_s):
            return self._withhold_last(seq, now)
        return self._answer(seq, now)

    def _withhold_last(self, last: int, now: float) -> list[Message]:
        """The last item; where it is on its way, it is seen whether it arrives."""
        answered_s = self.OVERDUE * self._round_trip_s
        if last in self._sent_s and now - max(self._sent_s[last], self._repeated_s) < answered_s:
            return []
        self._end(UploadOutcome.TOO_LATE, "the last item was kept back")
        return self._closing_messages(now)

    def _advance_to(self, seq: int, now: float) -> None:
        self._max_requested = seq
        self._stuck_at = now + self.STUCK_LIMIT_S
        if seq - 1 in self._sent_s and seq - 1 not in self._resent:
            self._round_trip_s = min(self._round_trip_s, now - self._sent_s[seq - 1])

    def _answer(self, seq: int, now: float) -> list[Message]:
        """What it asks for, unless that is on its way, and of the items behind it those that are not."""
        if self._is_overdue(seq, now):
            self._is_lossy = self._is_lossy or seq in self._sent_s
            self._next_to_send = seq  # and what was sent behind it was not taken
            self._requested.clear()
        self._requested.add(seq)
        self._last_requested = seq
        last = len(self._items) - 1
        end = len(self._items) if seq == last else min(seq + WINDOW, last)
        numbers = range(max(seq, self._next_to_send), end)
        self._next_to_send = max(self._next_to_send, end)
        self._resent.update(number for number in numbers if number in self._sent_s)
        self._sent_s |= dict.fromkeys(numbers, now)
        # ArduPilot gives up 8 s after the last item that it took, PX4 after 5: there is time for few tries.
        copies = 2 if self._is_lossy else 1
        if not numbers and now - max(self._sent_s[seq], self._repeated_s) >= self.REPEAT_S:
            numbers, self._repeated_s = range(seq, seq + 1), now
        return [self._item(number) for number in numbers for _ in range(copies)]

    def _item(self, seq: int) -> Message:
        return item_message(self._peer, seq, self._items[seq], self._type, current=seq == self._current)

    def _is_overdue(self, seq: int, now: float) -> bool:
        if seq not in self._sent_s:
            return True
        # For what went along it asks once when the one before has come; for one before that it begins anew.
        asks_again = seq in self._requested or seq < self._last_requested
        overdue_s = min(self.OVERDUE * self._round_trip_s, self.MAX_OVERDUE_S)
        return asks_again and now - self._sent_s[seq] >= overdue_s

    @property
    def _is_all_sent(self) -> bool:
        return len(self._sent_s) == len(self._items)

    def _on_ack(self, code: int, now: float) -> None:
        name = name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if self._is_all_sent:
                self._end(UploadOutcome.ACCEPTED, name)
        elif code == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            # ArduPilot says so for each duplicate and goes on asking.
            self._last_nack = name
        elif code == mavlink.MAV_MISSION_ERROR:
            # ArduPilot's answer to a repeated last item, after it has accepted the first one: in this
            # transfer, or late in the one before. PX4's to an announcement that came twice, or for good. Who
            # means more stops asking.
            self._last_nack = name
            if self._is_all_sent and now - max(self._sent_s.values()) >= 0.9 * self._round_trip_s:
                self._end(UploadOutcome.UNCONFIRMED, name)
        elif code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            if self.state is ConversationState.EXCHANGING:  # else the end of an earlier transfer
                self._end(UploadOutcome.CANCELLED, name)
        elif code == mavlink.MAV_MISSION_DENIED:
            self._end(UploadOutcome.DENIED, name)
        else:
            self._end(UploadOutcome.REJECTED, name)

    def _on_deadline(self, now: float) -> list[Message]:
        if now < self._idle_at and now < self._stuck_at:
            return self._announce(now) if self.state is ConversationState.WAITING else []
        closing = self._closing_messages(now)
        if self.state is ConversationState.WAITING:
            self._end(UploadOutcome.NO_ANSWER, "it did not ask for the first item")
        elif not self._is_all_sent:
            self._end(UploadOutcome.INCOMPLETE, f"it did not get past item {self._max_requested}")
        else:
            self._end(UploadOutcome.UNCONFIRMED, "no acknowledgement after the last item")
        return closing

    def _end(self, outcome: UploadOutcome, reason: str) -> None:
        nack = f", earlier {self._last_nack}" if self._last_nack and outcome is not outcome.ACCEPTED else ""
        text = f"upload {outcome.value}: {reason}{nack}"
        self._finish(UploadResult(outcome, text, is_lossy=self._is_lossy))

    def _closing_messages(self, now: float) -> list[Message]:
        return [
            mavlink.MAVLink_mission_ack_message(
                self._peer.sysid, self._peer.compid, mavlink.MAV_MISSION_OPERATION_CANCELLED, self._type
            )
        ]


def item_message(
    peer: MavlinkPeer, seq: int, item: MissionItem, mission_type: int = MISSION, *, current: bool = False
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
