"""Adding items behind a mission: https://mavlink.io/en/messages/common.html#MISSION_WRITE_PARTIAL_LIST

ArduPilot takes a partial list that begins at most one behind the last item, and ends there as well: so each
item is announced by itself. It goes along with its announcement, and several of them at a time: one after
the other they would take as many answers of a slow link.

ArduPilot takes an item for the number that it expects, whether it has asked for it or not
(GCS_Common.cpp handle_mission_item, MissionItemProtocol.cpp handle_mission_item). It asks at its next turn to
send, and only if the item has not come until then (queued_request_send): most often there is the
acknowledgement alone. What comes too early or without its announcement is refused by ERROR, an item with
another number by INVALID_SEQUENCE. Neither says which it was: then it is asked how many items it holds.

Nothing of what comes behind a loss is taken, so where something was lost announcements and items go out
several times from then on: an announcement that comes twice begins anew, and a double of an item is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.mission_upload import MISSION, WINDOW, item_message


@dataclass(frozen=True, slots=True)
class AppendResult:
    """`failure` is None when every item was acknowledged; only reading back tells what is there."""

    failure: str | None
    round_trip_s: float = 0.0
    """from a message to its answer, over this link [s]"""
    is_late: bool = False
    """it was broken off as of no use any more"""
    is_foreign: bool = False
    """the vehicle holds another mission than the one that was verified on it"""


class Append(Conversation[AppendResult]):
    """One attempt to put `items` behind the `count` items that a vehicle holds.

    It is broken off where the vehicle is `too_late` for them, told how long an answer takes [s].
    """

    QUIET_S = 0.5
    """Where nothing comes for so long, or half as long again as answers take, it is asked what it holds."""
    MAX_QUIET_S = 4.0
    STUCK_LIMIT_S = 30.0
    """without one item more"""
    NO_ANSWER_S = 5.0
    """who has answered nothing by then is not reached"""
    MAX_COPIES = 3
    """of what is sent: one more after each loss"""
    MAX_BURSTS = 2
    """after so many without effect it does not know partial lists"""

    def __init__(
        self,
        peer: MavlinkPeer,
        count: int,
        items: Sequence[MissionItem],
        too_late: Callable[[float], bool] = lambda _round_trip_s: False,
    ) -> None:
        super().__init__()
        self._too_late = too_late
        self._peer = peer
        self._n_before = count
        self._items = tuple(items)
        self._n_stored = 0
        """so many are taken to be there"""
        self._n_stored_max = 0
        """were so at any time"""
        self._n_sent = 0
        """so many were sent"""
        self._copies = 1
        self._requested: set[int] = set()
        """for which it has asked since they were sent"""
        self._last_nack = ""
        self._awaits_count = False
        self._n_count_requests = 0
        """what it holds, asked and not answered"""
        self._n_bursts = 0
        self._quiet_s = self.QUIET_S
        self._burst_s: float | None = None
        """when what is not answered yet was sent"""
        self._round_trip_s = 0.0
        self._stuck_s = self._no_answer_s = 0.0

    def _begin(self, now: float) -> list[Message]:
        self._stuck_s, self._no_answer_s = now + self.STUCK_LIMIT_S, now + self.NO_ANSWER_S
        return self._burst(now)

    def _burst(self, now: float) -> list[Message]:
        """What is not there yet, from the first such item on."""
        if self._n_bursts:
            self._copies = min(self._copies + 1, self.MAX_COPIES)
        self._n_bursts += 1
        self._n_sent, self._requested, self._last_nack = self._n_stored, set(), ""
        self._awaits_count, self._burst_s = False, now
        return self._more(now)

    def _more(self, now: float) -> list[Message]:
        if self._too_late(self._round_trip_s):
            return self._end(f"{self._n_stored} of {len(self._items)} items in time", is_late=True)
        self.next_deadline = min(now + self._quiet_s, self._stuck_s)
        window = WINDOW if self._copies == 1 else 2 * WINDOW // self._copies
        first, self._n_sent = self._n_sent, min(max(self._n_stored + window, self._n_sent), len(self._items))
        to = (self._peer.sysid, self._peer.compid)
        messages: list[Message] = []
        for index in range(first, self._n_sent):
            seq = self._n_before + index
            announced = mavlink.MAVLink_mission_write_partial_list_message(*to, seq, seq, MISSION)
            item = item_message(self._peer, seq, self._items[index])
            messages += [*[announced] * self._copies, *[item] * self._copies]
        return messages

    def _on_message(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind not in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_COUNT"):
            return []
        if message.mission_type != MISSION or not self._peer.is_for_us(message):
            return []
        if kind == "MISSION_ACK":
            return self._on_ack(int(message.type), now)
        if kind == "MISSION_COUNT":
            return self._on_count(int(message.count), now)
        return self._on_request(int(message.seq) - self._n_before, now)

    def _on_answer(self, now: float) -> None:
        """It has answered what was sent."""
        if self.state is ConversationState.WAITING:
            self._enter(ConversationState.EXCHANGING)
        if self._burst_s is not None:
            self._round_trip_s, self._burst_s = now - self._burst_s, None
            self._quiet_s = max(self.QUIET_S, 1.5 * self._round_trip_s)
        self.next_deadline = min(now + self._quiet_s, self._stuck_s)

    def _set_stored(self, stored: int, now: float) -> None:
        if stored > self._n_stored_max:
            self._n_stored_max, self._stuck_s = stored, now + self.STUCK_LIMIT_S
        self._n_stored = stored

    def _on_request(self, index: int, now: float) -> list[Message]:
        if not 0 <= index < self._n_sent:
            return []
        self._on_answer(now)
        if index not in self._requested and not self._has_refused:
            self._requested.add(index)
            return []  # it is on its way
        return [item_message(self._peer, self._n_before + index, self._items[index])]

    def _on_ack(self, code: int, now: float) -> list[Message]:
        if code == mavlink.MAV_MISSION_ACCEPTED:
            if self._n_stored >= self._n_sent:
                return []  # of an earlier transfer
            self._on_answer(now)
            self._set_stored(self._n_stored + 1, now)
            if self._n_stored == len(self._items):
                # Of doubles that overtake each other both may be acknowledged.
                return self._end(None) if self._copies == 1 else self._request_count()
            return [] if self._has_refused else self._more(now)
        if code == mavlink.MAV_MISSION_DENIED and self._n_count_requests:
            # It was still expecting an item; what was sent since may answer an earlier question.
            self._n_count_requests -= 1
            self._on_answer(now)
            return self._burst(now) if self._awaits_count else []
        name = name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")
        if code in (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE):
            # Also its answer to what comes twice, in this transfer or late of the one before.
            self._last_nack = name
        elif code == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            pass  # the end of an earlier transfer, or of one whose item was lost: it is asked what it holds
        elif code == mavlink.MAV_MISSION_DENIED:
            # Perhaps of what was asked before this began, and was overtaken: it is asked what it holds.
            if self.state is not ConversationState.WAITING:
                self._last_nack = name
        else:
            return self._end(f"{name} after {self._n_stored} of {len(self._items)} items")
        return []

    def _on_count(self, count: int, now: float) -> list[Message]:
        self._n_count_requests = max(self._n_count_requests - 1, 0)
        if not self._awaits_count:
            return []
        self._on_answer(now)
        stored = count - self._n_before
        if not 0 <= stored <= len(self._items):
            # Fewer are another's; more may be late copies of what was sent before.
            why = f"it holds {count} items where {self._n_before} were known"
            return self._end(why, is_foreign=stored < 0)
        self._set_stored(stored, now)
        if stored == len(self._items):
            return self._end(None)
        if stored == 0 and self._n_bursts >= self.MAX_BURSTS:
            return self._end(f"it does not take partial lists{self._last_nack_text}")
        return self._burst(now)

    def _on_deadline(self, now: float) -> list[Message]:
        if self.state is ConversationState.WAITING and now >= self._no_answer_s:
            return self._end(f"no answer within {self.NO_ANSWER_S:g} s")
        if now >= self._stuck_s:
            how_far = f"{self._n_stored} of {len(self._items)} items, none more for {self.STUCK_LIMIT_S:g} s"
            return self._end(how_far + self._last_nack_text)
        self._quiet_s = min(2.0 * self._quiet_s, self.MAX_QUIET_S)
        self.next_deadline = min(now + self._quiet_s, self._stuck_s)
        if self.state is ConversationState.WAITING:
            self.next_deadline = min(self.next_deadline, self._no_answer_s)
        return self._request_count()

    def _request_count(self) -> list[Message]:
        self._awaits_count = True
        self._n_count_requests += self._copies
        to = (self._peer.sysid, self._peer.compid)
        return [mavlink.MAVLink_mission_request_list_message(*to, mission_type=MISSION)] * self._copies

    @property
    def _has_refused(self) -> bool:
        """What it refuses where all goes out several times may be but a double."""
        return bool(self._last_nack) and self._copies == 1

    @property
    def _last_nack_text(self) -> str:
        return f", last {self._last_nack}" if self._last_nack else ""

    def _end(self, why: str | None, *, is_late: bool = False, is_foreign: bool = False) -> list[Message]:
        failure = None if why is None else f"the new route was not written behind the old one: {why}"
        self._finish(AppendResult(failure, self._round_trip_s, is_late, is_foreign))
        return []
