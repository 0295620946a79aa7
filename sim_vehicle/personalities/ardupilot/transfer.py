"""The mission protocol of ArduPilot: three independent servers.

The vehicle requests each item of an upload with MISSION_REQUEST. The stores of missions and rally points
write items as they arrive, so an aborted upload leaves a mixture of old and new items. The fence store writes
at the end. Downloads have no state.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.personalities.ardupilot.parameters import TOTALS
from sim_vehicle.personalities.ardupilot.stores import FenceStore, MissionStore, RallyStore, Store
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.command import sender_of
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.mission_messages import (
    FENCE,
    MISSION,
    RALLY,
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


@dataclass
class _Upload:
    peer: MissionPeer
    next_seq: int
    last_seq: int
    last_received_s: float
    requested_s: float


class _Server:
    """Uploads to and downloads from one list of the vehicle."""

    def __init__(self, vehicle: Vehicle, kind: int, store: Store) -> None:
        self._vehicle, self._kind, self._store = vehicle, kind, store
        self._upload: _Upload | None = None

    @property
    def next_deadline_s(self) -> float:
        upload = self._upload
        if upload is None:
            return math.inf
        return min(upload.requested_s + REQUEST_AGAIN_S, upload.last_received_s + ABANDON_AFTER_S)

    def tick(self, now: float) -> None:
        upload = self._upload
        if upload is None:
            return
        if now - upload.last_received_s >= ABANDON_AFTER_S - EPSILON_S:
            self._vehicle.send_text(mavlink.MAV_SEVERITY_WARNING, f"{self._store.name} upload timeout")
            self._give_up(upload.peer, int(mavlink.MAV_MISSION_OPERATION_CANCELLED))
        elif now - upload.requested_s >= REQUEST_AGAIN_S - EPSILON_S:
            self._request_item(upload, now)

    def reset(self) -> None:
        if self._upload is not None:
            self._upload = None
            self._store.abandon()

    def on_count(self, message: Any, peer: MissionPeer, now: float) -> None:
        refusal = self._vehicle.injected_faults.effect.mission_refusal
        if refusal is not None and refusal.at_item is None:
            self.acknowledge(peer, refusal.result)
            return
        if self._upload is not None:
            if self._upload.peer != peer:
                self.acknowledge(peer, DENIED)
                return
            self._store.abandon()
        if message.count > self._store.max_items:
            self._upload = None
            self.acknowledge(peer, int(mavlink.MAV_MISSION_NO_SPACE))
            text = f"Only {self._store.max_items} items are supported"
            self._vehicle.send_text(mavlink.MAV_SEVERITY_WARNING, text)
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
            self._vehicle.send_text(mavlink.MAV_SEVERITY_WARNING, "Flight plan update rejected")
            self.acknowledge(peer, ERROR)
            return
        self._store.begin_update()
        self._begin(peer, first, last, now)

    def on_item(self, message: Any, peer: MissionPeer, now: float) -> None:
        upload = self._upload
        if self._kind == MISSION and message.current in (GUIDED, ALTITUDE):
            self.acknowledge(peer, self._fly_guided(message))
        elif upload is None:
            self.acknowledge(peer, ERROR)
        elif message.seq != upload.next_seq:
            self.acknowledge(peer, int(mavlink.MAV_MISSION_INVALID_SEQUENCE))
        elif upload.peer != peer:
            self.acknowledge(peer, DENIED)
        else:
            self._accept_item(upload, item_from_message(message), now)

    def _accept_item(self, upload: _Upload, item: Item | None, now: float) -> None:
        refusal = self._vehicle.injected_faults.effect.mission_refusal
        if refusal is not None and refusal.at_item == upload.next_seq:
            result = refusal.result
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

    def on_clear(self, _message: Any, peer: MissionPeer, _now: float) -> None:
        cleared = self._upload is None and self._store.clear()
        self.acknowledge(peer, ACCEPTED if cleared else ERROR)

    def on_request_list(self, _message: Any, peer: MissionPeer, _now: float) -> None:
        if self._upload is not None:
            self.acknowledge(peer, DENIED)
        else:
            self._vehicle.send(count_message(peer, self._store.count, self._kind))

    def on_request(self, message: Any, peer: MissionPeer, _now: float) -> None:
        if self._upload is not None:
            self.acknowledge(peer, DENIED)
            return
        found = self._store.read(message.seq)
        if isinstance(found, Item):
            as_int = message.get_type() == "MISSION_REQUEST_INT"
            autocontinue = self._store.autocontinue
            self._vehicle.send(
                item_message(peer, message.seq, found, self._kind, as_int=as_int, autocontinue=autocontinue)
            )
            return
        if self._kind == MISSION:  # ArduPilot sends the count before the refusal
            self._vehicle.send(count_message(peer, self._store.count, self._kind))
        self.acknowledge(peer, found)

    def acknowledge(self, peer: MissionPeer, result: int) -> None:
        self._vehicle.send(ack_message(peer, result, self._kind))

    def _begin(self, peer: MissionPeer, first: int, last: int, now: float) -> None:
        self._upload = _Upload(peer, first, last, last_received_s=now, requested_s=now)
        self._request_item(self._upload, now)

    def _request_item(self, upload: _Upload, now: float) -> None:
        upload.requested_s = now
        self._vehicle.send(mavlink.MAVLink_mission_request_message(*upload.peer, upload.next_seq, self._kind))

    def _give_up(self, peer: MissionPeer, result: int) -> None:
        self._upload = None
        self._store.abandon()
        self.acknowledge(peer, result)

    def _fly_guided(self, message: Any) -> int:
        """Fly to an item with `current` 2, or to its altitude with `current` 3; return the result."""
        vehicle, item = self._vehicle, item_from_message(message)
        if item is None:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        stored = vehicle.personality.mission.store_item(item)
        if not isinstance(stored, Item):
            return stored
        altitude_only = message.current == ALTITUDE
        if vehicle.mode.behaviour is not Behaviour.GUIDED or not vehicle.flight.flying:
            return ACCEPTED if altitude_only else ERROR
        place_deg = stored.place_deg
        if altitude_only or place_deg is None:
            place_deg = vehicle.body.lat_lon_deg
        vehicle.flight.guided_go(*place_deg, vehicle.flight.altitude_amsl_m(stored.frame, stored.z))
        return ACCEPTED


_HANDLERS: dict[str, Callable[[_Server, Any, MissionPeer, float], None]] = {
    "MISSION_COUNT": _Server.on_count,
    "MISSION_ITEM_INT": _Server.on_item,
    "MISSION_ITEM": _Server.on_item,
    "MISSION_WRITE_PARTIAL_LIST": _Server.on_write_partial,
    "MISSION_REQUEST_LIST": _Server.on_request_list,
    "MISSION_REQUEST_INT": _Server.on_request,
    "MISSION_REQUEST": _Server.on_request,
    "MISSION_CLEAR_ALL": _Server.on_clear,
}


class ArduPilotTransfer:
    """The mission protocol of one vehicle: a server for each list.

    stores: the lists by MAV_MISSION_TYPE; file transfers use the same stores.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.stores: dict[int, Store] = {
            MISSION: MissionStore(vehicle),
            FENCE: FenceStore(vehicle),
            RALLY: RallyStore(vehicle),
        }
        self._servers = {kind: _Server(vehicle, kind, store) for kind, store in self.stores.items()}

    @property
    def ids(self) -> tuple[int, int, int]:
        """MISSION_CURRENT.mission_id, fence_id, rally_points_id: always 0 on this autopilot."""
        return 0, 0, 0

    @property
    def next_deadline_s(self) -> float:
        """Time at which `tick` has work [s]; inf: no upload."""
        return min(server.next_deadline_s for server in self._servers.values())

    def receive(self, message: Any, now: float) -> None:
        """Process one message of the mission protocol at `now` [s]."""
        peer, kind = sender_of(message), message.mission_type
        server = self._servers.get(kind)
        if server is None:
            self._vehicle.send(ack_message(peer, int(mavlink.MAV_MISSION_UNSUPPORTED), kind))
            return
        _HANDLERS[message.get_type()](server, message, peer, now)
        self.count_stored(kind)

    def count_stored(self, kind: int) -> None:
        """Set MIS_TOTAL, FENCE_TOTAL or RALLY_TOTAL to the number of stored items."""
        self._vehicle.params.set_internal(TOTALS[kind], self.stores[kind].total)

    def tick(self, now: float) -> None:
        """Repeat requests, or abandon uploads after a timeout, at `now` [s]."""
        for server in self._servers.values():
            server.tick(now)

    def reset(self) -> None:
        """Forget uploads after a reboot; stored lists stay."""
        for server in self._servers.values():
            server.reset()
