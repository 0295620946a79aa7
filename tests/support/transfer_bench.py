"""A transfer machine alone: messages in, bytes out, time as a number."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.ardupilot.items import store_item as store_ardupilot
from sim_vehicle.personalities.px4.items import store_item as store_px4
from sim_vehicle.vehicle.fence import Fence
from sim_vehicle.vehicle.home_and_rally import Rally
from sim_vehicle.vehicle.mission import Item, Mission
from sim_vehicle.vehicle.mission_px4 import Px4Mission
from sim_vehicle.vehicle.transfer.ardupilot import ArduPilotTransfer
from sim_vehicle.vehicle.transfer.px4 import Px4Transfer
from sim_vehicle.vehicle.transfer.stores import FenceStore, MissionStore, RallyStore

GCS = (255, 190)
MISSION, FENCE, RALLY = 0, 1, 2
TICK_S = 0.05
WP, POLYGON, EXCLUDED, CIRCLE, NOT_CIRCLE, RETURN_POINT, RALLY_POINT = 16, 5001, 5002, 5003, 5004, 5000, 5100


def fields(seq: int, command: int = WP, **changes: Any) -> dict[str, Any]:
    """Return the fields of MISSION_ITEM_INT."""
    values: dict[str, Any] = {
        "seq": seq, "frame": 3, "command": command, "current": 0, "autocontinue": 1,
        "param1": 0.0, "param2": 0.0,
        "param3": 0.0, "param4": 0.0, "x": 460_000_000 + seq, "y": 145_000_000 + seq, "z": 20.0,
    }  # fmt: skip
    return values | changes


def waypoints(count: int, **changes: Any) -> list[dict[str, Any]]:
    return [fields(seq, **changes) for seq in range(count)]


def square(command: int = POLYGON, vertices: int = 4, frame: int = 0) -> list[dict[str, Any]]:
    """Return a square fence as four items that announce `vertices`."""
    corners = ((0, 0), (10_000, 0), (10_000, 10_000), (0, 10_000))
    return [
        fields(seq, command, frame=frame, param1=vertices, x=460_000_000 + dx, y=145_000_000 + dy, z=0.0)
        for seq, (dx, dy) in enumerate(corners)
    ]


class Bench:
    """A transfer machine, and the bytes between the machine and its ground stations."""

    def __init__(self, make: Callable[["Bench"], Any]) -> None:
        self.now = 100.0
        self.mission: Mission
        self.fence, self.rally = Fence(), Rally()
        self.pilot: Any = SimpleNamespace(armed=False)
        self.texts: list[str] = []
        self.calls: list[tuple[Any, ...]] = []
        self.refusal: Any = None
        self._codecs: dict[tuple[int, int], mavlink.MAVLink] = {}
        self._vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._decoder = mavlink.MAVLink(None)
        self._out: list[Any] = []
        self.machine = make(self)

    def take(self, message: Any) -> None:
        self._out += self._decoder.parse_buffer(message.pack(self._vehicle)) or []

    def go(self, item: Item, altitude_only: bool) -> bool:
        self.calls.append(("guided", item.z, altitude_only))
        return self.pilot.armed

    def send_text(self, _severity: int, text: str) -> None:
        self.texts.append(text)

    def send(self, message: Any, peer: tuple[int, int] = GCS) -> list[Any]:
        """Deliver one message of a ground station; return the immediate answers."""
        codec = self._codecs.setdefault(peer, mavlink.MAVLink(None, srcSystem=peer[0], srcComponent=peer[1]))
        (received,) = self._decoder.parse_buffer(message.pack(codec)) or []
        self._out = []
        if self.machine.handles(received.get_type()):
            self.machine.receive(received, self.now)
        return self._out

    def wait(self, seconds: float) -> list[Any]:
        self._out = []
        for _ in range(round(seconds / TICK_S)):
            self.now += TICK_S
            self.machine.tick(self.now)
        return self._out

    # -- conversations -----------------------------------------------------------------------------------

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
            if results(replies):
                break
            assert requests(replies) == [seq]
            replies = self.item(values, kind)
        return results(replies)[-1]

    def ask_list(self, kind: int = MISSION) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))

    def read(self, seq: int, kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind), peer)

    def ack(self, result: int = 0, kind: int = MISSION, peer: tuple[int, int] = GCS) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_ack_message(1, 1, result, kind), peer)

    def download(self, kind: int = MISSION) -> list[Any]:
        replies = self.ask_list(kind)
        (count,) = [m.count for m in replies if m.get_type() == "MISSION_COUNT"]
        items = []
        for seq in range(count):
            items += [m for m in self.read(seq, kind) if m.get_type() == "MISSION_ITEM_INT"]
        self.ack(0, kind)
        return items

    def clear(self, kind: int = MISSION) -> list[int]:
        return results(self.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind)))


def results(messages: Sequence[Any]) -> list[int]:
    return [m.type for m in messages if m.get_type() == "MISSION_ACK"]


def requests(messages: Sequence[Any]) -> list[int]:
    return [m.seq for m in messages if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT")]


def kinds(messages: Sequence[Any]) -> list[str]:
    return [m.get_type() for m in messages]


def ardupilot() -> Bench:
    def make(bench: Bench) -> ArduPilotTransfer:
        bench.mission = Mission(home=lambda: Item(WP, x=1, y=2, z=300.0))
        mission = MissionStore(
            bench.mission,
            store_ardupilot,
            650,
            send_text=bench.send_text,
            changed=lambda index: bench.calls.append(("changed", index)),
            flying=lambda: False,
        )
        return ArduPilotTransfer(
            {
                MISSION: mission,
                FENCE: FenceStore(bench.fence, send_text=bench.send_text),
                RALLY: RallyStore(bench.rally),
            },
            store_item=store_ardupilot,
            send=bench.take,
            send_text=bench.send_text,
            stored=lambda kind, total: bench.calls.append(("stored", kind, total)),
            guided=bench.go,
            refusal=lambda: bench.refusal,
        )

    return Bench(make)


def px4_mission(feasible: Callable[[Sequence[Item]], bool] = lambda _items: True) -> Px4Mission:
    """Return the mission of a PX4 multicopter; `feasible` accepts a list of items or not."""
    return Px4Mission(feasible, lambda: None, plane=False)


def px4() -> Bench:
    def make(bench: Bench) -> Px4Transfer:
        mission = px4_mission()
        bench.mission = mission
        return Px4Transfer(
            mission,
            bench.fence,
            bench.rally,
            sysid=1,
            store_item=store_px4,
            max_items=65_534,
            send=bench.take,
            send_text=bench.send_text,
            replace=lambda items, current: mission.replace(bench.pilot, items, current),
            set_current=lambda index: bench.calls.append(("current", index)),
            changed=lambda kind: bench.calls.append(("changed", kind)),
            refusal=lambda: bench.refusal,
        )

    return Bench(make)
