"""Missions, fences and rally points: items, upload and download by the mission protocol."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.guard import PLAN_NAMES
from sim_vehicle.conformance.peer import STATION, Peer, Where
from sim_vehicle.conformance.words import CheckFailed, Skip

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)
ALL = int(mavlink.MAV_MISSION_TYPE_ALL)
RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
M_PER_DEG = 111_319.5
POSITION_S = 120.0
BACKUP_ATTEMPTS = 3  # of downloads that ask for each item three times
TRANSFER_ENDS_S = 6.0  # PX4 forgets a broken transfer after 5 s
REQUESTS = ("MISSION_REQUEST", "MISSION_REQUEST_INT")


@dataclass(frozen=True, slots=True)
class Item:
    """A mission item as it is sent: x, y [1e-7 deg], z [m]."""

    command: int
    x: int = 0
    y: int = 0
    z: float = 0.0
    frame: int = RELATIVE
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def message(self, peer: Peer, seq: int, kind: int = MISSION, *, as_float: bool = False) -> Any:
        """MISSION_ITEM_INT, or the legacy MISSION_ITEM."""
        # Not marked as current: PX4 would begin there.
        head = (*peer.target, seq, self.frame, self.command, 0, 1, *self.params)
        if as_float:
            frame = {5: 0, 6: 3, 11: 10}.get(self.frame, self.frame)
            head = (*head[:3], frame, *head[4:])
            return mavlink.MAVLink_mission_item_message(*head, self.x / 1e7, self.y / 1e7, self.z, kind)
        return mavlink.MAVLink_mission_item_int_message(*head, self.x, self.y, self.z, kind)


@dataclass(frozen=True, slots=True)
class Upload:
    """How an upload went: the MAV_MISSION_RESULT, and (message, seq) of every request."""

    result: int
    requests: tuple[tuple[str, int], ...]
    ack: Any
    took_s: float


# -- places ----------------------------------------------------------------------------------------------


def here(peer: Peer) -> tuple[int, int]:
    """Where the vehicle is, 1e-7 deg; waits for its first position."""
    end_s = peer.now + POSITION_S
    while peer.now < end_s:
        found = peer.request("GLOBAL_POSITION_INT")
        if found.lat or found.lon:
            return found.lat, found.lon
        peer.wait(1.0)
    raise CheckFailed(f"expected a position within {POSITION_S:g} s, saw 0, 0")


def moved(place: tuple[int, int], north_m: float, east_m: float) -> tuple[int, int]:
    """A place so many metres away."""
    lat, lon = place
    per_deg = M_PER_DEG * math.cos(math.radians(lat / 1e7))
    return lat + round(north_m / M_PER_DEG * 1e7), lon + round(east_m / per_deg * 1e7)


def distance_m(a: tuple[int, int], b: tuple[int, int]) -> float:
    per_deg = M_PER_DEG * math.cos(math.radians(a[0] / 1e7))
    return math.hypot((a[0] - b[0]) / 1e7 * M_PER_DEG, (a[1] - b[1]) / 1e7 * per_deg)


def waypoint(place: tuple[int, int], north_m: float, east_m: float, z: float = 20.0, **changes: Any) -> Item:
    x, y = moved(place, north_m, east_m)
    return replace(Item(mavlink.MAV_CMD_NAV_WAYPOINT, x, y, z), **changes)


def takeoff(place: tuple[int, int], z: float = 20.0) -> Item:
    return Item(mavlink.MAV_CMD_NAV_TAKEOFF, *place, z)


def land(place: tuple[int, int], north_m: float = 0.0, east_m: float = 0.0) -> Item:
    x, y = moved(place, north_m, east_m)
    return Item(mavlink.MAV_CMD_NAV_LAND, x, y)


def plan(peer: Peer, *items: Item) -> list[Item]:
    """The items as this vehicle wants them: behind a home placeholder, or as they are."""
    if not peer.dialect.home_item:
        return list(items)
    return [Item(mavlink.MAV_CMD_NAV_WAYPOINT, *here(peer), frame=mavlink.MAV_FRAME_GLOBAL), *items]


def sample_plan(peer: Peer, count: int = 5, z: float = 20.0) -> list[Item]:
    """A take-off and waypoints, `count` items beside a home placeholder."""
    place = here(peer)
    points = [waypoint(place, 30.0 * i, 20.0 * (i % 3), z + i) for i in range(1, count)]
    return plan(peer, takeoff(place, z), *points)


# -- messages --------------------------------------------------------------------------------------------


def _numbered(seq: int, wanted: Where) -> Where:
    return lambda m: m.seq == seq and wanted(m)


def count_message(peer: Peer, count: int, kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_count_message(*peer.target, count, kind)


def request_list(peer: Peer, kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_request_list_message(*peer.target, kind)


def clear_message(peer: Peer, kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_clear_all_message(*peer.target, kind)


def for_us(kind: int, source: tuple[int, int] = STATION) -> Where:
    """Whether a mission message is of this type and for this station."""
    return lambda m: m.mission_type == kind and m.target_system in (0, source[0])


def next_request(
    peer: Peer, kind: int, *, mark: int, within_s: float = 3.0, source: tuple[int, int] = STATION
) -> tuple[str, int]:
    """The next MISSION_REQUEST(_INT): which message, which seq; CheckFailed where none comes."""
    place = peer.seek(REQUESTS, for_us(kind, source), within_s=within_s, mark=mark)
    if place is None:
        raise CheckFailed(f"expected a mission request within {within_s:g} s, saw none")
    return peer.heard[place].kind, peer.heard[place].message.seq


# -- transfers -------------------------------------------------------------------------------------------


def upload(
    peer: Peer,
    items: Sequence[Item],
    kind: int = MISSION,
    *,
    as_float: bool = False,
    source: tuple[int, int] = STATION,
) -> Upload:
    """Announce and send; the acknowledgement, whatever it says."""
    began_s, requests = peer.now, list[tuple[str, int]]()
    mark = peer.mark()
    peer.send(count_message(peer, len(items), kind), source)
    wanted, silences, restarted = for_us(kind, source), 0, False
    while True:
        place = peer.seek((*REQUESTS, "MISSION_ACK"), wanted, within_s=3.0, mark=mark)
        if place is None:
            silences += 1
            if silences > 3:
                raise CheckFailed(f"upload: no answer after {len(requests)} requests")
            if not requests and not restarted:  # the announcement was lost
                restarted = True
                peer.send(count_message(peer, len(items), kind), source)
            continue
        mark, entry = place + 1, peer.heard[place]
        if entry.kind == "MISSION_ACK":
            if entry.message.type == mavlink.MAV_MISSION_INVALID_SEQUENCE and requests:
                continue  # for a duplicate; the upload goes on
            return Upload(entry.message.type, tuple(requests), entry.message, peer.now - began_s)
        seq = entry.message.seq
        requests.append((entry.kind, seq))
        if seq >= len(items):
            raise CheckFailed(f"upload: asked for item {seq} of {len(items)}")
        peer.send(items[seq].message(peer, seq, kind, as_float=as_float), source)


def put(peer: Peer, items: Sequence[Item], kind: int = MISSION) -> Upload:
    """An upload that has to be accepted."""
    done = upload(peer, items, kind)
    if done.result != mavlink.MAV_MISSION_ACCEPTED:
        raise CheckFailed(f"upload of {len(items)} items: expected ACCEPTED, saw {done.result}")
    return done


def finish(peer: Peer, kind: int = MISSION, source: tuple[int, int] = STATION) -> None:
    """Acknowledge: we have what we wanted. PX4 takes no upload before that, or a time-out."""
    accepted = mavlink.MAV_MISSION_ACCEPTED
    peer.send(mavlink.MAVLink_mission_ack_message(*peer.target, accepted, kind), source)


def open_list(peer: Peer, kind: int = MISSION, source: tuple[int, int] = STATION) -> int:
    """Ask for the list: how many items there are to be asked for. `finish` ends it."""
    answer = peer.ask(request_list(peer, kind), "MISSION_COUNT", for_us(kind, source), source=source)
    return int(answer.count)


def count(peer: Peer, kind: int = MISSION) -> int:
    """How many items the vehicle holds."""
    found = open_list(peer, kind)
    finish(peer, kind)
    return found


def download(
    peer: Peer, kind: int = MISSION, *, as_float: bool = False, source: tuple[int, int] = STATION
) -> list[Any]:
    """Every item the vehicle holds, as messages; ends with an acknowledgement."""
    maker = (
        mavlink.MAVLink_mission_request_message if as_float else mavlink.MAVLink_mission_request_int_message
    )
    answer = "MISSION_ITEM" if as_float else "MISSION_ITEM_INT"
    wanted = for_us(kind, source)
    items = [
        peer.ask(
            maker(*peer.target, seq, kind),
            answer,
            _numbered(seq, wanted),
            source=source,
        )
        for seq in range(open_list(peer, kind, source))
    ]
    finish(peer, kind, source)
    return items


def clear(peer: Peer, kind: int = MISSION) -> int:
    """MISSION_CLEAR_ALL; the MAV_MISSION_RESULT."""
    return int(peer.ask(clear_message(peer, kind), "MISSION_ACK", for_us(kind)).type)


def body(peer: Peer, items: Sequence[Any]) -> list[tuple[int, int, int]]:
    """(command, x, y) of items, sent or read back, without a home placeholder."""
    first = 1 if peer.dialect.home_item and items else 0
    return [(i.command, i.x, i.y) for i in items[first:]]


def cancel(peer: Peer) -> None:
    """End a transfer under way and let the vehicle forget it."""
    cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
    peer.send(mavlink.MAVLink_mission_ack_message(*peer.target, cancelled, MISSION))
    # ArduPilot does not listen; it gives up by itself.
    peer.wait(10.0 if peer.dialect.name == "ardupilot" else 1.0 if peer.dialect.known else 10.0)


def begin(peer: Peer, items: list[Item], sent: int) -> int:
    """Announce and answer `sent` requests; the mark behind the last of them."""
    mark = peer.mark()
    peer.send(count_message(peer, len(items)))
    for _ in range(sent):
        _, seq = next_request(peer, MISSION, mark=mark)
        mark = peer.mark()
        peer.send(items[seq].message(peer, seq))
    next_request(peer, MISSION, mark=mark)
    return peer.mark()


def store(peer: Peer, item: Item) -> Any:
    """What the vehicle keeps of one item: it is uploaded behind a take-off and read back."""
    put(peer, plan(peer, takeoff(here(peer)), item))
    return download(peer)[-1]


def need(peer: Peer, kind: int) -> None:
    """Skip where the vehicle does not claim to keep plans of this type."""
    capability = {FENCE: "MISSION_FENCE", RALLY: "MISSION_RALLY"}.get(kind)
    if capability is not None and not peer.facts.claims(capability):
        raise Skip(f"does not claim {capability}")


class Backup:
    """The plans a vehicle held before its checks, to give them back.

    A plan of which there is no copy is never overwritten: `Peer` sends nothing that writes it. `lost` has the
    types of those that the vehicle claims to keep and that could not be read, and why.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._kept: dict[int, list[Item]] = {}
        self.lost: dict[int, str] = {}

    def take(self) -> None:
        for kind in PLAN_NAMES:
            try:
                need(self._peer, kind)
            except Skip:
                continue
            self._save(kind)
        if not self.lost:
            self._peer.saved.add(ALL)

    def _save(self, kind: int) -> None:
        for attempt in range(BACKUP_ATTEMPTS):
            try:
                self._kept[kind] = [_item(message) for message in download(self._peer, kind)]
            except (CheckFailed, Skip) as error:
                self.lost[kind] = str(error)
                if attempt < BACKUP_ATTEMPTS - 1:
                    self._peer.wait(TRANSFER_ENDS_S)
            else:
                self.lost.pop(kind, None)
                self._peer.saved.add(kind)
                return

    def give_back(self) -> list[str]:
        """Restore; what could not be restored, in words."""
        trouble = []
        for kind, items in self._kept.items():
            try:
                put(self._peer, items, kind)
            except (CheckFailed, Skip) as error:
                trouble.append(f"the {PLAN_NAMES[kind]} of before could not be put back: {error}")
        return trouble

    def names(self) -> list[str]:
        """The plans it would give back."""
        return [PLAN_NAMES[kind] for kind in self._kept]


def _item(message: Any) -> Item:
    params = (message.param1, message.param2, message.param3, message.param4)
    return Item(message.command, message.x, message.y, message.z, message.frame, params)
