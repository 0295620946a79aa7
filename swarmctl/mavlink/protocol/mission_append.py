"""Appending items to a mission: https://mavlink.io/en/messages/common.html#MISSION_WRITE_PARTIAL_LIST

ArduPilot accepts a partial list that begins and ends at most one item after the last stored item. So each new
item has its own announcement. Announcement and item are sent together, several pairs at a time; otherwise
each item would take a round trip.

ArduPilot accepts an item with the expected number, requested or not (GCS_Common.cpp handle_mission_item,
MissionItemProtocol.cpp handle_mission_item). ArduPilot requests an announced item only if the item has not
arrived before the next queued_request_send. Usually the only answer is the acknowledgement.

| message | answer of ArduPilot |
|---|---|
| item too early, or without its announcement | ERROR |
| item with another number | INVALID_SEQUENCE |
| second announcement of an item | the transfer of that item begins again |
| second copy of an item | ERROR or INVALID_SEQUENCE |

A refusal does not name the item, so the number of stored items is requested after a silence. After a lost
message ArduPilot accepts no further item. So after a loss each announcement and item is sent several times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import MISSION, MissionTransfer, item_message, result_name
from swarmctl.mavlink.protocol.mission_upload import WINDOW


class AppendResult(msgspec.Struct, frozen=True):
    """Result of an append."""

    failure: str | None
    """None if the vehicle reports all items as stored; only a read-back confirms the items"""
    round_trip_s: float = 0.0
    """time from a message to its answer [s]"""
    is_late: bool = False
    """True if `too_late` stopped the append"""
    is_foreign: bool = False
    """True if the vehicle stores fewer items than before: another station has changed the mission"""


class Append(MissionTransfer[AppendResult]):
    """One attempt to append `items` to the `count` items that a vehicle stores.

    `too_late`: called with the round-trip time [s]; True stops the append as useless.
    """

    REPLIES = frozenset({"MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_COUNT"})
    QUIET_S = 0.5
    """shortest silence after which the number of stored items is requested; 1.5 round trips if longer"""
    MAX_QUIET_S = 4.0
    """longest silence before the number of stored items is requested; the silence doubles at each deadline"""
    STUCK_LIMIT_S = 30.0
    """longest time without a further stored item"""
    NO_ANSWER_S = 5.0
    """longest wait for the first answer"""
    MAX_COPIES = 3
    """greatest number of copies of each message; each further burst adds a copy"""
    MAX_BURSTS = 2
    """number of bursts without a stored item after which partial lists count as unsupported"""

    def __init__(
        self,
        peer: MavlinkPeer,
        count: int,
        items: Sequence[MissionItem],
        too_late: Callable[[float], bool] = lambda _round_trip_s: False,
    ) -> None:
        super().__init__(peer)
        self.too_late = too_late
        self.n_before = count
        self.items = tuple(items)
        self._n_stored = 0
        """items believed stored"""
        self._n_stored_max = 0
        """largest value of `_n_stored` so far"""
        self._n_sent = 0
        """items sent in this burst, counted from the first item"""
        self._copies = 1
        self._requested: set[int] = set()
        """items requested since they were sent"""
        self._last_nack = ""
        self._awaits_count = False
        self._n_count_requests = 0
        """unanswered requests for the number of items"""
        self._n_bursts = 0
        self._quiet_s = self.QUIET_S
        self._burst_at: float | None = None
        """time of the last burst, until its first answer"""
        self._round_trip_s = 0.0
        self._stuck_at = self._no_answer_at = 0.0

    def _begin(self, now: float) -> list[Message]:
        self._stuck_at, self._no_answer_at = now + self.STUCK_LIMIT_S, now + self.NO_ANSWER_S
        return self._burst(now)

    def _burst(self, now: float) -> list[Message]:
        """Return the messages for the items that are not stored yet."""
        if self._n_bursts:
            self._copies = min(self._copies + 1, self.MAX_COPIES)
        self._n_bursts += 1
        self._n_sent, self._requested, self._last_nack = self._n_stored, set(), ""
        self._awaits_count, self._burst_at = False, now
        return self._send_window(now)

    def _send_window(self, now: float) -> list[Message]:
        if self.too_late(self._round_trip_s):
            stored = f"only {self._n_stored} of {len(self.items)} items were stored in time"
            return self._end(stored, is_late=True)
        self.next_deadline = min(now + self._quiet_s, self._stuck_at)
        window = WINDOW if self._copies == 1 else 2 * WINDOW // self._copies
        first, self._n_sent = self._n_sent, min(max(self._n_stored + window, self._n_sent), len(self.items))
        to = (self._peer.sysid, self._peer.compid)
        messages: list[Message] = []
        for index in range(first, self._n_sent):
            seq = self.n_before + index
            announcement = mavlink.MAVLink_mission_write_partial_list_message(*to, seq, seq, MISSION)
            item = item_message(self._peer, seq, self.items[index])
            messages += [*[announcement] * self._copies, *[item] * self._copies]
        return messages

    def _on_reply(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind == "MISSION_ACK":
            return self._on_ack(int(message.type), now)
        if kind == "MISSION_COUNT":
            return self._on_count(int(message.count), now)
        return self._on_request(int(message.seq) - self.n_before, now)

    def _on_answer(self, now: float) -> None:
        """Store the round-trip time and postpone the next deadline."""
        if self.state is ConversationState.WAITING:
            self._enter(ConversationState.EXCHANGING)
        if self._burst_at is not None:
            self._round_trip_s, self._burst_at = now - self._burst_at, None
            self._quiet_s = max(self.QUIET_S, 1.5 * self._round_trip_s)
        self.next_deadline = min(now + self._quiet_s, self._stuck_at)

    def _set_stored(self, stored: int, now: float) -> None:
        if stored > self._n_stored_max:
            self._n_stored_max, self._stuck_at = stored, now + self.STUCK_LIMIT_S
        self._n_stored = stored

    def _on_request(self, index: int, now: float) -> list[Message]:
        if not 0 <= index < self._n_sent:
            return []
        self._on_answer(now)
        if index not in self._requested and not self._has_refused:
            self._requested.add(index)
            return []  # the item is under way
        return [item_message(self._peer, self.n_before + index, self.items[index])]

    def _on_ack(self, code: int, now: float) -> list[Message]:
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if self._n_stored >= self._n_sent:
                return []  # from an earlier transfer
            self._on_answer(now)
            self._set_stored(self._n_stored + 1, now)
            if self._n_stored == len(self.items):
                # The vehicle may acknowledge two copies of one item.
                return self._end(None) if self._copies == 1 else self._request_count()
            return [] if self._has_refused else self._send_window(now)
        if code == mavlink.MAV_MISSION_DENIED and self._n_count_requests:
            # DENIED answers a request for the number of items: the vehicle still expects an item.
            self._n_count_requests -= 1
            self._on_answer(now)
            return self._burst(now) if self._awaits_count else []
        name = result_name(code)
        if code in (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE):
            # A second copy, from this or the previous transfer, gets the same answer.
            self._last_nack = name
        elif code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            pass  # end of an earlier transfer, or a lost item: the next deadline asks for the count
        elif code == mavlink.MAV_MISSION_DENIED:
            # Perhaps the late answer to an earlier request: the next deadline asks for the count.
            if self.state is not ConversationState.WAITING:
                self._last_nack = name
        else:
            return self._end(f"{name} after {self._n_stored} of {len(self.items)} items")
        return []

    def _on_count(self, count: int, now: float) -> list[Message]:
        self._n_count_requests = max(self._n_count_requests - 1, 0)
        if not self._awaits_count:
            return []
        self._on_answer(now)
        stored = count - self.n_before
        if not 0 <= stored <= len(self.items):
            # Fewer items: another station's mission. More: perhaps late copies from an earlier append.
            expected = f"{self.n_before} to {self.n_before + len(self.items)}"
            reason = f"the vehicle stores {count} items, expected {expected} [mission-changed]"
            return self._end(reason, is_foreign=stored < 0)
        self._set_stored(stored, now)
        if stored == len(self.items):
            return self._end(None)
        if stored == 0 and self._n_bursts >= self.MAX_BURSTS:
            return self._end(f"the vehicle does not support partial lists{self._last_nack_text} [no-append]")
        return self._burst(now)

    def _on_deadline(self, now: float) -> list[Message]:
        if self.state is ConversationState.WAITING and now >= self._no_answer_at:
            return self._end(f"no answer for {self.NO_ANSWER_S:g} s [no-answer]")
        if now >= self._stuck_at:
            progress = (
                f"{self._n_stored} of {len(self.items)} items stored, no progress for "
                f"{self.STUCK_LIMIT_S:g} s"
            )
            return self._end(f"{progress}{self._last_nack_text} [append-stuck]")
        self._quiet_s = min(2.0 * self._quiet_s, self.MAX_QUIET_S)
        self.next_deadline = min(now + self._quiet_s, self._stuck_at)
        if self.state is ConversationState.WAITING:
            self.next_deadline = min(self.next_deadline, self._no_answer_at)
        return self._request_count()

    def _request_count(self) -> list[Message]:
        self._awaits_count = True
        self._n_count_requests += self._copies
        return [self._list_request()] * self._copies

    def _closing_messages(self, now: float) -> list[Message]:
        return []  # each item is a transfer of its own, which ends with the item

    @property
    def _has_refused(self) -> bool:
        """Return whether the vehicle has refused an item; with several copies a refusal proves nothing."""
        return bool(self._last_nack) and self._copies == 1

    @property
    def _last_nack_text(self) -> str:
        return f", last answer {self._last_nack}" if self._last_nack else ""

    def _end(self, reason: str | None, *, is_late: bool = False, is_foreign: bool = False) -> list[Message]:
        failure = None if reason is None else f"the new route is not stored after the old route: {reason}"
        self._finish(AppendResult(failure, self._round_trip_s, is_late, is_foreign))
        return []
