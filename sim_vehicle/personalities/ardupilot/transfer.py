"""The mission protocol of ArduPilot: three independent servers.

The vehicle requests each item of an upload with MISSION_REQUEST. The stores of missions and rally points
write items as they arrive, so an aborted upload leaves a mixture of old and new items. The fence store writes
at the end. Downloads have no state.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.personalities.ardupilot.stores import Store
from sim_vehicle.vehicle.command import sender_of
from sim_vehicle.vehicle.injected_faults import MissionRefusal
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.mission_messages import (
    MISSION,
    MissionPeer,
    ack_message,
    count_message,
    item_from_message,
    item_message,
)

REQUEST_AGAIN_S = 1.0
ABANDON_AFTER_S = 8.0
GUIDED, ALTITUDE = 2, 3  # MISSION_ITEM.current: the item is a target for guided flight
ACCEPTED = int(mavlink.MAV_MISSION_ACCEPTED)
ERROR = int(mavlink.MAV_MISSION_ERROR)
DENIED = int(mavlink.MAV_MISSION_DENIED)

Send = Callable[[Any], None]
SendText = Callable[[int, str], None]


@dataclass
class _Upload:
    peer: MissionPeer
    next_seq: int
    last_seq: int
    last_received_s: float
    requested_s: float


class _Server:
    """Uploads to and downloads from one store."""

    def __init__(self, kind: int, store: Store, *, send: Send, send_text: SendText) -> None:
        self._kind, self._store, self._send, self._send_text = kind, store, send, send_text
        self._upload: _Upload | None = None

    @property
    def next_deadline_s(self) -> float:
        upload = self._upload
        if upload is None:
            return math.inf
        return min(upload.requested_s + REQUEST_AGAIN_S, upload.last_received_s + ABANDON_AFTER_S)

    @property
    def total(self) -> int:
        return self._store.total

    def tick(self, now: float) -> None:
        upload = self._upload
        if upload is None:
            return
        if now - upload.last_received_s >= ABANDON_AFTER_S - EPSILON_S:
            self._send_text(mavlink.MAV_SEVERITY_WARNING, f"{self._store.name} upload timeout")
            self._give_up(upload.peer, int(mavlink.MAV_MISSION_OPERATION_CANCELLED))
        elif now - upload.requested_s >= REQUEST_AGAIN_S - EPSILON_S:
            self._request_item(upload, now)

    def reset(self) -> None:
        if self._upload is not None:
            self._upload = None
            self._store.abandon()

    def on_count(self, message: Any, peer: MissionPeer, now: float) -> None:
        if self._upload is not None:
            if self._upload.peer != peer:
                self.acknowledge(peer, DENIED)
                return
            self._store.abandon()
        if message.count > self._store.max_items:
            self._upload = None
            self.acknowledge(peer, int(mavlink.MAV_MISSION_NO_SPACE))
            text = f"Only {self._store.max_items} items are supported"
            self._send_text(mavlink.MAV_SEVERITY_WARNING, text)
            return
        self._upload = None
        self._store.begin(message.count)
        if message.count == 0:
            self.acknowledge(peer, self._store.complete())
        else:
            self._begin(peer, 0, message.count - 1, now)

    def on_write_partial(self, message: Any, peer: MissionPeer, now: float) -> None:
        if self._upload is not None and self._upload.peer != peer:
            self.acknowledge(peer, DENIED)
            return
        first, last = message.start_index, message.end_index
        if not 0 <= first <= last <= self._store.count:
            self._send_text(mavlink.MAV_SEVERITY_WARNING, "Flight plan update rejected")
            self.acknowledge(peer, ERROR)
            return
        self._store.begin_update()
        self._begin(peer, first, last, now)

    def on_item(self, message: Any, peer: MissionPeer, now: float, refusal: int | None = None) -> None:
        upload = self._upload
        if upload is None:
            self.acknowledge(peer, ERROR)
        elif message.seq != upload.next_seq:
            self.acknowledge(peer, int(mavlink.MAV_MISSION_INVALID_SEQUENCE))
        elif upload.peer != peer:
            self.acknowledge(peer, DENIED)
        else:
            self._accept_item(upload, item_from_message(message), refusal, now)

    def _accept_item(self, upload: _Upload, item: Item | None, refusal: int | None, now: float) -> None:
        if refusal is not None:
            result = refusal
        elif item is None:
            result = int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        else:
            result = self._store.put(upload.next_seq, item, upload.last_seq)
        if result != ACCEPTED:
            self._give_up(upload.peer, result)
            return
        upload.last_received_s = now
        upload.next_seq += 1
        if upload.next_seq <= upload.last_seq:
            self._request_item(upload, now)
        else:
            self._upload = None
            self.acknowledge(upload.peer, self._store.complete())

    def on_clear(self, peer: MissionPeer) -> None:
        cleared = self._upload is None and self._store.clear()
        self.acknowledge(peer, ACCEPTED if cleared else ERROR)

    def on_request_list(self, peer: MissionPeer) -> None:
        if self._upload is not None:
            self.acknowledge(peer, DENIED)
        else:
            self._send(count_message(peer, self._store.count, self._kind))

    def on_request(self, message: Any, peer: MissionPeer) -> None:
        if self._upload is not None:
            self.acknowledge(peer, DENIED)
            return
        found = self._store.read(message.seq)
        if isinstance(found, Item):
            as_int = message.get_type() == "MISSION_REQUEST_INT"
            autocontinue = self._store.autocontinue
            self._send(
                item_message(peer, message.seq, found, self._kind, as_int=as_int, autocontinue=autocontinue)
            )
            return
        if self._kind == MISSION:  # ArduPilot sends the count before the refusal
            self._send(count_message(peer, self._store.count, self._kind))
        self.acknowledge(peer, found)

    def acknowledge(self, peer: MissionPeer, result: int) -> None:
        self._send(ack_message(peer, result, self._kind))

    def _begin(self, peer: MissionPeer, first: int, last: int, now: float) -> None:
        self._upload = _Upload(peer, first, last, last_received_s=now, requested_s=now)
        self._request_item(self._upload, now)

    def _request_item(self, upload: _Upload, now: float) -> None:
        upload.requested_s = now
        self._send(mavlink.MAVLink_mission_request_message(*upload.peer, upload.next_seq, self._kind))

    def _give_up(self, peer: MissionPeer, result: int) -> None:
        self._upload = None
        self._store.abandon()
        self.acknowledge(peer, result)


class ArduPilotTransfer:
    """Server of mission messages for one vehicle.

    Parameters
    ----------
    stores: the lists by MAV_MISSION_TYPE; file transfers use the same stores.
    store_item: converts an item to its stored form, or returns the MAV_MISSION_RESULT of a refusal.
    send: receives each outgoing message.
    send_text: sends a STATUSTEXT (severity, text).
    stored: called with MAV_MISSION_TYPE and the new value of MIS_TOTAL, FENCE_TOTAL or RALLY_TOTAL.
    guided: flies to an item (`current` 2), or with True as second argument changes only the altitude
        (`current` 3); returns False if the vehicle refuses.
    refusal: returns a fault that refuses uploads, or None.
    """

    def __init__(
        self,
        stores: Mapping[int, Store],
        *,
        store_item: Callable[[Item], Item | int],
        send: Send,
        send_text: SendText,
        stored: Callable[[int, int], None],
        guided: Callable[[Item, bool], bool],
        refusal: Callable[[], MissionRefusal | None],
    ) -> None:
        self._send, self._guided, self._refusal, self._store_item = send, guided, refusal, store_item
        self.stores = stores
        self._stored = stored
        self._servers = {
            kind: _Server(kind, store, send=send, send_text=send_text) for kind, store in stores.items()
        }
        self._handlers: dict[str, Callable[[_Server, Any, MissionPeer, float], None]] = {
            "MISSION_COUNT": self._on_count,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_ITEM": self._on_item,
            "MISSION_WRITE_PARTIAL_LIST": lambda server, m, peer, now: server.on_write_partial(m, peer, now),
            "MISSION_REQUEST_LIST": lambda server, _m, peer, _now: server.on_request_list(peer),
            "MISSION_REQUEST_INT": lambda server, m, peer, _now: server.on_request(m, peer),
            "MISSION_REQUEST": lambda server, m, peer, _now: server.on_request(m, peer),
            "MISSION_CLEAR_ALL": lambda server, _m, peer, _now: server.on_clear(peer),
        }

    @property
    def ids(self) -> tuple[int, int, int]:
        """MISSION_CURRENT.mission_id, fence_id, rally_points_id: always 0 on this autopilot."""
        return 0, 0, 0

    @property
    def next_deadline_s(self) -> float:
        """Time at which `tick` has work [s]; inf: no upload."""
        return min(server.next_deadline_s for server in self._servers.values())

    def handles(self, message_type: str) -> bool:
        return message_type in self._handlers

    def receive(self, message: Any, now: float) -> None:
        """Process one message of the mission protocol at `now` [s]."""
        peer, kind = sender_of(message), message.mission_type
        server = self._servers.get(kind)
        if server is None:
            self._send(ack_message(peer, int(mavlink.MAV_MISSION_UNSUPPORTED), kind))
            return
        total = server.total
        self._handlers[message.get_type()](server, message, peer, now)
        if server.total != total:
            self._stored(kind, server.total)

    def tick(self, now: float) -> None:
        """Repeat requests, or abandon uploads after a timeout, at `now` [s]."""
        for server in self._servers.values():
            server.tick(now)

    def reset(self) -> None:
        """Forget uploads after a reboot; stored lists stay."""
        for server in self._servers.values():
            server.reset()

    def _on_count(self, server: _Server, message: Any, peer: MissionPeer, now: float) -> None:
        refusal = self._refusal()
        if refusal is not None and refusal.at_item is None:
            server.acknowledge(peer, refusal.result)
        else:
            server.on_count(message, peer, now)

    def _on_item(self, server: _Server, message: Any, peer: MissionPeer, now: float) -> None:
        if message.mission_type == MISSION and message.current in (GUIDED, ALTITUDE):
            server.acknowledge(peer, self._fly_guided(message))
            return
        refusal = self._refusal()
        refused = refusal is not None and refusal.at_item == message.seq
        server.on_item(message, peer, now, refusal.result if refusal is not None and refused else None)

    def _fly_guided(self, message: Any) -> int:
        item = item_from_message(message)
        if item is None:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        stored = self._store_item(item)
        if not isinstance(stored, Item):
            return stored
        altitude_only = message.current == ALTITUDE
        accepted = self._guided(stored, altitude_only)
        return ACCEPTED if accepted or altitude_only else ERROR
