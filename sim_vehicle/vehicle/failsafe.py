"""Failsafes of one vehicle: ground station, battery, remote control, position, and their actions.

Limits and actions come from the personality's `FlightParameters`, texts from the personality's `texts`.
Further modules: `battery_watch`, `remote_watch`, `fence_watch`.
"""

import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.personalities.base import Vehicle
from sim_vehicle.vehicle.battery_watch import BatteryWatch
from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.flight_parameters import FailsafeAction
from sim_vehicle.vehicle.remote_watch import LONG, SHORT, RemoteWatch

CHECK_INTERVAL_S = 0.1
_BEHAVIOURS = {
    FailsafeAction.HOLD: Behaviour.HOLD,
    FailsafeAction.RETURN: Behaviour.RETURN,
    FailsafeAction.LAND: Behaviour.LAND,
    FailsafeAction.RETURN_POINT: Behaviour.GUIDED,
    FailsafeAction.HOLD_ALTITUDE: Behaviour.SINK,
    FailsafeAction.MISSION: Behaviour.MISSION,
}
# Priorities: a failsafe does not interrupt a behaviour that already brings the vehicle down.
_BEHAVIOUR_PRIORITY = {Behaviour.RETURN: 1, Behaviour.LAND: 2}
# required behaviour -> priority; 1 if not listed
_ACTION_PRIORITY = {Behaviour.LAND: 2, Behaviour.SINK: 2, Behaviour.MISSION: 2}


