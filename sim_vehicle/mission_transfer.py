"""The vehicle's side of the mission protocol, as a machine without I/O.

Mission items (type 0) are served in full. Rally points (type 2) are honestly empty; fences (type 1) and every
other type are answered UNSUPPORTED.

Items are written into the stored mission one by one as they arrive: the transfer is not atomic, and one that
dies leaves a mixture of new and old items, as ArduPilot does.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.mission import Item, Mission

REQUEST_AGAIN_S = 1.0
ABANDON_AFTER_S = 8.0
MISSION = mavlink.MAV_MISSION_TYPE_MISSION


@dataclass
class _Upload:
    peer: tuple[int, int]  # system and component id of the ground station
    next: int
    last: int
    heard_s: float
    asked_s: float


class MissionTransfer:
    """Answers mission messages on behalf of one vehicle.

    Parameters
    ----------
    mission: what is read and written.
    store_item: the autopilot's own conversion: item -> what is kept of it, or a MAV_MISSION_RESULT.
    max_items: more than this many are refused with NO_SPACE.
    send: takes each outgoing message.
    say: sends a STATUSTEXT (severity, text).
    changed: called with the index of each stored item that became another (or -1 where the list was cut).
    flying: whether the vehicle is flying the mission now (it then refuses to clear it).
    """

    def __init__(
        self,
        mission: Mission,
        *,
        store_item: Callable[[Item], Item | int],
        max_items: int,
        send: Callable[[Any], None],
        say: Callable[[int, str], None],
        changed: Callable[[int], None],
        flying: Callable[[], bool],
    ) -> None:
        self._mission = mission
        self._store_item = store_item
        self._max_items = max_items
        self._send = send
        self._say = say
        self._changed = changed
        self._flying = flying
        self._upload: _Upload | None = None
        self._handlers: dict[str, Callable[[Any, tuple[int, int], float], None]] = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM_INT": self._item,
            "MISSION_ITEM": self._item,
            "MISSION_WRITE_PARTIAL_LIST": self._write_partial,
            "MISSION_REQUEST_LIST": self._request_list,
            "MISSION_REQUEST_PARTIAL_LIST": self._request_partial,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_REQUEST": self._request,
            "MISSION_CLEAR_ALL": self._clear,
        }

    def handles(self, message_type: str) -> bool:
        return message_type in self._handlers

    def receive(self, message: Any, now: float) -> None:
        """Take one message of the mission protocol at `now` [s]."""
        peer = (message.get_srcSystem(), message.get_srcComponent())
        kind = message.mission_type
        if kind == mavlink.MAV_MISSION_TYPE_RALLY and message.get_type() == "MISSION_REQUEST_LIST":
            self._send(mavlink.MAVLink_mission_count_message(*peer, 0, kind))
        elif kind != MISSION:
            self._acknowledge(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
        else:
            self._handlers[message.get_type()](message, peer, now)

    def tick(self, now: float) -> None:
        """Ask again or give up, by the time `now` [s]."""
        upload = self._upload
        if upload is None:
            return
        if now - upload.heard_s > ABANDON_AFTER_S:
            self._upload = None
            self._say(mavlink.MAV_SEVERITY_WARNING, "Mission upload timeout")
            self._acknowledge(upload.peer, mavlink.MAV_MISSION_OPERATION_CANCELLED)
        elif now - upload.asked_s >= REQUEST_AGAIN_S:
            self._ask(upload, now)

    def reset(self) -> None:
        """The vehicle rebooted: a transfer under way is forgotten, the stored mission stays."""
        self._upload = None

    # -- upload ------------------------------------------------------------------------------------------

    def _count(self, message: Any, peer: tuple[int, int], now: float) -> None:
        if self._upload is not None and self._upload.peer != peer:
            self._acknowledge(peer, mavlink.MAV_MISSION_DENIED)
            return
        if message.count > self._max_items:
            self._acknowledge(peer, mavlink.MAV_MISSION_NO_SPACE)
            self._say(mavlink.MAV_SEVERITY_WARNING, f"Only {self._max_items} items are supported")
            return
        self._upload = None
        if message.count < self._mission.count:
            del self._mission.items[message.count :]
            self._changed(-1)
        if message.count == 0:
            self._complete(peer)
        else:
            self._begin(peer, 0, message.count - 1, now)

    def _write_partial(self, message: Any, peer: tuple[int, int], now: float) -> None:
        first, last = message.start_index, message.end_index
        if not 0 <= first <= last <= self._mission.count:
            self._say(mavlink.MAV_SEVERITY_WARNING, "Flight plan update rejected")
            self._acknowledge(peer, mavlink.MAV_MISSION_ERROR)
            return
        self._begin(peer, first, last, now)

    def _begin(self, peer: tuple[int, int], first: int, last: int, now: float) -> None:
        self._upload = _Upload(peer, first, last, heard_s=now, asked_s=now)
        self._ask(self._upload, now)

    def _ask(self, upload: _Upload, now: float) -> None:
        upload.asked_s = now
        self._send(mavlink.MAVLink_mission_request_message(*upload.peer, upload.next, MISSION))

    def _item(self, message: Any, peer: tuple[int, int], now: float) -> None:
        upload = self._upload
        if upload is None:
            self._acknowledge(peer, mavlink.MAV_MISSION_ERROR)
            return
        if message.seq != upload.next:
            self._acknowledge(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        if upload.peer != peer:
            self._acknowledge(peer, mavlink.MAV_MISSION_DENIED)
            return
        result = self._write(upload, item_from_message(message))
        if result != mavlink.MAV_MISSION_ACCEPTED:
            self._upload = None
            self._acknowledge(peer, result)
            return
        upload.heard_s = now
        upload.next += 1
        if upload.next > upload.last:
            self._complete(peer)
        else:
            self._ask(upload, now)

    def _write(self, upload: _Upload, item: Item | None) -> int:
        """Put one item into the stored mission; returns a MAV_MISSION_RESULT."""
        if item is None:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        stored = self._store_item(item)
        if not isinstance(stored, Item):
            return stored
        count, index = self._mission.count, upload.next
        if stored.command == mavlink.MAV_CMD_DO_JUMP:
            target = int(stored.param1)
            if target == 0 or (target >= count and target > upload.last):
                return int(mavlink.MAV_MISSION_ERROR)
        if index > count:
            return int(mavlink.MAV_MISSION_ERROR)
        if index == count:
            if count >= self._max_items:
                return int(mavlink.MAV_MISSION_ERROR)
            self._mission.items.append(stored)
            self._changed(index)
        elif self._mission.items[index] != stored:
            self._mission.items[index] = stored
            self._changed(index)
        return int(mavlink.MAV_MISSION_ACCEPTED)

    def _complete(self, peer: tuple[int, int]) -> None:
        self._upload = None
        self._say(mavlink.MAV_SEVERITY_INFO, "Flight plan received")
        self._acknowledge(peer, mavlink.MAV_MISSION_ACCEPTED)

    def _clear(self, _message: Any, peer: tuple[int, int], _now: float) -> None:
        if self._flying() or self._upload is not None:
            self._acknowledge(peer, mavlink.MAV_MISSION_ERROR)
            return
        self._mission.items.clear()
        self._mission.reset()
        self._acknowledge(peer, mavlink.MAV_MISSION_ACCEPTED)

    # -- download ----------------------------------------------------------------------------------------

    def _request_list(self, _message: Any, peer: tuple[int, int], _now: float) -> None:
        if self._upload is not None:
            self._acknowledge(peer, mavlink.MAV_MISSION_DENIED)
            return
        self._send(mavlink.MAVLink_mission_count_message(*peer, self._mission.count, MISSION))

    def _request_partial(self, message: Any, peer: tuple[int, int], _now: float) -> None:
        """Send the items of the range at once (end -1: up to the last)."""
        last = self._mission.count - 1 if message.end_index == -1 else message.end_index
        if self._upload is not None:
            self._acknowledge(peer, mavlink.MAV_MISSION_DENIED)
        elif not 0 <= message.start_index <= last < self._mission.count:
            self._acknowledge(peer, mavlink.MAV_MISSION_ERROR)
        else:
            for seq in range(message.start_index, last + 1):
                self._send(item_int_message(peer, seq, self._mission.item(seq)))

    def _request(self, message: Any, peer: tuple[int, int], _now: float) -> None:
        if self._upload is not None:
            self._acknowledge(peer, mavlink.MAV_MISSION_DENIED)
        elif message.seq != 0 and message.seq >= self._mission.count:
            self._send(mavlink.MAVLink_mission_count_message(*peer, self._mission.count, MISSION))
            self._acknowledge(peer, mavlink.MAV_MISSION_ERROR)
        elif message.get_type() == "MISSION_REQUEST":
            self._send(item_message(peer, message.seq, self._mission.item(message.seq)))
        else:
            self._send(item_int_message(peer, message.seq, self._mission.item(message.seq)))

    def _acknowledge(self, peer: tuple[int, int], result: int, kind: int = MISSION) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*peer, result, kind))


def item_from_message(message: Any) -> Item | None:
    """MISSION_ITEM_INT or the legacy MISSION_ITEM -> Item; None where its coordinates are no numbers."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) < 214 and abs(y) < 214):
            return None
        x, y = round(x * 1e7), round(y * 1e7)
    return Item(
        command=message.command,
        frame=message.frame,
        param1=message.param1,
        param2=message.param2,
        param3=message.param3,
        param4=message.param4,
        x=x,
        y=y,
        z=message.z,
    )


def item_int_message(peer: tuple[int, int], seq: int, item: Item) -> Any:
    """MISSION_ITEM_INT to a ground station."""
    parameters = (item.param1, item.param2, item.param3, item.param4)
    return mavlink.MAVLink_mission_item_int_message(
        *peer, seq, item.frame, item.command, 0, 1, *parameters, item.x, item.y, item.z, MISSION
    )


def item_message(peer: tuple[int, int], seq: int, item: Item) -> Any:
    """The legacy MISSION_ITEM to a ground station that asked with MISSION_REQUEST."""
    parameters = (item.param1, item.param2, item.param3, item.param4)
    return mavlink.MAVLink_mission_item_message(
        *peer, seq, item.frame, item.command, 0, 1, *parameters, item.x * 1e-7, item.y * 1e-7, item.z, MISSION
    )
