"""The stored mission and how it is flown: index, jumps, delays; without the protocol that writes it.

Vocabulary: a *navigation* command takes the vehicle somewhere and is current until it is done; *do* and
*condition* commands between two navigation commands run when the first one is done, one after another,
while the second is being flown.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

NAVIGATION = frozenset(
    {
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    }
)
MAX_JUMPS_IN_A_ROW = 64  # a mission of jumps alone must not hang the vehicle


class MissionState(IntEnum):
    """Values of MISSION_STATE (MISSION_CURRENT.mission_state)."""

    NO_MISSION = mavlink.MISSION_STATE_NO_MISSION
    NOT_STARTED = mavlink.MISSION_STATE_NOT_STARTED
    ACTIVE = mavlink.MISSION_STATE_ACTIVE
    PAUSED = mavlink.MISSION_STATE_PAUSED
    COMPLETE = mavlink.MISSION_STATE_COMPLETE


@dataclass(frozen=True, slots=True)
class Item:
    """One mission item as the vehicle keeps it: x, y [1e-7 deg], z [m] in `frame` (MAV_FRAME)."""

    command: int
    frame: int = mavlink.MAV_FRAME_GLOBAL
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude [deg]; None where the item names none (0, 0)."""
        return (self.x * 1e-7, self.y * 1e-7) if self.x or self.y else None


class Pilot(Protocol):
    """What the executor needs of the vehicle."""

    def start_navigation(self, item: Item, following: Item | None) -> None: ...

    def navigation_done(self, now: float) -> bool: ...

    def do(self, item: Item) -> None: ...

    def mission_item_reached(self, index: int, item: Item) -> None: ...

    def mission_ended(self) -> None: ...


@dataclass
class Mission:
    """Items (0 is home and not kept here as an item), the current index, and progress.

    `home` gives item 0 whenever it is read.
    """

    home: Callable[[], Item]
    items: list[Item] = field(default_factory=list)
    index: int = 0  # of the current navigation command, 0 when there is none
    flown: Item | None = None  # that command as it was read when it was started; outlives its deletion
    state: MissionState = MissionState.NOT_STARTED
    paused: bool = False
    _jumps: dict[int, int] = field(default_factory=dict)
    _pending: list[Item] = field(default_factory=list)  # do-commands still to run
    _delay_until_s: float = 0.0

    @property
    def count(self) -> int:
        return len(self.items)

    def item(self, index: int) -> Item:
        return self.home() if index == 0 else self.items[index]

    @property
    def reported_state(self) -> MissionState:
        """MISSION_CURRENT.mission_state."""
        if self.count < 2:
            return MissionState.NO_MISSION
        return MissionState.PAUSED if self.paused and self.state is MissionState.ACTIVE else self.state

    def starts_with_takeoff(self) -> bool:
        """Whether the navigation command that would be flown next is a take-off."""
        start = max(1, self.index) if self.state is not MissionState.COMPLETE else 1
        found = self._find_navigation(start, {}, [])
        return found is not None and self.items[found].command == mavlink.MAV_CMD_NAV_TAKEOFF

    def _find_navigation(self, start: int, jumps: dict[int, int], passed: list[Item]) -> int | None:
        """Index of the next navigation command from `start`, following jumps; collects do-commands."""
        index, in_a_row = start, 0
        while 1 <= index < self.count:
            item = self.items[index]
            if item.command in NAVIGATION:
                return index
            if item.command == mavlink.MAV_CMD_DO_JUMP:
                in_a_row += 1
                if in_a_row > MAX_JUMPS_IN_A_ROW:
                    return None
                done = jumps.get(index, 0)
                if item.param2 < 0 or done < item.param2:
                    jumps[index] = done + 1
                    index = int(item.param1)
                    continue
            else:
                passed.append(item)
            index += 1
        return None

    # -- flying it ---------------------------------------------------------------------------------------

    def start_or_resume(self, pilot: Pilot, *, restart: bool = False) -> None:
        """Fly on from the current command; from the first one if there is none or the mission is over."""
        self.paused = False
        if restart or self.index == 0 or self.state is MissionState.COMPLETE:
            self._jumps.clear()
            self._advance(pilot, 1)
        else:
            self.state = MissionState.ACTIVE
            self._start(pilot, self.index)

    def stop(self) -> None:
        """The mission mode was left."""
        self.paused = False
        if self.state is MissionState.ACTIVE:
            self.state = MissionState.PAUSED

    def reset(self) -> None:
        """The vehicle was disarmed: the next start is from the beginning."""
        self.index, self.flown = 0, None
        self.paused = False
        self._jumps.clear()
        self._pending.clear()
        if self.state is not MissionState.COMPLETE:
            self.state = MissionState.NOT_STARTED

    def rewind(self) -> None:
        """Forget how often jumps were taken."""
        self._jumps.clear()

    def set_current(self, pilot: Pilot, index: int) -> bool:
        """Make `index` (0: the first) current; at once when flying, else for the next start."""
        index = max(index, 1)
        if index >= self.count:
            return False
        if self.state is MissionState.ACTIVE:
            self._advance(pilot, index)
            return True
        found = self._find_navigation(index, {}, [])
        if found is None:
            return False
        self.index = found
        self.state = MissionState.PAUSED
        return True

    def restart_current(self, pilot: Pilot) -> bool:
        """Read the current command again and start it; False if it is not there any more."""
        if self.state is not MissionState.ACTIVE or not 1 <= self.index < self.count:
            return False
        if self.items[self.index].command not in NAVIGATION:
            return False
        self._start(pilot, self.index)
        return True

    def update(self, pilot: Pilot, now: float) -> None:
        """Advance at `now` [s]; call it while the mission mode is on."""
        if self.state is not MissionState.ACTIVE or self.paused:
            return
        self._run_pending(pilot, now)
        if self.flown is not None and pilot.navigation_done(now):
            pilot.mission_item_reached(self.index, self.flown)
            self._advance(pilot, self.index + 1)

    def _run_pending(self, pilot: Pilot, now: float) -> None:
        while self._pending:
            item = self._pending[0]
            if item.command == mavlink.MAV_CMD_CONDITION_DELAY:
                if self._delay_until_s == 0.0:
                    self._delay_until_s = now + item.param1
                if now < self._delay_until_s:
                    return
                self._delay_until_s = 0.0
            else:
                pilot.do(item)
            self._pending.pop(0)

    def _advance(self, pilot: Pilot, start: int) -> None:
        self._pending, self._delay_until_s = [], 0.0
        found = self._find_navigation(start, self._jumps, self._pending)
        if found is None:
            self.state = MissionState.COMPLETE
            self.flown = None
            pilot.mission_ended()
            return
        self.state = MissionState.ACTIVE
        self._start(pilot, found)

    def _start(self, pilot: Pilot, index: int) -> None:
        self.index, self.flown = index, self.items[index]
        following = self._find_navigation(index + 1, dict(self._jumps), [])
        pilot.start_navigation(self.flown, None if following is None else self.items[following])
