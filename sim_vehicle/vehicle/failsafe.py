"""Failsafes of one vehicle: ground station, battery, remote control, position, and their actions.

Limits and actions come from the personality's `FlightParameters`, texts from the personality's `texts`.
"""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.battery_watch import BatteryWatch
from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, LinkAction
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.remote_watch import LONG, SHORT, RemoteWatch

CHECK_INTERVAL_S = 0.1
_BEHAVIOURS = {
    FailsafeAction.HOLD: Behaviour.HOLD,
    FailsafeAction.RETURN: Behaviour.RETURN,
    FailsafeAction.LAND: Behaviour.LAND,
    FailsafeAction.RETURN_POINT: Behaviour.GUIDED,
    FailsafeAction.HOLD_ALTITUDE: Behaviour.ALTITUDE,
    FailsafeAction.MISSION: Behaviour.MISSION,
}
# A failsafe does not interrupt a behaviour of the same or a higher priority; 0 if not listed.
_BEHAVIOUR_PRIORITY = {Behaviour.RETURN: 1, Behaviour.LAND: 2}
# required behaviour -> priority; 1 if not listed
_ACTION_PRIORITY = {Behaviour.LAND: 2, Behaviour.ALTITUDE: 2, Behaviour.MISSION: 2}


class Failsafes:
    """The latched failsafes of one vehicle; call `update` at each decision of the vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.gcs_lost = self.position_lost = False
        self._battery, self._remote = BatteryWatch(vehicle), RemoteWatch(vehicle)
        self._gcs_heartbeat_s: float | None = None
        # action after the hold, and the time of the action [s]
        self._held_action: tuple[FailsafeAction, float] | None = None

    @property
    def rc_lost(self) -> bool:
        """True while the remote control is lost."""
        return self._remote.lost

    @property
    def battery_level(self) -> int:
        """Battery failsafe: 0 none, 1 low, 2 critical."""
        return self._battery.failsafe_level

    @property
    def any_latched(self) -> bool:
        """True while any failsafe is latched (MAV_STATE_CRITICAL)."""
        return self.gcs_lost or self.rc_lost or self.position_lost or self.battery_level > 0

    @property
    def battery_state(self) -> int:
        """Battery level as MAV_BATTERY_CHARGE_STATE."""
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK) + self._battery.level

    def receive_heartbeat(self, sysid: int, now: float) -> None:
        """Process a heartbeat of the ground station `sysid` at `now` [s]."""
        expected = self._vehicle.flight_parameters.gcs.sysid
        if expected is None or sysid == expected:
            self._gcs_heartbeat_s = now

    def receive_remote_frame(self, now: float) -> None:
        """Process a frame of the remote control that came from a ground station."""
        self._remote.receive_frame(now)

    def update(self, now: float) -> float:
        """Check every failsafe; return the latest time of the next check [s] (inf: none)."""
        self._watch_gcs(now)
        self.act(self._unless_landing(self._battery.update(now)), now)
        self._watch_rc(now)
        self._watch_position(now)
        self._end_hold(now)
        timeout_s = self._vehicle.flight_parameters.gcs.timeout_s
        held_s = math.inf if self._held_action is None else self._held_action[1]
        due_s = min(held_s, self._remote.next_s)
        if self._gcs_heartbeat_s is None or self.gcs_lost or math.isinf(timeout_s):
            return due_s
        return min(due_s, self._gcs_heartbeat_s + timeout_s + CHECK_INTERVAL_S)

    @property
    def gcs_missing(self) -> bool:
        """True if heartbeats of ground stations are watched but none has arrived since the boot."""
        return self._gcs_heartbeat_s is None and not math.isinf(self._vehicle.flight_parameters.gcs.timeout_s)

    def act(self, action: FailsafeAction, now: float, *, at_once: bool = False) -> None:
        """Carry out the action of a failsafe or of the fence.

        A flying vehicle with a known position holds for `failsafe_delay_s` before RETURN and LAND, unless
        `at_once` is set. A mode change during this hold cancels the action; a second action acts at once.
        A vehicle on the ground stops its motors if the personality has `failsafe_disarms`.
        """
        vehicle = self._vehicle
        delay_s = vehicle.flight_parameters.failsafe_delay_s
        delayed = action in (FailsafeAction.RETURN, FailsafeAction.LAND) and not at_once and delay_s > 0
        if action is FailsafeAction.NOTHING:
            return
        if not vehicle.flight.flying:
            disarms = vehicle.personality.failsafes.disarms and action is not FailsafeAction.WARN
            if disarms and vehicle.armed:
                vehicle.arming.stop()
            return
        if (
            delayed
            and self._held_action is None
            and vehicle.position_known(now)
            and self._interrupts_for(_BEHAVIOURS[action])
        ):
            self._held_action = (action, now + delay_s)
            vehicle.announce("failsafe_waits", seconds=round(delay_s))
            vehicle.modes.enter_behaviour(Behaviour.HOLD)
            return
        vehicle.announce("failsafe")
        if action is not FailsafeAction.WARN:
            self._held_action = None
            self._carry_out(action, now)

    def _interrupts_for(self, behaviour: Behaviour) -> bool:
        """Return True if an action that requires `behaviour` has priority over the present behaviour."""
        present = _BEHAVIOUR_PRIORITY.get(self._vehicle.mode.behaviour, 0)
        return present < _ACTION_PRIORITY.get(behaviour, 1)

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
        mode_number = vehicle.personality.failsafes.modes.get(action)
        if action is FailsafeAction.TERMINATE:
            vehicle.announce("terminated")
            if mode_number is not None:
                vehicle.modes.enter(mode_number)
        if action in (FailsafeAction.TERMINATE, FailsafeAction.DISARM):
            vehicle.arming.disarm(force=True)
            return
        start_landing = vehicle.personality.mission.start_landing
        if start_landing is not None and action is FailsafeAction.LAND and start_landing(vehicle, now):
            return
        modes = vehicle.personality.modes.by_number
        mode = self._mode_of(action, now) if mode_number is None else modes[mode_number]
        if mode is not None and self._interrupts_for(mode.behaviour):
            vehicle.modes.enter(mode.number)
            if mode.behaviour is Behaviour.GUIDED:
                self._go_to_return_point()

    def _unless_landing(self, action: FailsafeAction) -> FailsafeAction:
        """Return `action`, or WARN while a plane lands, if `start_landing` is set (TERMINATE stays)."""
        vehicle = self._vehicle
        lands = vehicle.personality.mission.start_landing is not None and vehicle.flight.landing_now
        return FailsafeAction.WARN if lands and action is not FailsafeAction.TERMINATE else action

    def _mode_of(self, action: FailsafeAction, now: float) -> Mode | None:
        """Return the mode for `action`, or the best mode that is possible; None: keep the mode."""
        vehicle, behaviour = self._vehicle, _BEHAVIOURS[action]
        if behaviour is Behaviour.MISSION:
            unchanged = vehicle.mode.behaviour is behaviour or not vehicle.modes.mission_ready(now)
            return None if unchanged else vehicle.personality.modes.of(behaviour)
        needs_position = behaviour in (Behaviour.RETURN, Behaviour.HOLD, Behaviour.GUIDED)
        if needs_position and not vehicle.position_known(now):
            behaviour = Behaviour.LAND
        mode = vehicle.personality.modes.find(behaviour)
        if mode is None:  # a plane that lands by its mission only
            behaviour = Behaviour.RETURN if vehicle.position_known(now) else Behaviour.HOLD
            mode = vehicle.personality.modes.of(behaviour)
        return mode

    def _go_to_return_point(self) -> None:
        """Fly to the fence's return point, else home, at the fence's `return_height_m` above home."""
        vehicle = self._vehicle
        home = vehicle.flight.home()
        place_deg = vehicle.fence.return_point_deg or home.lat_lon_deg
        alt_amsl_m = home.alt_amsl_m + vehicle.flight_parameters.fence.return_height_m
        vehicle.flight.guided_go(*place_deg, alt_amsl_m)

    def gcs_late(self, now: float) -> bool:
        """Return True if the ground station is silent too long, or is missing with `missing_is_lost`."""
        gcs = self._vehicle.flight_parameters.gcs
        if self._gcs_heartbeat_s is None:
            return self.gcs_missing and gcs.missing_is_lost
        return now - self._gcs_heartbeat_s > gcs.timeout_s

    def _handle_lost_link(self, link: str, actions: LinkAction, now: float) -> None:
        """Announce a lost link and act."""
        vehicle, mode, normal = self._vehicle, self._vehicle.mode, actions.normal
        action = actions.by_mode.get(mode.number, normal) if vehicle.flight.flying else normal
        if action is not FailsafeAction.NOTHING or normal is FailsafeAction.NOTHING:
            vehicle.announce(f"{link}_lost")
        elif mode.behaviour is Behaviour.MISSION:
            vehicle.announce(f"{link}_ignored_in_mission")
        else:
            vehicle.announce(f"{link}_ignored")
        self.act(self._unless_landing(action), now)
        vehicle.announce(f"{link}_stays" if vehicle.mode is mode else f"{link}_acted", mode=vehicle.mode.name)

    def _watch_gcs(self, now: float) -> None:
        vehicle = self._vehicle
        late = self.gcs_late(now)
        if late and not self.gcs_lost and vehicle.armed:
            self.gcs_lost = True
            self._handle_lost_link("gcs", vehicle.flight_parameters.gcs.action, now)
        elif self.gcs_lost and not late:
            self.gcs_lost = False
            vehicle.announce("gcs_back")

    def _watch_rc(self, now: float) -> None:
        vehicle, parameters = self._vehicle, self._vehicle.flight_parameters.rc
        mode_before = vehicle.mode.number
        stage = self._remote.update(now)
        if stage == LONG:
            self._handle_lost_link(stage, parameters.action, now)
        elif stage == SHORT and parameters.short_action is not None:
            self._handle_lost_link(stage, parameters.short_action, now)
            self._remote.record_mode_change(mode_before, vehicle.mode.number)

    def _watch_position(self, now: float) -> None:
        vehicle, parameters = self._vehicle, self._vehicle.flight_parameters.position
        watched = parameters.watched and vehicle.readiness.position_ready(now)
        lost = watched and not vehicle.body.position_ok
        if lost and not self.position_lost and vehicle.armed:
            self.position_lost = True
            vehicle.announce("position_lost")
            action = parameters.lost_action
            if action is FailsafeAction.HOLD_ALTITUDE and self.rc_lost:
                action = FailsafeAction.LAND
            if vehicle.mode.needs_position or parameters.lost_everywhere:
                self.act(action, now, at_once=True)
        elif self.position_lost and not lost:
            self.position_lost = False
            vehicle.announce("position_back")
