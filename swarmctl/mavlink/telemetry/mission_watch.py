"""Whether the mission on a vehicle is still the one that was put there: what it tells while nothing of ours
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
from swarmctl.mavlink.protocol.conversation import Peer
from swarmctl.mavlink.protocol.mission_download import item_of
from swarmctl.mavlink.protocol.mission_upload import MISSION

SETTLES_S = 2.0
"""What is said within this after a procedure of ours may be of before."""
LASTS_S = 1.0
"""One message may have been overtaken; it comes twice a second."""
ASKS_EVERY_S = 5.0
"""for an item; every other time for the one that is flown"""
ASKS_SOON_S = 1.0
"""once there is a reason to"""

_MISSION_ID_AT = 6
"""where it is in the payload of a MISSION_CURRENT"""
_OPAQUE_ID_AT = 4
"""in that of a MISSION_ACK"""
_TRANSFERS = ("MISSION_ACK", "MISSION_REQUEST", "MISSION_REQUEST_INT")
_CHANGED = "Auto mission changed"
"""what ArduPilot says to all when somebody writes into the mission that it flies"""


class MissionWatch:
    """Of one vehicle. `is_another` is told what comes while nothing of ours runs, `hear` what comes while
    something does."""

    def __init__(self, peer: Peer, dialect: Dialect) -> None:
        self._peer = peer
        self._dialect = dialect
        self._ours: tuple[MissionItem, ...] = ()
        self._quiet_until_s = 0.0
        self._other_since_s: float | None = None
        self._counts = False
        """it has told how many items it holds: a count of none is no old firmware's"""
        self._id: int | None = None
        """what it calls our mission"""
        self._acknowledged = 0
        self._tells_ids = False
        self._ask_at_s = math.inf
        self._asked: int | None = None
        """which item it was asked for last, and has not told yet"""
        self._doubted: int | None = None
        """which was another than ours when it was told last"""
        self._n_asked = 0

    def hear(self, message: Message) -> None:
        """While a procedure of ours runs."""
        if message.get_type() != "MISSION_ACK" or not self._is_ours(message):
            return
        if message.type == mavlink.MAV_MISSION_ACCEPTED:
            self._acknowledged = extension(message, _OPAQUE_ID_AT)

    def own_procedure_ended(self, ours: tuple[MissionItem, ...], now: float) -> None:
        """`ours`: what is verified on it now; empty where nothing is."""
        if ours != self._ours:
            self._ours, self._id = ours, self._acknowledged or None
        elif self._acknowledged not in (0, self._id):
            self._id = None  # put there again, perhaps after another, whose id may be the last that was heard
        self._acknowledged = 0
        self._quiet_until_s, self._other_since_s = now + SETTLES_S, None
        self._asked = self._doubted = None
        asks = self._dialect.tells_single_items and len(ours) > 1
        self._ask_at_s = now + ASKS_EVERY_S if asks else math.inf

    def is_another(self, message: Message, now: float) -> bool:
        """Whether it has told twice, or for a while, that it holds another mission than ours."""
        if not self._ours or now < self._quiet_until_s:
            return False
        kind = message.get_type()
        if kind == "MISSION_CURRENT":
            return self._is_counted_or_named_otherwise(message, now)
        if kind == "MISSION_ITEM_INT" and self._is_ours(message):
            return self._is_another_item(int(message.seq), item_of(message), now)
        of_a_transfer = kind in _TRANSFERS and message.mission_type == MISSION
        if of_a_transfer or (kind == "STATUSTEXT" and message.text.startswith(_CHANGED)):
            self._ask_at_s = min(self._ask_at_s, now + ASKS_SOON_S)
        return False

    def _is_counted_or_named_otherwise(self, message: Message, now: float) -> bool:
        expected = len(self._ours) - self._dialect.uncounted_items
        name = extension(message, _MISSION_ID_AT)
        if name:
            self._tells_ids = True
            self._id = name if self._id is None else self._id
        self._counts = self._counts or int(message.total) == expected > 0
        none = () if self._counts else (0,)
        if int(message.total) in (expected, *none) and name in (0, self._id):
            self._other_since_s = None
            return False
        if self._other_since_s is None:
            self._other_since_s = now
        return now - self._other_since_s >= LASTS_S

    def _is_another_item(self, seq: int, found: MissionItem, now: float) -> bool:
        if seq != self._asked:
            return False
        self._asked = None
        if not self._dialect.differences((self._ours[seq],), (found,), seq):
            self._doubted = None
            return False
        if self._doubted == seq:
            return True
        self._doubted, self._ask_at_s = seq, now + ASKS_SOON_S
        return False

    @property
    def next_deadline(self) -> float | None:
        """When to ask; None: never."""
        return None if self._tells_ids or math.isinf(self._ask_at_s) else self._ask_at_s

    def tick(self, flown: int | None, now: float) -> list[Message]:
        """`flown`: the item that it says it flies."""
        if self.next_deadline is None or now < self._ask_at_s or now < self._quiet_until_s:
            return []
        self._ask_at_s = now + ASKS_EVERY_S
        self._asked = self._doubted if self._doubted is not None else self._next(flown)
        to = (self._peer.sysid, self._peer.compid)
        return [mavlink.MAVLink_mission_request_int_message(*to, self._asked, mission_type=MISSION)]

    def _next(self, flown: int | None) -> int:
        """The first is home, which is the vehicle's own."""
        last = len(self._ours) - 1
        turn, others = divmod(self._n_asked, 2)
        self._n_asked += 1
        if not others and flown is not None and 0 < flown <= last:
            return flown
        return 1 + turn % last

    def _is_ours(self, message: Message) -> bool:
        return bool(message.mission_type == MISSION) and self._peer.is_for_us(message)
