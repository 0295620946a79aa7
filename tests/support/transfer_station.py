"""Stations that send each message of the mission protocol by themselves."""

from collections.abc import Sequence
from typing import Any

from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, Station, acks

GCS = (255, 190)
X, Y = round(LAT_DEG * 1e7), round(LON_DEG * 1e7)
MISSION, FENCE, RALLY = 0, 1, 2
WP, POLYGON, EXCLUDED, CIRCLE, NOT_CIRCLE, RETURN_POINT, RALLY_POINT = 16, 5001, 5002, 5003, 5004, 5000, 5100


def fields(seq: int, command: int = WP, **changes: Any) -> dict[str, Any]:
    """Return the fields of MISSION_ITEM_INT."""
    values: dict[str, Any] = {
        "seq": seq, "frame": 3, "command": command, "current": 0, "autocontinue": 1,
        "param1": 0.0, "param2": 0.0,
        "param3": 0.0, "param4": 0.0, "x": X + seq, "y": Y + seq, "z": 20.0,
    }  # fmt: skip
    return values | changes


def waypoints(count: int, **changes: Any) -> list[dict[str, Any]]:
    return [fields(seq, **changes) for seq in range(count)]


def square(command: int = POLYGON, vertices: int = 4, frame: int = 0) -> list[dict[str, Any]]:
    """Return a square fence as four items that announce `vertices`."""
    corners = ((0, 0), (10_000, 0), (10_000, 10_000), (0, 10_000))
    return [
        fields(seq, command, frame=frame, param1=vertices, x=X + dx, y=Y + dy, z=0.0)
        for seq, (dx, dy) in enumerate(corners)
    ]


class TransferStation(Station):
    """A station of one vehicle; each request returns the immediate answers about a plan."""

    def __init__(self) -> None:
        super().__init__()
        self.received.clear()  # the texts of the boot

    def send(self, message: Any, peer: tuple[int, int] = GCS) -> list[Any]:
        """Send one message as one of several ground stations."""
        self.codec = mavlink.MAVLink(None, *peer)
        return [m for m in super().send(message) if m.get_type() != "STATUSTEXT"]

    def count(self, count: int, kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_count_message(1, 1, count, kind), peer)

    def item(self, values: dict[str, Any], kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        head = [values[n] for n in ("seq", "frame", "command", "current", "autocontinue")]
        rest = [values[n] for n in ("param1", "param2", "param3", "param4", "x", "y", "z")]
        return self.send(mavlink.MAVLink_mission_item_int_message(1, 1, *head, *rest, kind), peer)

    def upload(self, items: Sequence[dict[str, Any]], kind: int = MISSION) -> int:
        """Send all items as requested; return the last acknowledgement."""
        replies = self.count(len(items), kind)
        for seq, values in enumerate(items):
            if acks(replies):
                break
            assert requests(replies) == [seq]
            replies = self.item(values, kind)
        return acks(replies)[-1]

    def ask_list(self, kind: int = MISSION) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))

    def read(self, seq: int, kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind), peer)

    def ack(self, result: int = 0, kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_ack_message(1, 1, result, kind), peer)

    def clear(self, kind: int = MISSION) -> list[int]:
        return acks(self.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind)))


class Px4TransferStation(TransferStation, QuietPx4Station):
    """The same of a PX4 multicopter."""


def requests(messages: Sequence[Any]) -> list[int]:
    return [m.seq for m in messages if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT")]


def kinds(messages: Sequence[Any]) -> list[str]:
    return [m.get_type() for m in messages]
