"""Whether the mission on a vehicle is still the one that was put there: what it tells while nothing of own_items
runs.

https://mavlink.io/en/messages/common.html#MISSION_CURRENT: `total` is 0 where it is not supported, and 65535
where there is no mission; `mission_id` changes with what is in the mission, and is 0 where that is not
supported. PX4 tells it from 1.15 on, and by the MISSION_ACK of an upload before (`MavlinkMissionManager`).
ArduPilot tells none (`GCS_MAVLINK::send_mission_current`), but single items to whoever asks, outside of any
transfer (`MissionItemProtocol::handle_mission_request_int`): of those it is asked for one now and then, and
soon once it has said something that belongs to another's transfer.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.protocol.codec import Message, extension
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_download import item_of
from swarmctl.mavlink.protocol.mission_upload import MISSION

SETTLING_S = 2.0
"""What is said within this after a procedure of own_items may be of before."""
OTHER_MISSION_LASTS_S = 1.0
"""One message may have been overtaken; it comes twice a second."""
REQUEST_PERIOD_S = 5.0
"""for an item; every other time for the one that is flown"""
REQUEST_SOON_S = 1.0
"""once there is a reason to"""

_MISSION_ID_AT = 6
"""where it is in the payload of a MISSION_CURRENT"""
_OPAQUE_ID_AT = 4
"""in that of a MISSION_ACK"""
_TRANSFERS = ("MISSION_ACK", "MISSION_REQUEST", "MISSION_REQUEST_INT")
_CHANGED = "Auto mission changed"
"""what ArduPilot says to all when somebody writes into the mission that it flies"""


class MissionWatch:
    """Of one vehicle. `shows_other_mission` is told what comes while nothing of own_items runs, `hear` what comes while
    something does."""

    def __init__(self, peer: MavlinkPeer, dialect: Dialect) -> None:
        self._peer = peer
        self._dialect = dialect
        self._own_items: tuple[MissionItem, ...] = ()
        self._settled_at_s = 0.0
        self._other_since_s: float | None = None
        self._reports_count = False
        """it has told how many items it holds: a count of none is no old firmware's"""
        self._own_id: int | None = None
        """what it calls our mission"""
        self._acknowledged = 0
        self._reports_ids = False
        self._request_at_s = math.inf
        self._requested_seq: int | None = None
        """which item it was asked for last, and has not told yet"""
        self._suspect_seq: int | None = None
        """which was another than own_items when it was told last"""
        self._n_requests = 0

    def receive_own_transfer(self, message: Message) -> None:
        """While a procedure of own_items runs."""
        if message.get_type() != "MISSION_ACK" or not self._is_for_us(message):
            return
        if message.type == mavlink.MAV_MISSION_ACCEPTED:
            self._acknowledged = extension(message, _OPAQUE_ID_AT)

    def own_procedure_ended(self, own_items: tuple[MissionItem, ...], now: float) -> None:
        """`own_items`: what is verified on it now; empty where nothing is."""
        if own_items != self._own_items:
            self._own_items, self._own_id = own_items, self._acknowledged or None
        elif self._acknowledged not in (0, self._own_id):
            self._own_id = (
                None  # put there again, perhaps after another, whose id may be the last that was heard
            )
        self._acknowledged = 0
        self._settled_at_s, self._other_since_s = now + SETTLING_S, None
        self._requested_seq = self._suspect_seq = None
        asks = self._dialect.serves_single_items and len(own_items) > 1
        self._request_at_s = now + REQUEST_PERIOD_S if asks else math.inf

    def shows_other_mission(self, message: Message, now: float) -> bool:
        """Whether it has told twice, or for a while, that it holds another mission than own_items."""
        if not self._own_items or now < self._settled_at_s:
            return False
        kind = message.get_type()
        if kind == "MISSION_CURRENT":
            return self._reports_other_count_or_id(message, now)
        if kind == "MISSION_ITEM_INT" and self._is_for_us(message):
            return self._is_other_item(int(message.seq), item_of(message), now)
        of_a_transfer = kind in _TRANSFERS and message.mission_type == MISSION
        if of_a_transfer or (kind == "STATUSTEXT" and message.text.startswith(_CHANGED)):
            self._request_at_s = min(self._request_at_s, now + REQUEST_SOON_S)
        return False

    def _reports_other_count_or_id(self, message: Message, now: float) -> bool:
        expected = len(self._own_items) - self._dialect.uncounted_items
        name = extension(message, _MISSION_ID_AT)
        if name:
            self._reports_ids = True
            self._own_id = name if self._own_id is None else self._own_id
        self._reports_count = self._reports_count or int(message.total) == expected > 0
        none = () if self._reports_count else (0,)
        if int(message.total) in (expected, *none) and name in (0, self._own_id):
            self._other_since_s = None
            return False
        if self._other_since_s is None:
            self._other_since_s = now
        return now - self._other_since_s >= OTHER_MISSION_LASTS_S

    def _is_other_item(self, seq: int, found: MissionItem, now: float) -> bool:
        if seq != self._requested_seq:
            return False
        self._requested_seq = None
        if not self._dialect.differences((self._own_items[seq],), (found,), seq):
            self._suspect_seq = None
            return False
        if self._suspect_seq == seq:
            return True
        self._suspect_seq, self._request_at_s = seq, now + REQUEST_SOON_S
        return False

    @property
    def next_deadline(self) -> float | None:
        """When to ask; None: never."""
        return None if self._reports_ids or math.isinf(self._request_at_s) else self._request_at_s

    def tick(self, flown: int | None, now: float) -> list[Message]:
        """`flown`: the item that it says it flies."""
        if self.next_deadline is None or now < self._request_at_s or now < self._settled_at_s:
            return []
        self._request_at_s = now + REQUEST_PERIOD_S
        self._requested_seq = self._suspect_seq if self._suspect_seq is not None else self._next_seq(flown)
        to = (self._peer.sysid, self._peer.compid)
        return [mavlink.MAVLink_mission_request_int_message(*to, self._requested_seq, mission_type=MISSION)]

    def _next_seq(self, flown: int | None) -> int:
        """The first is home, which is the vehicle's own."""
        last = len(self._own_items) - 1
        turn, others = divmod(self._n_requests, 2)
        self._n_requests += 1
        if not others and flown is not None and 0 < flown <= last:
            return flown
        return 1 + turn % last

    def _is_for_us(self, message: Message) -> bool:
        return bool(message.mission_type == MISSION) and self._peer.is_for_us(message)
