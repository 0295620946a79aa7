"""Mission upload: https://mavlink.io/en/services/mission.html#uploading_mission

The ground station repeats the announcement until the vehicle requests the first item. With one item for each
request, every item would take a round trip. So each requested item is sent with up to seven items after it.
The last item is sent on request only, so until then the vehicle cannot have the whole mission.

ArduPilot (MissionItemProtocol.cpp handle_mission_item) and PX4 (mavlink_mission.cpp handle_mission_item_both)
accept an item with the expected number, requested or not. ArduPilot refuses any other item by
INVALID_SEQUENCE; PX4 ignores such an item.

Acknowledgements differ between autopilots. ACCEPTED counts only after every item was sent in this transfer,
and only a read-back proves success.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import MISSION, MissionTransfer, item_message, result_name


class UploadOutcome(Enum):
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    """refused by the vehicle; another try would also be refused"""
    DENIED = "denied"
    """refused because of another transfer"""
    CANCELLED = "cancelled by the vehicle"
    UNCONFIRMED = "unconfirmed"
    """all items were sent but not acknowledged: the mission may be stored"""
    INCOMPLETE = "incomplete"
    """requests stopped: a part of the mission may be stored"""
    NO_ANSWER = "no answer"
    """the first item was not requested"""
    TOO_LATE = "too late"
    """stopped by `too_late`, because the upload became useless"""


class UploadResult(msgspec.Struct, frozen=True):
    """Outcome of an upload, with a text for the operator."""

    outcome: UploadOutcome
    text: str
    is_lossy: bool = False
    """True if an item counted as lost and was sent again"""


WINDOW = 8
"""Number of items under way at a time: some 400 bytes, which fit into the receive buffer of a serial port.
After a loss each item is sent twice; if the buffer then overflows, the vehicle requests the items again."""


class Upload(MissionTransfer[UploadResult]):
    """One attempt to upload `items` of a MAV_MISSION_TYPE.

    current: item marked as current; None: no mark, so a vehicle in flight keeps its current item
    too_late: called with the round-trip time [s] when the vehicle requests the last item; True withholds
        that item. None: never too late
    """

    REPLIES = frozenset({"MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"})
    OVERDUE_ROUND_TRIPS = 1.25
    MAX_OVERDUE_S = 2.5
    """time after which an item counts as lost: this number of round trips, at most MAX_OVERDUE_S"""
    REPEAT_PERIOD_S = 1.0
    """period of repeating the count until the first request, and of repeating a requested item"""
    FIRST_LIMIT_S = 12.0
    """longest wait for the first request; at 30 % loss and 2 s per answer, 1 wait in 20 takes over 6 s"""
    IDLE_LIMIT_S, STUCK_LIMIT_S = 6.0, 30.0
    """Longest time without a request, and without a request for a new item. ArduPilot gives up after 8 s
    without an item, PX4 after 5 s. The whole transfer has no limit."""

    def __init__(
        self,
        peer: MavlinkPeer,
        items: Sequence[MissionItem],
        mission_type: int = MISSION,
        current: int | None = None,
        too_late: Callable[[float], bool] | None = None,
    ) -> None:
        super().__init__(peer, mission_type)
        self.too_late = too_late
        self.current = current
        self.items = tuple(items)
        self._max_requested = -1
        """highest item requested so far"""
        self._last_requested = 0
        """item requested last"""
        self._next_to_send = 0
        """next item to send, after the items under way"""
        self._sent_s: dict[int, float] = {}
        """time when each item was last sent, by item"""
        self._requested: set[int] = set()
        """items requested since they were sent"""
        self._resent: set[int] = set()
        """items sent more than once: their answers do not show the round-trip time"""
        self._round_trip_s = 0.0
        """shortest observed time from a message to its answer"""
        self._is_lossy = False
        self._repeated_s = 0.0
        """time when a single item was last repeated"""
        self._last_nack = ""
        self._begin_s = self._idle_at = self._stuck_at = 0.0

    def _begin(self, now: float) -> list[Message]:
        self._begin_s = now
        self._idle_at = now + self.FIRST_LIMIT_S
        self._stuck_at = now + self.STUCK_LIMIT_S
        return self._announce(now)

    def _announce(self, now: float) -> list[Message]:
        self.next_deadline = min(now + self.REPEAT_PERIOD_S, self._idle_at)
        return [
            mavlink.MAVLink_mission_count_message(
                self._peer.sysid, self._peer.compid, len(self.items), mission_type=self.mission_type
            )
        ]

    def _on_reply(self, message: Message, now: float) -> list[Message]:
        if message.get_type() == "MISSION_ACK":
            self._on_ack(int(message.type), now)
            return []
        return self._on_request(int(message.seq), now)

    def _on_request(self, seq: int, now: float) -> list[Message]:
        if seq >= len(self.items):
            return []  # from an earlier, longer transfer
        if self.state is ConversationState.WAITING:
            if seq != 0:
                # The request belongs to an earlier transfer: an item sent now would be stored there.
                return []
            self._enter(ConversationState.EXCHANGING)
            self._round_trip_s = now - self._begin_s
        self._idle_at = now + self.IDLE_LIMIT_S
        if seq > self._max_requested:
            self._record_progress(seq, now)
        self.next_deadline = min(self._idle_at, self._stuck_at)
        is_last = seq == len(self.items) - 1
        if is_last and self.too_late is not None and self.too_late(self._round_trip_s):
            return self._withhold_last(seq, now)
        return self._answer(seq, now)

    def _withhold_last(self, last: int, now: float) -> list[Message]:
        """Withhold the last item; if a copy is under way, wait for its effect first."""
        answered_s = self.OVERDUE_ROUND_TRIPS * self._round_trip_s
        if last in self._sent_s and now - max(self._sent_s[last], self._repeated_s) < answered_s:
            return []
        self._end(UploadOutcome.TOO_LATE, "the last item was not sent")
        return self._closing_messages(now)

    def _record_progress(self, seq: int, now: float) -> None:
        self._max_requested = seq
        self._stuck_at = now + self.STUCK_LIMIT_S
        if seq - 1 in self._sent_s and seq - 1 not in self._resent:
            self._round_trip_s = min(self._round_trip_s, now - self._sent_s[seq - 1])

    def _answer(self, seq: int, now: float) -> list[Message]:
        """Return the requested item and the next items in the window, except items already under way."""
        if self._is_overdue(seq, now):
            self._is_lossy = self._is_lossy or seq in self._sent_s
            self._next_to_send = seq  # the vehicle has not accepted the items sent after `seq`
            self._requested.clear()
        self._requested.add(seq)
        self._last_requested = seq
        last = len(self.items) - 1
        end = len(self.items) if seq == last else min(seq + WINDOW, last)
        numbers = range(max(seq, self._next_to_send), end)
        self._next_to_send = max(self._next_to_send, end)
        self._resent.update(number for number in numbers if number in self._sent_s)
        self._sent_s |= dict.fromkeys(numbers, now)
        # ArduPilot gives up 8 s after the last accepted item, PX4 after 5 s, so only few tries fit.
        copies = 2 if self._is_lossy else 1
        if not numbers and now - max(self._sent_s[seq], self._repeated_s) >= self.REPEAT_PERIOD_S:
            numbers, self._repeated_s = range(seq, seq + 1), now
        return [self._item(number) for number in numbers for _ in range(copies)]

    def _item(self, seq: int) -> Message:
        return item_message(self._peer, seq, self.items[seq], self.mission_type, current=seq == self.current)

    def _is_overdue(self, seq: int, now: float) -> bool:
        if seq not in self._sent_s:
            return True
        # After accepting an item the vehicle requests the next item once. A request for an earlier item
        # restarts the transfer from that item.
        asks_again = seq in self._requested or seq < self._last_requested
        overdue_s = min(self.OVERDUE_ROUND_TRIPS * self._round_trip_s, self.MAX_OVERDUE_S)
        return asks_again and now - self._sent_s[seq] >= overdue_s

    @property
    def _is_all_sent(self) -> bool:
        return len(self._sent_s) == len(self.items)

    def _on_ack(self, code: int, now: float) -> None:
        name = result_name(code)
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if self._is_all_sent:
                self._end(UploadOutcome.ACCEPTED, name)
        elif code == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            # ArduPilot's answer to each duplicate; the transfer continues.
            self._last_nack = name
        elif code == mavlink.MAV_MISSION_ERROR:
            # ArduPilot: a repeated last item after acceptance, in this or the previous transfer. PX4: a
            # repeated announcement, or a final error. After a final error the requests stop.
            self._last_nack = name
            if self._is_all_sent and now - max(self._sent_s.values()) >= 0.9 * self._round_trip_s:
                self._end(UploadOutcome.UNCONFIRMED, name)
        elif code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            if self.state is ConversationState.EXCHANGING:  # otherwise the end of an earlier transfer
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
            self._end(UploadOutcome.NO_ANSWER, "the vehicle did not request the first item")
        elif not self._is_all_sent:
            self._end(UploadOutcome.INCOMPLETE, f"no request beyond item {self._max_requested}")
        else:
            self._end(UploadOutcome.UNCONFIRMED, "no acknowledgement after the last item")
        return closing

    def _end(self, outcome: UploadOutcome, reason: str) -> None:
        nack = f"; refusal {self._last_nack}" if self._last_nack and outcome is not outcome.ACCEPTED else ""
        text = f"upload {outcome.value}: {reason}{nack}"
        self._finish(UploadResult(outcome, text, is_lossy=self._is_lossy))