class Failsafes:
    """The latched failsafes of one vehicle; call `update` at each decision of the vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.gcs = self.position = False
        self._battery, self._remote = BatteryWatch(vehicle), RemoteWatch(vehicle)
        self._gcs_heartbeat_s: float | None = None
        # action after the hold, and the time of the action [s]
        self._held_action: tuple[FailsafeAction, float] | None = None

    @property
    def rc(self) -> bool:
        """True while the remote control is lost."""
        return self._remote.lost

    @property
    def battery(self) -> int:
        """Battery failsafe level: 0 none, 1 low, 2 critical."""
        return self._battery.failing

    @property
    def any(self) -> bool:
        """True while any failsafe is latched (MAV_STATE_CRITICAL)."""
        return self.gcs or self.rc or self.position or self.battery > 0

    @property
    def battery_state(self) -> int:
        """Battery level as MAV_BATTERY_CHARGE_STATE."""
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK) + self._battery.level

    def receive_heartbeat(self, sysid: int, now: float) -> None:
        """Process a heartbeat of the ground station `sysid` at `now` [s]."""
        expected = self._vehicle.flight_parameters.gcs_sysid
        if expected is None or sysid == expected:
            self._gcs_heartbeat_s = now

    def update(self, now: float) -> float:
        """Check every failsafe; return the latest time of the next check [s]."""
        self._watch_gcs(now)
        self.act(self._unless_landing(self._battery.update(now)), now)
        self._watch_rc(now)
        self._watch_position(now)
        self._end_hold(now)
        flight_parameters = self._vehicle.flight_parameters
        due_s = (
            self._remote.next_s
            if self._held_action is None
            else min(self._held_action[1], self._remote.next_s)
        )
        if self._gcs_heartbeat_s is None or self.gcs or math.isinf(flight_parameters.gcs_timeout_s):
            return due_s
        return min(due_s, self._gcs_heartbeat_s + flight_parameters.gcs_timeout_s + CHECK_INTERVAL_S)

    @property
    def gcs_missing(self) -> bool:
        """True if heartbeats of ground stations are watched but none has arrived since the boot."""
        return self._gcs_heartbeat_s is None and not math.isinf(self._vehicle.flight_parameters.gcs_timeout_s)

    def act(self, action: FailsafeAction, now: float, *, at_once: bool = False) -> None:
        """Carry out the action of a failsafe or of the fence.

        A flying vehicle holds for `failsafe_delay_s` before RETURN and LAND, unless `at_once` is set. A
        ground station can choose another mode during the hold. A vehicle on the ground stops its motors if
        the personality has `failsafe_disarms`, else ignores the action.
        """
        vehicle = self._vehicle
        delay_s = vehicle.flight_parameters.failsafe_delay_s
        delayed = action in (FailsafeAction.RETURN, FailsafeAction.LAND) and not at_once and delay_s > 0
        if action is FailsafeAction.NOTHING:
            return
        if not vehicle.flight.flying:
            disarms = vehicle.personality.failsafe_disarms and action is not FailsafeAction.WARN
            if disarms and vehicle.armed:
                vehicle.arming.stop()
            return
        if (
            delayed
            and self._held_action is None
            and vehicle.position_known(now)
            and not self._mode_has_priority_over(action)
        ):
            self._held_action = (action, now + delay_s)
            vehicle.announce("failsafe_waits", seconds=round(delay_s))
            vehicle.modes.enter_behaviour(Behaviour.HOLD)
            return
        vehicle.announce("failsafe")
        if action is not FailsafeAction.WARN:
            self._held_action = None
            self._carry_out(action, now)

    def _mode_has_priority_over(self, action: FailsafeAction) -> bool:
        """Return True if the present behaviour has at least the priority of `action`."""
        behaviour = _BEHAVIOURS[action]
        return _BEHAVIOUR_PRIORITY.get(self._vehicle.mode.behaviour, 0) >= _BEHAVIOUR_PRIORITY.get(
            behaviour, 1
        )

    def _end_hold(self, now: float) -> None:
        """Carry out the held action after the hold; drop the action if the mode has changed."""
        if self._held_action is None:
            return
        action, due_s = self._held_action
        if self._vehicle.mode.behaviour is not Behaviour.HOLD:
            self._held_action = None
        elif now + EPSILON_S >= due_s:
            self.act(action, now, at_once=True)

    def _carry_out(self, action: FailsafeAction, now: float) -> None:
        vehicle = self._vehicle
        number = vehicle.personality.failsafe_modes.get(action)
        if action is FailsafeAction.TERMINATE:
            vehicle.announce("terminated")
            if number is not None:
                vehicle.modes.enter(number)
        if action in (FailsafeAction.TERMINATE, FailsafeAction.DISARM):
            vehicle.disarm(force=True)
            return
        start_landing = vehicle.personality.start_landing
        if start_landing is not None and action is FailsafeAction.LAND and start_landing(vehicle, now):
            return
        mode = vehicle.personality.modes[number] if number is not None else self._mode_of(action, now)
        if mode is not None and _BEHAVIOUR_PRIORITY.get(vehicle.mode.behaviour, 0) < _ACTION_PRIORITY.get(
            mode.behaviour, 1
        ):
            vehicle.modes.enter(mode.number)
            if mode.behaviour is Behaviour.GUIDED:
                self._go_to_return_point()

    def _unless_landing(self, action: FailsafeAction) -> FailsafeAction:
        """Return `action`, or WARN for a plane in the landing of its mission (TERMINATE stays)."""
        vehicle = self._vehicle
        lands = vehicle.personality.start_landing is not None and vehicle.flight.landing_now
        return FailsafeAction.WARN if lands and action is not FailsafeAction.TERMINATE else action

    def _mode_of(self, action: FailsafeAction, now: float) -> Mode | None:
        """Return the mode for `action`, or the best mode that is possible; None: keep the mode."""
        vehicle, behaviour = self._vehicle, _BEHAVIOURS[action]
        if behaviour is Behaviour.MISSION:
            unchanged = vehicle.mode.behaviour is behaviour or not vehicle.modes.mission_ready(now)
            return None if unchanged else vehicle.personality.mode_of(behaviour)
        needs_position = behaviour in (Behaviour.RETURN, Behaviour.HOLD, Behaviour.GUIDED)
        if needs_position and not vehicle.position_known(now):
            behaviour = Behaviour.LAND
        mode = vehicle.personality.find_mode(behaviour)
        if mode is None:  # a plane that lands by its mission only
            behaviour = Behaviour.RETURN if vehicle.position_known(now) else Behaviour.HOLD
            mode = vehicle.personality.mode_of(behaviour)
        return mode

    def _go_to_return_point(self) -> None:
        """Fly to the fence's return point, else home, at `fence_return_height_m` above home."""
        vehicle = self._vehicle
        place_deg = vehicle.fence.return_point_deg or vehicle.home_and_rally.home_deg
        up_m = vehicle.flight.home().alt_amsl_m + vehicle.flight_parameters.fence_return_height_m
        vehicle.flight.guided_go(*place_deg, up_m)

    def gcs_late(self, now: float) -> bool:
        """Return True if the ground station has been silent longer than the limit."""
        flight_parameters = self._vehicle.flight_parameters
        if self._gcs_heartbeat_s is None:
            return self.gcs_missing and flight_parameters.gcs_missing_is_lost
        return now - self._gcs_heartbeat_s > flight_parameters.gcs_timeout_s

    def _handle_lost_link(
        self, link: str, normal: FailsafeAction, by_mode: Mapping[int, FailsafeAction], now: float
    ) -> None:
        """Announce a lost link and act; `by_mode`: other actions in the air, by mode number."""
        vehicle = self._vehicle
        mode, flying = vehicle.mode, vehicle.flight.flying
        action = by_mode.get(mode.number, normal) if flying else normal
        if action is not FailsafeAction.NOTHING or normal is FailsafeAction.NOTHING:
            vehicle.announce(f"{link}_lost")
        elif mode.behaviour is Behaviour.MISSION:
            vehicle.announce(f"{link}_ignored_in_mission")
        else:
            vehicle.announce(f"{link}_ignored")
        self.act(self._unless_landing(action), now)
        vehicle.announce(f"{link}_stays" if vehicle.mode is mode else f"{link}_acted", mode=vehicle.mode.name)

    def _watch_gcs(self, now: float) -> None:
        vehicle, flight_parameters = self._vehicle, self._vehicle.flight_parameters
        late = self.gcs_late(now)
        if late and not self.gcs and vehicle.armed:
            self.gcs = True
            self._handle_lost_link("gcs", flight_parameters.gcs_action, flight_parameters.gcs_action_in, now)
        elif self.gcs and not late:
            self.gcs = False
            vehicle.announce("gcs_back")

    def _watch_rc(self, now: float) -> None:
        vehicle, flight_parameters, before = (
            self._vehicle,
            self._vehicle.flight_parameters,
            self._vehicle.mode.number,
        )
        stage = self._remote.update(now)
        if stage == LONG:
            self._handle_lost_link(stage, flight_parameters.rc_action, flight_parameters.rc_action_in, now)
        elif stage == SHORT and flight_parameters.rc_short_action is not None:
            self._handle_lost_link(
                stage, flight_parameters.rc_short_action, flight_parameters.rc_short_action_in, now
            )
            self._remote.record_mode_change(before, vehicle.mode.number)

    def _watch_position(self, now: float) -> None:
        vehicle, flight_parameters = self._vehicle, self._vehicle.flight_parameters
        watched = flight_parameters.position_watched and vehicle.readiness.position(now)
        lost = watched and not vehicle.body.position_ok
        if lost and not self.position and vehicle.armed:
            self.position = True
            vehicle.announce("position_lost")
            action = flight_parameters.position_lost_action
            if action is FailsafeAction.HOLD_ALTITUDE and self.rc:
                action = FailsafeAction.LAND
            if vehicle.mode.needs_position or flight_parameters.position_lost_everywhere:
                self.act(action, now, at_once=True)
        elif self.position and not lost:
            self.position = False
            vehicle.announce("position_back")
