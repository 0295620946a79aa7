"""The mission as PX4 executes it: one item after another, without a home placeholder.

The index counts every item, and each completed item is reported as reached. A landing, an upload and a mode
change keep the index. The mission starts over if the vehicle was disarmed at the last item. A disarmed
vehicle does not advance.
"""

from collections.abc import Sequence
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.px4.readiness import feasible
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import (
    MAX_ITEMS_PER_UPDATE,
    MAX_JUMPS_IN_A_ROW,
    NAVIGATION,
    Item,
    Mission,
    MissionState,
)
from sim_vehicle.vehicle.numbers import to_int


class Px4Mission(Mission):
    """Mission with items from index 0; the vehicle stores but does not fly an infeasible mission.

    A return item leaves the mission mode. The item stays current and is never reported as reached. A vehicle
    climbs in place to its first item; a take-off of a multicopter is then a position
    (`Mission::handleTakeoff`).
    """

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.climbs_first = True
        self._valid = True
        self._in_mission_mode = False
        self._was_active = False  # the present list has been active
        self._disarmed_after_active = False  # the vehicle was disarmed after the mission was active
        self._at_end = False  # no item follows the last completed item

    @property
    def empty(self) -> bool:
        return not self.items

    @property
    def flyable(self) -> bool:
        return self._valid

    @property
    def waiting(self) -> bool:
        return self.current_item is not None and self.current_item.command not in NAVIGATION

    def item(self, index: int) -> Item:
        return self.items[index]

    def starts_with_takeoff(self) -> bool:
        first = self._resolve(0 if self._starts_over else self.index, count_jumps=False)
        return first is not None and self.items[first].command == mavlink.MAV_CMD_NAV_TAKEOFF

    def replace(self, items: Sequence[Item], current: int = -1) -> None:
        """Replace the mission at once; `current` -1 keeps the index. The last item limits the index."""
        last = max(len(items) - 1, 0)
        self._items[:] = items
        self.index = min(self.index if current < 0 else current, last)
        self._jumps.clear()
        self._at_end = False
        self._was_active = self.state is MissionState.ACTIVE
        self._valid = feasible(self._vehicle, self.items)
        if self.state is MissionState.ACTIVE:
            self._activate()
        else:
            self.state, self._disarmed_after_active = MissionState.NOT_STARTED, False

    def check_again(self) -> None:
        """Check the mission after a change of the fence; a flyable active mission repeats its item."""
        self._valid = feasible(self._vehicle, self.items)
        if self.state is MissionState.ACTIVE:
            self._activate()

    # -- execution ----------------------------------------------------------------------------------------

    def start_or_resume(self, *, restart: bool = False) -> None:
        """Enter the mission mode; an armed vehicle continues at once, a disarmed vehicle after arming."""
        self._in_mission_mode = self.climbs_first = True
        if restart:
            self.index, self._at_end = 0, False
        if self._vehicle.armed:
            # Each activation checks again (Mission::on_activation).
            self._valid = feasible(self._vehicle, self.items)
            self._activate()

    def stop(self) -> None:
        self._in_mission_mode = False
        super().stop()
        self.current_item = None

    def reset(self) -> None:
        """Stop after disarming or a reboot; the index stays."""
        self._disarmed_after_active = self._disarmed_after_active or self._was_active
        self.current_item, self.climbs_first = None, True
        if self.state is not MissionState.COMPLETE:
            self.state = MissionState.NOT_STARTED

    def set_current(self, index: int) -> bool:
        if not 0 <= index < self.count:
            return False
        self.index, self._at_end, self._disarmed_after_active = index, False, False
        if self.state is MissionState.ACTIVE or (self._in_mission_mode and self._vehicle.armed):
            self._activate()
        else:
            self.state = MissionState.NOT_STARTED
        return True

    def update(self, now: float) -> None:
        if not self._in_mission_mode or not self._vehicle.armed:
            return
        if self.state not in (MissionState.ACTIVE, MissionState.COMPLETE) or self._disarmed_after_active:
            self._valid = feasible(self._vehicle, self.items)
            self._activate()
        for _ in range(MAX_ITEMS_PER_UPDATE):
            item = self.current_item
            if self.state is not MissionState.ACTIVE or item is None or not self._done(item, now):
                return
            self._pilot.mission_item_reached(self.index, item)
            if not item.autocontinue:
                self.current_item = None  # the vehicle stays at this item
                return
            self._continue()

    @property
    def _starts_over(self) -> bool:
        return self._disarmed_after_active and self.index + 1 == self.count

    def _activate(self) -> None:
        if self._starts_over:
            self.index, self._at_end = 0, False
            self._jumps.clear()
        self._disarmed_after_active = False
        found = None if self._at_end or not self._valid else self._resolve(self.index, count_jumps=False)
        if found is None:
            self.state, self.current_item = MissionState.COMPLETE, None
            self._pilot.no_mission()
            return
        self._was_active = True
        self.state, self.without_approach = MissionState.ACTIVE, True
        self._begin(found)

    def _continue(self) -> None:
        found = self._resolve(self.index + 1, count_jumps=True)
        if found is not None:
            self.without_approach = False
            self._begin(found)
            return
        if self.index + 1 >= self.count:
            self._jumps.clear()
        self.state, self.current_item, self._at_end = MissionState.COMPLETE, None, True
        self._pilot.mission_ended()

    def _begin(self, index: int) -> None:
        self.index, self.current_item = index, self._as_flown(self.items[index])
        self._command_begun_s = None
        self._pilot.mission_item_started(index, self.current_item)
        if self.current_item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._vehicle.announce("returning")
            self._vehicle.modes.enter_behaviour(Behaviour.RETURN)
        elif self.current_item.command in NAVIGATION:
            self._pilot.start_navigation(self.current_item, self._following(index))
        else:
            self._pilot.do(self.current_item)

    def _as_flown(self, item: Item) -> Item:
        if self._vehicle.body.plane or item.command != mavlink.MAV_CMD_NAV_TAKEOFF:
            return item
        return replace(item, command=mavlink.MAV_CMD_NAV_WAYPOINT, param1=0.0, param2=0.0)

    def _done(self, item: Item, now: float) -> bool:
        if item.command in NAVIGATION:
            return self._pilot.navigation_done(now)
        if self._command_begun_s is None:
            self._command_begun_s = now
        return self._passed(item, now - self._command_begun_s)

    def _resolve(self, index: int, *, count_jumps: bool) -> int | None:
        """Follow the jumps from `index` and return the index of the next item; None: no such item."""
        for _ in range(MAX_JUMPS_IN_A_ROW):
            if not 0 <= index < self.count:
                return None
            item = self.items[index]
            if item.command != mavlink.MAV_CMD_DO_JUMP:
                return index
            done = self._jumps.get(index, 0)
            if not 0 <= item.param1 < self.count:
                return None
            if item.param2 < 0 or done < item.param2:
                if count_jumps:
                    self._jumps[index] = done + 1
                index = to_int(item.param1)
            else:
                index += 1
        return None

    def _following(self, index: int) -> Item | None:
        """Return the next navigation command after `index`, or None."""
        for _ in range(MAX_ITEMS_PER_UPDATE):
            found = self._resolve(index + 1, count_jumps=False)
            if found is None:
                return None
            if self.items[found].command in NAVIGATION:
                return self.items[found]
            index = found
        return None
