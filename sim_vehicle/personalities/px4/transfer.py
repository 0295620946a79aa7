"""The mission protocol of PX4: one state machine and one partner for missions, fences and rally points.

A complete new list replaces the stored list; a failed upload changes nothing. The vehicle requests items with
MISSION_REQUEST, or with MISSION_REQUEST_INT if the last item or request of a ground station was an _INT
message. An item, a request or an acknowledgement of another peer than the last partner causes a STATUSTEXT.
"""

import dataclasses
import math
import struct
import zlib
from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.personalities.px4.mission import Px4Mission
from sim_vehicle.vehicle.command import sender_of
from sim_vehicle.vehicle.fence import CIRCLES, POLYGONS
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.mission_messages import (
    ALL,
    FENCE,
    MISSION,
    RALLY,
    MissionPeer,
    ack_message,
    count_message,
    item_from_message,
    item_message,
)

REQUEST_AGAIN_S = 0.25
TIMEOUT_S = 5.0
MISSION_CHECK_S = 0.1  # interval of the health checks, which see a new mission
MAX_ITEMS = {MISSION: 6000, FENCE: 128, RALLY: 32}
ACCEPTED = int(mavlink.MAV_MISSION_ACCEPTED)
ERROR = int(mavlink.MAV_MISSION_ERROR)
CRITICAL = int(mavlink.MAV_SEVERITY_CRITICAL)
COMPONENTS = frozenset(
    {mavlink.MAV_COMP_ID_ALL, mavlink.MAV_COMP_ID_AUTOPILOT1, mavlink.MAV_COMP_ID_MISSIONPLANNER}
)
_NOT_IN_A_MISSION = POLYGONS | CIRCLES | {mavlink.MAV_CMD_NAV_RALLY_POINT}
_ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_INT_FRAMES = (mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_CHECKSUM_LAYOUT = struct.Struct("<BHB7f")
_CHECKSUM_LAYOUT_INT = struct.Struct("<BHB4f2if")


class _State(Enum):
    IDLE = auto()
    SENDING = auto()  # download in progress
    GETTING = auto()  # upload in progress


class Px4Transfer:
    """The mission protocol of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        assert isinstance(vehicle.mission, Px4Mission)
        self._vehicle, self._mission = vehicle, vehicle.mission
        self._ids = {MISSION: 0, FENCE: 0, RALLY: 0}
        self._handlers: dict[str, Callable[[Any, MissionPeer, float], None]] = {
            "MISSION_COUNT": self._on_count,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_ITEM": self._on_item,
            "MISSION_REQUEST_LIST": self._on_request_list,
            "MISSION_REQUEST_INT": self._on_request,
            "MISSION_REQUEST": self._on_request,
            "MISSION_CLEAR_ALL": self._on_clear,
            "MISSION_ACK": self._on_ack,
            "MISSION_SET_CURRENT": self._on_set_current,
        }
        self.reset()

    def reset(self) -> None:
        """Forget a transfer after a reboot; stored lists stay."""
        self._state = _State.IDLE
        self._as_int = False
        self._partner: MissionPeer = (0, 0)
        self._kind = MISSION
        self._seq = self._announced = 0
        self._new: list[Item] = []
        self._new_id = 0
        self._new_current = -1
        self._last_received_s = self._requested_s = 0.0

    @property
    def ids(self) -> tuple[int, int, int]:
        """MISSION_CURRENT.mission_id, fence_id, rally_points_id: checksum of each list, 0 if empty."""
        return self._ids[MISSION], self._ids[FENCE], self._ids[RALLY]

    @property
    def next_deadline_s(self) -> float:
        """Time at which `tick` has work [s]; inf: no transfer."""
        if self._state is _State.IDLE:
            return math.inf
        repeat_s = self._requested_s + REQUEST_AGAIN_S if self._state is _State.GETTING else math.inf
        return min(repeat_s, self._last_received_s + TIMEOUT_S)

    def receive(self, message: Any, now: float) -> None:
        """Process one message of the mission protocol at `now` [s]; partial writes are ignored."""
        handler = self._handlers.get(message.get_type())
        if (
            handler is not None
            and message.target_system == self._vehicle.sysid
            and message.target_component in COMPONENTS
        ):
            handler(message, sender_of(message), now)

    def tick(self, now: float) -> None:
        """Repeat requests, or end the transfer after a timeout, at `now` [s]."""
        if self._state is _State.IDLE:
            return
        if now - self._last_received_s >= TIMEOUT_S - EPSILON_S:
            self._vehicle.send_text(CRITICAL, "Operation timeout")
            self._state = _State.IDLE
        elif self._state is _State.GETTING and now - self._requested_s >= REQUEST_AGAIN_S - EPSILON_S:
            self._request_item(now)

    # -- upload ------------------------------------------------------------------------------------------

    def _on_count(self, message: Any, peer: MissionPeer, now: float) -> None:
        if self._state is _State.SENDING:
            self._vehicle.send_text(CRITICAL, "WPM: IGN MISSION_COUNT: Busy")
            self._acknowledge(peer, ERROR)
            return
        if self._state is _State.GETTING:
            self._last_received_s = now
            if peer != self._partner:
                self._acknowledge(peer, ERROR)
            elif self._seq > 0:
                self._vehicle.send_text(CRITICAL, "WPM: REJ. CMD: Busy")
                self._acknowledge(peer, ERROR)
            else:
                self._request_item(now)  # the first request was probably lost; the first count stays valid
            return
        self._partner, self._kind = peer, message.mission_type
        refusal = self._vehicle.injected_faults.effect.mission_refusal
        if refusal is not None and refusal.at_item is None:
            self._acknowledge(peer, refusal.result)
        elif message.count > MAX_ITEMS.get(self._kind, 0):
            self._acknowledge(peer, int(mavlink.MAV_MISSION_NO_SPACE))
        elif message.count == 0:
            self._empty(self._kind)
            self._acknowledge(peer, ACCEPTED)
        else:
            self._state, self._last_received_s = _State.GETTING, now
            self._seq, self._announced = 0, message.count
            self._new, self._new_id, self._new_current = [], 0, -1
            self._request_item(now)

    def _request_item(self, now: float) -> None:
        self._requested_s = now
        request = (
            mavlink.MAVLink_mission_request_int_message
            if self._as_int
            else mavlink.MAVLink_mission_request_message
        )
        self._vehicle.send(request(*self._partner, self._seq, self._kind))

    def _on_item(self, message: Any, peer: MissionPeer, now: float) -> None:
        self._as_int = message.get_type() == "MISSION_ITEM_INT"
        if peer != self._partner:
            self._vehicle.send_text(CRITICAL, "REJ. MIS ITEM: partner id mismatch")
        elif message.mission_type != self._kind:
            self._acknowledge(peer, ERROR)
        elif self._state is _State.SENDING:
            self._vehicle.send_text(CRITICAL, "IGN MISSION_ITEM: Busy")
            self._acknowledge(peer, ERROR)
        elif self._state is _State.IDLE:
            if self._seq == message.seq + 1:  # a repeated last item: the acknowledgement was probably lost
                self._acknowledge(peer, ACCEPTED, self._new_id)
            else:
                self._vehicle.send_text(CRITICAL, "IGN MISSION_ITEM: No transfer")
                self._acknowledge(peer, ERROR)
        else:
            self._last_received_s = now
            if message.seq == self._seq:
                self._accept_item(message, now)

    def _accept_item(self, message: Any, now: float) -> None:
        stored = self._stored_form(message)
        if not isinstance(stored, Item):
            if stored != ERROR:
                self._vehicle.send_text(CRITICAL, "IGN MISSION_ITEM: Invalid item")
            self._state = _State.IDLE
            self._acknowledge(self._partner, stored)
            return
        self._new.append(stored)
        self._new_id = _checksum(message, self._new_id)
        if message.current:
            self._new_current = message.seq
        self._seq += 1
        if self._seq < self._announced:
            self._request_item(now)
            return
        self._state = _State.IDLE
        if self._new_id != self._ids[self._kind]:
            self._ids[self._kind] = self._new_id
            self._store(self._kind, self._new, self._new_current)
        self._acknowledge(self._partner, ACCEPTED, self._new_id)

    def _stored_form(self, message: Any) -> Item | int:
        """Return the stored form of an item, or the MAV_MISSION_RESULT that ends the upload."""
        refusal = self._vehicle.injected_faults.effect.mission_refusal
        if refusal is not None and refusal.at_item == message.seq:
            return refusal.result
        item = item_from_message(message)
        if item is None:
            return ERROR
        if not self._as_int and item.frame in _INT_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        stored = self._vehicle.personality.mission.store_item(item)
        if not isinstance(stored, Item):
            return stored
        if self._kind == MISSION and stored.command in _NOT_IN_A_MISSION:
            return ERROR
        if self._kind == FENCE and stored.command in POLYGONS and stored.param1 < 3:
            return ERROR
        return stored

    def _store(self, kind: int, items: list[Item], current: int) -> None:
        """Replace a list; `current` is the index of the mission item marked as current, -1: no item."""
        vehicle = self._vehicle
        if kind == MISSION:
            if not vehicle.modes.mission_ready(vehicle.now):  # an earlier good mission counts until the check
                vehicle.modes.mission_checked_s = vehicle.now + MISSION_CHECK_S
            self._mission.replace(items, current)
        elif kind == FENCE:
            vehicle.fence.replace(items)
            self._check_fence()
        else:
            vehicle.home_and_rally.rally.replace(items)

    def _check_fence(self) -> None:
        """Check the mission again; drop the zones of a new fence that home or the flying vehicle violates."""
        vehicle, home = self._vehicle, self._vehicle.home_and_rally.home
        if home is not None and vehicle.fence.discard_violated(*home.lat_lon_deg):
            vehicle.announce("fence_without_home")
        watched = vehicle.flight.flying and vehicle.flight_parameters.fence.enabled
        if watched and vehicle.fence.discard_violated(*vehicle.body.lat_lon_deg):
            vehicle.announce("fence_without_vehicle")
        if not self._mission.empty:
            self._mission.check_again()

    def _empty(self, kind: int) -> None:
        if kind in self._ids:
            self._ids[kind] = 0
            self._store(kind, [], 0)

    def _on_clear(self, message: Any, peer: MissionPeer, _now: float) -> None:
        if self._state is not _State.IDLE:
            self._vehicle.send_text(CRITICAL, "WPM: IGN CLEAR CMD: Busy")
            return
        self._kind = message.mission_type
        for kind in (MISSION, FENCE, RALLY) if self._kind == ALL else (self._kind,):
            self._empty(kind)
        self._acknowledge(peer, ACCEPTED)

    # -- download ----------------------------------------------------------------------------------------

    def _items(self) -> Sequence[Item]:
        vehicle = self._vehicle
        rally = vehicle.home_and_rally.rally
        lists = {MISSION: self._mission.items, FENCE: vehicle.fence.items, RALLY: rally.items}
        return lists.get(self._kind, ())

    def _on_request_list(self, message: Any, peer: MissionPeer, now: float) -> None:
        all_sent = self._state is _State.SENDING and self._seq == len(self._items())
        again = peer == self._partner and message.mission_type == self._kind
        if not (self._state is _State.IDLE or all_sent or (self._state is _State.SENDING and again)):
            self._vehicle.send_text(
                mavlink.MAV_SEVERITY_INFO, "Mission download request ignored, already active"
            )
            return
        self._state, self._last_received_s = _State.SENDING, now
        self._kind, self._partner = message.mission_type, peer
        self._seq, self._announced = 0, len(self._items())
        self._vehicle.send(count_message(peer, self._announced, self._kind, self._ids.get(self._kind, 0)))

    def _on_request(self, message: Any, peer: MissionPeer, now: float) -> None:
        self._as_int = message.get_type() == "MISSION_REQUEST_INT"
        if peer != self._partner:
            self._vehicle.send_text(CRITICAL, "WPM: REJ. CMD: partner id mismatch")
        elif self._state is _State.GETTING:
            self._vehicle.send_text(CRITICAL, "WPM: REJ. CMD: Busy")
        elif self._state is _State.SENDING and message.mission_type == self._kind:
            self._last_received_s = now
            self._answer(message.seq)

    def _answer(self, seq: int) -> None:
        items = self._items()
        if seq == self._seq < self._announced:
            self._seq += 1
        expected = seq == self._seq - 1  # includes a repeated request
        if not expected or seq >= len(items):
            self._state = _State.IDLE
            self._acknowledge(self._partner, ERROR)
            self._vehicle.send_text(CRITICAL, "WPM: REJ. CMD: Req. WP was unexpected")
            return
        item = items[seq]
        autocontinue = int(item.autocontinue) if self._kind != FENCE else 0
        self._vehicle.send(
            item_message(
                self._partner,
                seq,
                _framed(item, absolute=self._kind == FENCE, as_int=self._as_int),
                self._kind,
                as_int=self._as_int,
                current=seq == self._mission.index,
                autocontinue=autocontinue,
            )
        )

    def _on_ack(self, message: Any, peer: MissionPeer, now: float) -> None:
        if peer != self._partner:
            self._vehicle.send_text(CRITICAL, "REJ. WP CMD: partner id mismatch")
        elif self._state is _State.SENDING and message.mission_type == self._kind:
            self._state = _State.IDLE
        elif self._state is _State.GETTING:
            if message.type == mavlink.MAV_MISSION_UNSUPPORTED:  # of MISSION_REQUEST or MISSION_REQUEST_INT
                self._as_int = not self._as_int
                self._request_item(now)
            elif message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
                self._state = _State.IDLE

    def _on_set_current(self, message: Any, _peer: MissionPeer, _now: float) -> None:
        if self._state is not _State.IDLE:
            self._vehicle.send_text(CRITICAL, "WPM: IGN WP CURR CMD: Busy")
        elif message.seq >= self._mission.count:
            self._vehicle.send_text(CRITICAL, "WPM: WP CURR CMD: Not in list")
        else:
            self._mission.set_current(message.seq)

    def _acknowledge(self, peer: MissionPeer, result: int, opaque_id: int = 0) -> None:
        self._vehicle.send(ack_message(peer, result, self._kind, opaque_id))


def _framed(item: Item, *, absolute: bool, as_int: bool) -> Item:
    """Return the item with the frame of a download: `as_int` selects _INT, `absolute` the global frame."""
    if item.frame in _ABSOLUTE or (absolute and item.frame in _RELATIVE):
        frame = _ABSOLUTE[as_int]
    elif item.frame in _RELATIVE:
        frame = _RELATIVE[as_int]
    else:
        return item
    return dataclasses.replace(item, frame=frame)


def _checksum(message: Any, before: int) -> int:
    """Return a list's CRC-32, without inversion, after the next item; `before`: CRC-32 so far, 0 at first."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    layout = _CHECKSUM_LAYOUT_INT if message.get_type() == "MISSION_ITEM_INT" else _CHECKSUM_LAYOUT
    head = (message.frame, message.command, message.autocontinue)
    data = layout.pack(*head, *parameters, message.x, message.y, message.z)
    return zlib.crc32(data, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
