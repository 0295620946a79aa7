"""The stored mission and its execution: index, jumps, delays. A personality's `transfer` has the upload.

`Mission` executes as ArduPilot does. A *navigation* command is current until the vehicle completes the
command. The *do* and *condition* commands between two navigation commands run in order during the second
navigation command. `personalities.px4.mission` has PX4's execution.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import distance_m
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.numbers import finite, to_int

if TYPE_CHECKING:
    from sim_vehicle.vehicle.mission_pilot import MissionPilot

NAVIGATION = frozenset(
    {
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TURNS,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT,
        mavlink.MAV_CMD_NAV_DELAY,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
        mavlink.MAV_CMD_NAV_VTOL_LAND,
        mavlink.MAV_CMD_CONDITION_GATE,
    }
)
LANDINGS = frozenset({mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND})
TAKEOFFS = frozenset({mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF})
CONDITIONS = frozenset({mavlink.MAV_CMD_CONDITION_DISTANCE, mavlink.MAV_CMD_CONDITION_YAW})
MAX_JUMPS_IN_A_ROW = 64  # a mission of jumps alone must not hang the vehicle
MAX_ITEMS_PER_UPDATE = 50  # jumps back can repeat items endlessly
MAX_DO_COMMANDS = 1000  # do and condition commands between two navigation commands, with repetitions


class MissionState(IntEnum):
    """Values of MISSION_STATE (MISSION_CURRENT.mission_state)."""

    NO_MISSION = mavlink.MISSION_STATE_NO_MISSION
    NOT_STARTED = mavlink.MISSION_STATE_NOT_STARTED
    ACTIVE = mavlink.MISSION_STATE_ACTIVE
    PAUSED = mavlink.MISSION_STATE_PAUSED
    COMPLETE = mavlink.MISSION_STATE_COMPLETE


@dataclass(frozen=True, slots=True)
class Item:
    """One mission item as stored: x, y [1e-7 deg], z [m] in `frame` (MAV_FRAME)."""

    command: int
    frame: int = mavlink.MAV_FRAME_GLOBAL
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: bool = True

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude [deg]; None for an item without a position (0, 0)."""
        return (self.x * 1e-7, self.y * 1e-7) if self.x or self.y else None


