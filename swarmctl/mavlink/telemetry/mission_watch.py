"""Mission watch: check, between own procedures, that a vehicle still stores the verified mission.

https://mavlink.io/en/messages/common.html#MISSION_CURRENT: `total` is 0 if unsupported, and 65535 if there is
no mission; `mission_id` changes with the mission's content, and is 0 if unsupported.

- PX4 sends `mission_id` from 1.15 on, and in the MISSION_ACK of an upload (`MavlinkMissionManager`).
- ArduPilot sends no id (`GCS_MAVLINK::send_mission_current`), but serves single items outside of a transfer
  (`MissionItemProtocol::handle_mission_request_int`). The watch requests one item every 5 s, and 1 s after a
  message from another station's transfer.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.protocol.codec import Message, extension
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import MISSION, item_of

SETTLING_S = 2.0
"""time after an own procedure during which messages are ignored: late messages show the previous mission"""
OTHER_MISSION_LASTS_S = 1.0
"""least duration of a deviation that counts, because one MISSION_CURRENT (2 Hz) may be late"""
REQUEST_PERIOD_S = 5.0
"""period of requests for an item; every second request is for the flown item"""
REQUEST_SOON_S = 1.0
"""delay of a request after a sign of another station's transfer, or after an item that differs"""

_MISSION_ID_AT = 6
"""offset of mission_id in the payload of a MISSION_CURRENT"""
_OPAQUE_ID_AT = 4
"""offset of opaque_id in the payload of a MISSION_ACK"""
_TRANSFERS = ("MISSION_ACK", "MISSION_REQUEST", "MISSION_REQUEST_INT")
_CHANGED = "Auto mission changed"
"""start of ArduPilot's text to all stations after a change of the flown mission"""


class MissionWatch:
    """Mission watch of one vehicle.

    The session passes a message to `receive_own_transfer` during an own procedure, else to
    `shows_other_mission`.
    """

    def __init__(self, peer: MavlinkPeer, dialect: Dialect) -> None:
        self._peer = peer
        self._dialect = dialect
        self._own_items: tuple[MissionItem, ...] = ()
        self._settled_at_s = 0.0
        self._other_since_s: float | None = None
        self._reports_count = False
        """True if the vehicle has reported the expected number of items, so 0 does not mean "unsupported"."""
        self._own_id: int | None = None
        """the vehicle's id of the own mission"""
        self._acknowledged_id = 0
        self._reports_ids = False
        self._request_at_s = math.inf
        self._requested_seq: int | None = None
        """last requested item, while not received yet"""
        self._suspect_seq: int | None = None
        """item that differed from the own mission when last received"""
        self._n_requests = 0

    def receive_own_transfer(self, message: Message) -> None:
        """Store the mission's id from a MISSION_ACK, while an own procedure runs."""
        if message.get_type() != "MISSION_ACK" or not self._is_for_us(message):
            return
        if message.type == mavlink.MAV_MISSION_ACCEPTED:
            self._acknowledged_id = extension(message, _OPAQUE_ID_AT)

    def own_procedure_ended(self, own_items: tuple[MissionItem, ...], now: float) -> None:
        """Watch `own_items`, the mission verified on the vehicle; empty: watch no mission."""
        if own_items != self._own_items:
            self._own_items, self._own_id = own_items, self._acknowledged_id or None
        elif self._acknowledged_id not in (0, self._own_id):
            self._own_id = None  # the mission was uploaded again and may have a new id
        self._acknowledged_id = 0
        self._settled_at_s, self._other_since_s = now + SETTLING_S, None
        self._requested_seq = self._suspect_seq = None
        can_request = self._dialect.serves_single_items and len(own_items) > 1
        self._request_at_s = now + REQUEST_PERIOD_S if can_request else math.inf

    def shows_other_mission(self, message: Message, now: float) -> bool:
        """Return whether an item has differed twice, or count or id have for OTHER_MISSION_LASTS_S."""
        if not self._own_items or now < self._settled_at_s:
            return False
        kind = message.get_type()
        if kind == "MISSION_CURRENT":
            return self._reports_other_count_or_id(message, now)
        if kind == "MISSION_ITEM_INT" and self._is_for_us(message):
            return self._is_other_item(int(message.seq), item_of(message), now)
        is_transfer = kind in _TRANSFERS and message.mission_type == MISSION
        if is_transfer or (kind == "STATUSTEXT" and message.text.startswith(_CHANGED)):
            self._request_at_s = min(self._request_at_s, now + REQUEST_SOON_S)
        return False

    def _reports_other_count_or_id(self, message: Message, now: float) -> bool:
        expected = len(self._own_items) - self._dialect.uncounted_items
        mission_id = extension(message, _MISSION_ID_AT)
        if mission_id:
            self._reports_ids = True
            self._own_id = mission_id if self._own_id is None else self._own_id
        self._reports_count = self._reports_count or int(message.total) == expected > 0
        unsupported = () if self._reports_count else (0,)
        if int(message.total) in (expected, *unsupported) and mission_id in (0, self._own_id):
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
        """Return the time of the next request; None: no request is planned."""
        return None if self._reports_ids or math.isinf(self._request_at_s) else self._request_at_s

    def tick(self, flown: int | None, now: float) -> list[Message]:
        """Return the request that is due, if any. `flown`: index of the vehicle's current item."""
        if self.next_deadline is None or now < self._request_at_s or now < self._settled_at_s:
            return []
        self._request_at_s = now + REQUEST_PERIOD_S
        self._requested_seq = self._suspect_seq if self._suspect_seq is not None else self._next_seq(flown)
        to = (self._peer.sysid, self._peer.compid)
        return [mavlink.MAVLink_mission_request_int_message(*to, self._requested_seq, mission_type=MISSION)]

    def _next_seq(self, flown: int | None) -> int:
        """Return the index of the next item to request; never 0: the vehicle overwrites item 0 with home."""
        last = len(self._own_items) - 1
        turn, is_odd = divmod(self._n_requests, 2)
        self._n_requests += 1
        if not is_odd and flown is not None and 0 < flown <= last:
            return flown
        return 1 + turn % last

    def _is_for_us(self, message: Message) -> bool:
        return bool(message.mission_type == MISSION) and self._peer.is_for_us(message)
