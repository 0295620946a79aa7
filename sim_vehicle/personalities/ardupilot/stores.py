"""ArduPilot's stores of missions, fences and rally points; each store decides when to write."""

import math
from abc import ABC, abstractmethod

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.fence import CIRCLES, POLYGONS
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.numbers import to_int
from sim_vehicle.vehicle.params import as_float32

ACCEPTED = int(mavlink.MAV_MISSION_ACCEPTED)
ERROR = int(mavlink.MAV_MISSION_ERROR)
INVALID_SEQUENCE = int(mavlink.MAV_MISSION_INVALID_SEQUENCE)
WARNING = int(mavlink.MAV_SEVERITY_WARNING)
MAX_LATITUDE_E7, MAX_LONGITUDE_E7 = 900_000_000, 1_800_000_000

MAX_MISSION_ITEMS = 650
LOOKAHEAD_COMMANDS = 3  # a change of one of 3 navigation commands, from the current on, restarts the current
FENCE_STORAGE_BYTES = 560  # as in ArduPilot's simulated copter
MAX_RALLY_POINTS = 46
STORED_FRAME = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}


class Store(ABC):
    """One list of items on the vehicle; results are MAV_MISSION_RESULT."""

    name: str
    max_items: int
    autocontinue: int  # value of autocontinue in downloads

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of stored items."""

    @property
    def total(self) -> int:
        """Value of the parameter that counts stored items."""
        return self.count

    @abstractmethod
    def begin(self, count: int) -> None:
        """Begin an upload of `count` items, which replaces the list."""

    def begin_update(self) -> None:  # noqa: B027
        """Begin a partial upload."""

    @abstractmethod
    def put(self, index: int, item: Item, last: int) -> int:
        """Take one item; `last` is the last index of the upload."""

    def complete(self) -> int:
        """End a complete upload."""
        return ACCEPTED

    def abandon(self) -> None:  # noqa: B027
        """End an aborted upload."""

    @abstractmethod
    def clear(self) -> bool:
        """Delete all items; return False if this is refused."""

    @abstractmethod
    def read(self, index: int) -> Item | int:
        """Return an item, or the MAV_MISSION_RESULT of a refused request."""


class MissionStore(Store):
    """Mission store: items are written one by one, and a shorter count truncates the list at once."""

    name, autocontinue, max_items = "Mission", 1, MAX_MISSION_ITEMS

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle, self._mission = vehicle, vehicle.mission

    @property
    def count(self) -> int:
        return self._mission.count

    def begin(self, count: int) -> None:
        if self._mission.cut(count) and self._mission.index >= count:
            self._restart()

    def put(self, index: int, item: Item, last: int) -> int:
        stored = self._vehicle.personality.mission.store_item(item)
        if not isinstance(stored, Item):
            return stored
        count = self._mission.count
        if stored.command == mavlink.MAV_CMD_DO_JUMP:
            target = to_int(stored.param1)
            if target <= 0 or (target >= count and target > last):
                return ERROR
        if index > count or index >= self.max_items:
            return ERROR
        if self._mission.put(index, stored) and index in self._mission.next_navigation(LOOKAHEAD_COMMANDS):
            self._restart()
        return ACCEPTED

    def complete(self) -> int:
        self._vehicle.send_text(mavlink.MAV_SEVERITY_INFO, "Flight plan received")
        return ACCEPTED

    def _restart(self) -> None:
        """Restart the current command of a flown mission, because a change affects it."""
        if self._vehicle.flies_mission:
            restarted = self._mission.restart_current()
            self._vehicle.announce("mission_changed" if restarted else "mission_change_failed")

    def clear(self) -> bool:
        if self._vehicle.flies_mission:
            return False
        self._mission.clear()
        return True

    def read(self, index: int) -> Item | int:
        return self._mission.item(index) if index == 0 or index < self.count else ERROR


class FenceStore(Store):
    """Fence store: items are collected and checked together; only a valid fence is written."""

    name, autocontinue = "Fence", 0
    max_items = FENCE_STORAGE_BYTES // 8

    def __init__(self, vehicle: Vehicle) -> None:
        self._fence, self._send_text = vehicle.fence, vehicle.send_text
        self._new: list[Item | None] = []

    @property
    def count(self) -> int:
        return len(self._fence.items)

    @property
    def total(self) -> int:
        return self._fence.total

    def begin(self, count: int) -> None:
        self._new = [None] * count

    def begin_update(self) -> None:
        self._new = list(self._fence.items)

    def put(self, index: int, item: Item, last: int) -> int:
        if index >= len(self._new):
            return INVALID_SEQUENCE
        if item.frame not in STORED_FRAME:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if item.command in POLYGONS:
            value = float(int(item.param1) & 0xFF) if math.isfinite(item.param1) else 0.0
        elif item.command in CIRCLES:
            value = _stored_radius_m(item.param1)
        elif item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            value = 0.0
        else:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        self._new[index] = Item(item.command, param1=value, x=item.x, y=item.y)
        return ACCEPTED

    def complete(self) -> int:
        items = [item for item in self._new if item is not None]
        self._new = []
        problem = _fence_problem(items)
        if problem is not None:
            self._send_text(*problem)
            self._send_text(WARNING, "Fence validation failed")
            return ERROR
        if _fence_storage_bytes(items) > FENCE_STORAGE_BYTES:
            self._send_text(WARNING, "Fence exceeds storage size")
            return ERROR
        self._fence.replace(items)
        return ACCEPTED

    def abandon(self) -> None:
        self._new = []

    def clear(self) -> bool:
        self._fence.replace([])
        return True

    def read(self, index: int) -> Item | int:
        if index < self.count:
            return self._fence.items[index]
        return ERROR if index == self.count else INVALID_SEQUENCE


def _stored_radius_m(radius_m: float) -> float:
    """Return a radius as stored [m]: cut to whole metres if the cut is below 1 mm, else a 32-bit float."""
    if math.isfinite(radius_m) and 0 <= radius_m - int(radius_m) < 0.001:
        return float(int(radius_m))
    return as_float32(radius_m)


def _fence_problem(items: list[Item]) -> tuple[int, str] | None:
    """Return the error of a fence as (severity, text); None for a valid fence."""
    n_missing = n_expected = 0  # vertices of the current polygon: missing, in total
    vertex_type: int | None = None
    has_return_point = False
    for item in items:
        n_vertices = int(item.param1) if item.command in POLYGONS else 0
        if item.command in POLYGONS and n_vertices < 3:
            return WARNING, f"Invalid vertex count ({n_vertices})"
        if n_missing and item.command != vertex_type:
            return WARNING, f"Received incorrect vertex type (want={vertex_type} got={item.command})"[:50]
        if n_missing and n_vertices != n_expected:
            return WARNING, f"Unexpected vertex count want={n_expected} got={n_vertices}"
        if item.command in POLYGONS:
            if not n_missing:
                n_missing = n_expected = n_vertices
                vertex_type = item.command
            n_missing -= 1
        elif item.command in CIRCLES and not item.param1 > 0:
            return WARNING, "Non-positive circle radius"
        elif item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            if has_return_point:
                return WARNING, "Multiple return points"
            has_return_point = True
        if abs(item.x) > MAX_LATITUDE_E7 or abs(item.y) > MAX_LONGITUDE_E7:
            return WARNING, "Bad lat or lon"
    return (int(mavlink.MAV_SEVERITY_INFO), "Incorrect item count") if n_missing else None


def _fence_storage_bytes(items: list[Item]) -> int:
    """Return the storage of a valid fence [bytes]."""
    n_bytes, index = 4, 0
    while index < len(items):
        item = items[index]
        if item.command in POLYGONS:
            n_vertices = int(item.param1)
            n_bytes += 2 + 8 * n_vertices
            index += n_vertices
        else:
            n_bytes += 13 if item.command in CIRCLES else 9  # 9: return point
            index += 1
    return n_bytes


class RallyStore(Store):
    """Rally point store: points are written one by one, like a mission."""

    name, autocontinue, max_items = "Rally", 0, MAX_RALLY_POINTS

    def __init__(self, vehicle: Vehicle) -> None:
        self._rally = vehicle.home_and_rally.rally

    @property
    def count(self) -> int:
        return len(self._rally.items)

    def begin(self, count: int) -> None:
        self._rally.replace(self._rally.items[:count])

    def put(self, index: int, item: Item, last: int) -> int:
        if item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if abs(item.x) > MAX_LATITUDE_E7:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.y) > MAX_LONGITUDE_E7:
            return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
        if not -32_768 <= item.z <= 32_767:
            return int(mavlink.MAV_MISSION_INVALID_PARAM7)
        if item.frame not in STORED_FRAME:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if index > self.count or index >= self.max_items:
            return ERROR
        point = Item(item.command, frame=STORED_FRAME[item.frame], x=item.x, y=item.y, z=float(int(item.z)))
        self._rally.replace([*self._rally.items[:index], point, *self._rally.items[index + 1 :]])
        return ACCEPTED

    def clear(self) -> bool:
        self._rally.replace([])
        return True

    def read(self, index: int) -> Item | int:
        return self._rally.items[index] if index < self.count else INVALID_SEQUENCE
