"""Reading a mission back: https://mavlink.io/en/services/mission.html#download_mission"""

from __future__ import annotations

from enum import Enum

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import MISSION, MissionTransfer, item_of, result_name


class DownloadOutcome(Enum):
    COMPLETE = "complete"
    REFUSED = "refused"
    """error answer of the vehicle; DENIED during an unfinished upload"""
    NO_ANSWER = "no answer"
    """MISSION_COUNT did not arrive"""
    BROKEN_OFF = "broken off"
    """MISSION_COUNT arrived, but not all items. PX4 ends a transfer after 5 s without a request, so the
    download has to be restarted."""


class DownloadResult(msgspec.Struct, frozen=True):
    """Outcome of a download and its items."""

    outcome: DownloadOutcome
    items: tuple[MissionItem, ...]
    """items from `first` on; empty unless COMPLETE"""
    text: str


class Download(MissionTransfer[DownloadResult]):
    """One attempt to read the items from `first` on.

    window: number of items requested at a time; 1: each item takes a round trip
    copies: number of times that each request is sent
    in_order: True for PX4, which serves only the next item and the last served item. Any other request ends
        the transfer. So if `window` > 1, the download has to be restarted after a loss.
    """

    REPLIES = frozenset({"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"})
    REPEAT_PERIOD_S, MAX_REPEAT_PERIOD_S = 1.0, 4.0
    TRIES = 12
    """Number of tries of a request. With 30 % loss, six tries fail in 59 % of all transfers of 50 items."""

    def __init__(
        self,
        peer: MavlinkPeer,
        mission_type: int = MISSION,
        first: int = 0,
        window: int = 1,
        copies: int = 1,
        *,
        in_order: bool = False,
    ) -> None:
        super().__init__(peer, mission_type)
        self.first = self._next = self._requested_to = first
        self._window, self._copies, self._in_order = window, copies, in_order
        self._repeat_s, self._begin_s = self.REPEAT_PERIOD_S, 0.0
        self._count = 0
        self._items: dict[int, MissionItem] = {}
        self._tries = 0

    def _begin(self, now: float) -> list[Message]:
        self._begin_s = now
        return self._request(now)

    def _request(self, now: float) -> list[Message]:
        self._tries += 1
        self.next_deadline = now + self._repeat_s
        if self.state is ConversationState.WAITING:
            return [self._list_request()]
        self._requested_to = self._next
        return self._request_items()

    def _request_items(self) -> list[Message]:
        """Return requests for the items in the window that are neither received nor requested yet."""
        end = min(self._next + self._window, self._count)
        to_request = [seq for seq in range(self._requested_to, end) if seq not in self._items]
        self._requested_to = max(self._requested_to, end)
        to = (self._peer.sysid, self._peer.compid)
        return [
            mavlink.MAVLink_mission_request_int_message(*to, seq, mission_type=self.mission_type)
            for seq in to_request
            for _ in range(self._copies)
        ]

    def _on_reply(self, message: Message, now: float) -> list[Message]:
        kind = message.get_type()
        if kind == "MISSION_COUNT" and self.state is ConversationState.WAITING:
            self._enter(ConversationState.EXCHANGING)
            self._count = int(message.count)
            if self._window > 1:  # with a window of 1 a repeated request costs less than a long wait
                round_trip_s = now - self._begin_s  # an upper limit, if requests were lost
                self._repeat_s = min(max(self.REPEAT_PERIOD_S, 1.5 * round_trip_s), self.MAX_REPEAT_PERIOD_S)
            return self._proceed(now)
        if kind == "MISSION_ITEM_INT" and self._next <= message.seq < self._requested_to:
            self._items[int(message.seq)] = item_of(message)
            while self._next in self._items:
                self._next += 1
            return self._proceed(now)
        if kind == "MISSION_ACK":
            self._on_ack(int(message.type))
        return []

    def _proceed(self, now: float) -> list[Message]:
        if self._next < self._count:
            self._tries = 1
            self.next_deadline = now + self._repeat_s
            return self._request_items()
        self._end(DownloadOutcome.COMPLETE, f"{self._count} items")
        return [self._ack(mavlink.MAV_MISSION_ACCEPTED)]

    def _on_ack(self, code: int) -> None:
        # Acceptance, cancellation and refusals of duplicates answer an earlier upload. ArduPilot also answers
        # ERROR to a repeated last item of an upload, but never to MISSION_REQUEST_LIST.
        stale = (
            mavlink.MAV_MISSION_ACCEPTED,
            mavlink.MAV_MISSION_OPERATION_CANCELLED,
            mavlink.MAV_MISSION_INVALID_SEQUENCE,
            *([mavlink.MAV_MISSION_ERROR] if self.state is ConversationState.WAITING else []),
        )
        if code not in stale:
            self._end(DownloadOutcome.REFUSED, result_name(code))

    def _on_deadline(self, now: float) -> list[Message]:
        may_not_repeat = self.state is ConversationState.EXCHANGING and self._in_order and self._window > 1
        if self._tries < self.TRIES and not may_not_repeat:
            return self._request(now)
        closing = self._closing_messages(now)
        if self.state is ConversationState.WAITING:
            self._end(DownloadOutcome.NO_ANSWER, f"no MISSION_COUNT after {self._tries} requests")
        else:
            requests = "1 request" if self._tries == 1 else f"{self._tries} requests"
            self._end(DownloadOutcome.BROKEN_OFF, f"no answer to {requests} for item {self._next}")
        return closing

    def _end(self, outcome: DownloadOutcome, reason: str) -> None:
        complete = outcome is DownloadOutcome.COMPLETE
        items = tuple(self._items[seq] for seq in sorted(self._items)) if complete else ()
        self._finish(DownloadResult(outcome, items, f"read-back {outcome.value}: {reason}"))