class Mission:
    """The mission of one vehicle: items (item 0 is home), the current index, and progress.

    Deletion of the current item by `cut` changes neither the flight to its position nor `index`.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.index = 0  # index of the current navigation command; 0: none
        # current navigation command, kept if the item changes or is deleted
        self.current_item: Item | None = None
        self.state = MissionState.NOT_STARTED
        self.paused = False
        self.without_approach = False  # the vehicle did not fly the item before the current item
        self.climbs_first = False  # before the first navigation command the vehicle climbs in place
        self.in_landing = False  # the mission is in a landing sequence
        self._items: list[Item] = []
        self._jumps: dict[int, int] = {}  # repetitions by index of the DO_JUMP
        self._pending: list[int] = []  # indices of the do and condition commands still to run
        # start of the do or condition command that runs; None: not begun
        self._command_begun_s: float | None = None

    @property
    def _pilot(self) -> "MissionPilot":
        return self._vehicle.flight.pilot

    @property
    def items(self) -> Sequence[Item]:
        return self._items

    @property
    def count(self) -> int:
        return len(self._items)

    @property
    def empty(self) -> bool:
        """True if the mission has no item to fly."""
        return self.count < 2

    @property
    def flyable(self) -> bool:
        """True if the autopilot accepts the stored mission for flight."""
        return True

    @property
    def waiting(self) -> bool:
        """True while do or condition commands are pending."""
        return bool(self._pending)

    def item(self, index: int) -> Item:
        return self._vehicle.home_and_rally.home_item() if index == 0 else self.items[index]

    # -- changes ------------------------------------------------------------------------------------------

    def put(self, index: int, item: Item) -> bool:
        """Store or append an item at `index`; return True if the mission changed.

        Raise IndexError if the index is beyond the end.
        """
        if index == self.count:
            self._items.append(item)
            return True
        if self._items[index] == item:
            return False
        self._items[index] = item
        self._jumps.pop(index, None)
        if self._pending[:1] == [index]:
            self._command_begun_s = None  # the new condition has not begun
        if index in self._pending and item.command in NAVIGATION | {mavlink.MAV_CMD_DO_JUMP}:
            del self._pending[self._pending.index(index) :]
        return True

    def cut(self, count: int) -> bool:
        """Keep the first `count` items; return True if items were removed."""
        if count >= self.count:
            return False
        del self._items[count:]
        self._jumps = {index: done for index, done in self._jumps.items() if index < count}
        if self._pending and self._pending[0] >= count:
            self._command_begun_s = None
        self._pending = [index for index in self._pending if index < count]
        return True

    def clear(self) -> None:
        """Delete all items and reset progress."""
        self.cut(0)
        self.reset()

    # -- state --------------------------------------------------------------------------------------------

    @property
    def reported_state(self) -> MissionState:
        """State as MISSION_CURRENT.mission_state reports it."""
        if self.empty:
            return MissionState.NO_MISSION
        return MissionState.PAUSED if self.paused and self.state is MissionState.ACTIVE else self.state

    def starts_with_takeoff(self) -> bool:
        """Return True if the next navigation command is NAV_TAKEOFF."""
        found = self._find_navigation(1 if self._starts_over else self.index, {}, [])
        return found is not None and self.items[found].command == mavlink.MAV_CMD_NAV_TAKEOFF

    def land_start(self, here_deg: tuple[float, float]) -> int | None:
        """Return the index of the DO_LAND_START nearest to a position; None: no such item has a position.

        A DO_LAND_START without a position has the position of the next item with a position.
        """
        found: list[tuple[float, int]] = []
        for index in range(1, self.count):
            if self.items[index].command == mavlink.MAV_CMD_DO_LAND_START:
                places_deg = (item.place_deg for item in self.items[index:] if item.place_deg is not None)
                place_deg = next(places_deg, None)
                if place_deg is not None:
                    found.append((distance_m(here_deg, place_deg), index))
        return min(found)[1] if found else None

    def _find_navigation(self, start: int, jumps: dict[int, int], passed: list[int]) -> int | None:
        """Return the index of the next navigation command from `start`; update `jumps` and `passed`."""
        index, jumps_in_a_row = start, 0
        while 1 <= index < self.count:
            item = self.items[index]
            if item.command in NAVIGATION:
                return index
            if item.command == mavlink.MAV_CMD_DO_JUMP:
                jumps_in_a_row += 1
                if jumps_in_a_row > MAX_JUMPS_IN_A_ROW:
                    return None
                done = jumps.get(index, 0)
                if item.param2 < 0 or done < item.param2:
                    jumps[index] = done + 1
                    index = to_int(item.param1)
                    continue
            else:
                passed.append(index)
                if len(passed) > MAX_DO_COMMANDS:
                    return None
            index += 1
        return None

    # -- execution ----------------------------------------------------------------------------------------

    @property
    def _starts_over(self) -> bool:
        """True if the next start is at the first item."""
        return self.state is MissionState.COMPLETE or not 1 <= self.index < self.count

    def start_or_resume(self, *, restart: bool = False) -> None:
        """Continue with the current command; start at the first command if `restart` or `_starts_over`."""
        if restart or self._starts_over:
            self.in_landing = False
            self._jumps.clear()
            self._advance(1)
        elif self.items[self.index].command in NAVIGATION:
            self.state, self._command_begun_s = MissionState.ACTIVE, None
            self._start(self.index)  # pending commands stay pending
        else:
            self._advance(self.index)  # the changed list has no navigation command here

    def pause(self) -> bool:
        """Pause the mission; return False if no mission is active."""
        if self.state is not MissionState.ACTIVE or self.empty:
            return False
        self.paused = True
        return True

    def resume(self) -> bool:
        """Continue after a pause; return False if no command can continue."""
        self.paused = False
        if not self.restart_current() and self.current_item is not None:
            self._pilot.start_navigation(self.current_item, None)  # the item was deleted or replaced
        return self.current_item is not None

    def next_navigation(self, count: int) -> list[int]:
        """Return the indices of at most `count` navigation commands, beginning with the current command."""
        found: list[int] = []
        jumps, index = dict(self._jumps), self._find_navigation(self.index, {}, [])
        while index is not None and len(found) < count:
            found.append(index)
            index = self._find_navigation(index + 1, jumps, [])
        return found

    def stop(self) -> None:
        """Suspend the mission after a change to another mode."""
        self.paused = False
        if self.state is MissionState.ACTIVE:
            self.state = MissionState.PAUSED

    def reset(self) -> None:
        """Reset progress; the next start is at the first command."""
        self.index, self.current_item = 0, None
        self.paused = self.in_landing = False
        self._jumps.clear()
        self._pending.clear()
        if self.state is not MissionState.COMPLETE:
            self.state = MissionState.NOT_STARTED

    def end(self) -> None:
        """Mark the mission as complete after a landing; the disarming resets the progress."""
        self.state = MissionState.COMPLETE

    def reboot(self) -> None:
        """Forget all progress."""
        self.reset()
        self.state = MissionState.NOT_STARTED

    def rewind(self) -> None:
        """Reset the repetition counts of the jumps."""
        self._jumps.clear()

    def set_current(self, index: int) -> bool:
        """Make an item current (0: the first); return False if the list has no such item.

        An active mission continues with the item at once. An inactive mission begins there at its next start,
        if the list has a navigation command from there on; else return False.
        """
        index = max(index, 1)
        if index >= self.count or self.items[index].command != mavlink.MAV_CMD_DO_LAND_START:
            self.in_landing = False
        if index >= self.count:
            return False
        if self.state is MissionState.ACTIVE:
            self._advance(index)
            return True
        pending: list[int] = []
        found = self._find_navigation(index, {}, pending)
        if found is None:
            return False
        self.index, self._pending = found, pending
        self.state = MissionState.PAUSED
        return True

    def restart_current(self) -> bool:
        """Restart the current command now, or at the end of a pause; return False if it cannot restart."""
        if self.state is not MissionState.ACTIVE or not 1 <= self.index < self.count:
            return False
        if self.items[self.index].command not in NAVIGATION:
            return False
        if self.paused:
            self.current_item = self.items[self.index]
        else:
            self._start(self.index)
        return True

    def update(self, now: float) -> None:
        """Advance the mission at `now` [s]; called in the mission mode only."""
        if self.state is not MissionState.ACTIVE or self.paused:
            return
        self._run_pending(now)
        if self.current_item is not None and self._pilot.navigation_done(now):
            self._pilot.mission_item_reached(self.index, self.current_item)
            self._advance(self.index + 1)

    def _run_pending(self, now: float) -> None:
        for _ in range(MAX_ITEMS_PER_UPDATE):
            if not self._pending or self.state is not MissionState.ACTIVE:
                return
            index = self._pending[0]
            item = self.items[index]
            if self._command_begun_s is None:
                self._command_begun_s = now
                self.in_landing |= item.command == mavlink.MAV_CMD_DO_LAND_START
                self._pilot.mission_item_started(index, item)
                self._pilot.do(item)
            if not self._passed(item, now - self._command_begun_s):
                return
            self._command_begun_s = None
            self._pending.pop(0)
            self._pilot.mission_item_reached(index, item)

    def _passed(self, item: Item, waited_s: float) -> bool:
        if item.command == mavlink.MAV_CMD_CONDITION_DELAY:
            return waited_s >= finite(item.param1)
        return item.command not in CONDITIONS or self._pilot.condition_met(item)

    def _advance(self, start: int) -> None:
        self._pending, self._command_begun_s = [], None
        self.paused = False
        found = self._find_navigation(start, self._jumps, self._pending)
        if found is None:
            if self._pending:  # after the last navigation command only the first of the others runs
                self._pilot.mission_item_started(self._pending[0], self.items[self._pending[0]])
                self._pilot.do(self.items[self._pending[0]])
                self._pending.clear()
            self.state, self.in_landing = MissionState.COMPLETE, False
            self.current_item = None
            self._pilot.mission_ended()
            return
        self.state = MissionState.ACTIVE
        self._start(found)

    def _start(self, index: int) -> None:
        self.index, self.current_item, self.paused = index, self.items[index], False
        lands = self.current_item.command in LANDINGS
        self.in_landing = (self.in_landing or lands) and self.current_item.command not in TAKEOFFS
        following = self._find_navigation(index + 1, dict(self._jumps), [])
        self._pilot.mission_item_started(index, self.current_item)
        self._pilot.start_navigation(self.current_item, None if following is None else self.items[following])
