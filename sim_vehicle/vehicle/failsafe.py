"""What a vehicle watches by itself and what it does then: ground station, battery, RC, position, fence.

Which limits apply and what follows is the personality's `FlightParameters`; how it is said, its `texts`. The battery,
the remote control and the fence are watched in files of their own.
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

LOOK_S = 0.1
_BEHAVIOURS = {
    FailsafeAction.HOLD: Behaviour.HOLD,
    FailsafeAction.RETURN: Behaviour.RETURN,
    FailsafeAction.LAND: Behaviour.LAND,
    FailsafeAction.RETURN_POINT: Behaviour.GUIDED,
    FailsafeAction.HOLD_ALTITUDE: Behaviour.SINK,
    FailsafeAction.MISSION: Behaviour.MISSION,
}
# How grave they are: a failsafe does not interrupt one that brings the vehicle down already.
_HOMEWARD = {Behaviour.RETURN: 1, Behaviour.LAND: 2}
_GRAVE = {Behaviour.LAND: 2, Behaviour.SINK: 2, Behaviour.MISSION: 2}  # of what a failsafe asks for; others 1


class Failsafes:
    """Latches of one vehicle; `update` is called whenever it decides."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.gcs = self.position = False
        self._battery, self._remote = BatteryWatch(vehicle), RemoteWatch(vehicle)
        self._gcs_heartbeat_s: float | None = None
        self._waiting: tuple[FailsafeAction, float] | None = None  # what follows a hold, and when [s]

    @property
    def rc(self) -> bool:
        """Whether the remote control is lost."""
        return self._remote.lost

    @property
    def battery(self) -> int:
        """1 low, 2 critical."""
        return self._battery.failing

    @property
    def any(self) -> bool:
        """Whether one is latched (MAV_STATE_CRITICAL)."""
        return self.gcs or self.rc or self.position or self.battery > 0

    @property
    def battery_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE."""
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK) + self._battery.level

    def note_ground_station(self, sysid: int, now: float) -> None:
        wanted = self._vehicle.flight_parameters.gcs_sysid
        if wanted is None or sysid == wanted:
            self._gcs_heartbeat_s = now

    def update(self, now: float) -> float:
        """Look at everything; when to look again at the latest [s]."""
        self._watch_gcs(now)
        self.act(self._unless_landing(self._battery.update(now)), now)
        self._watch_rc(now)
        self._watch_position(now)
        self._go_on(now)
        flight_parameters = self._vehicle.flight_parameters
        due_s = self._remote.next_s if self._waiting is None else min(self._waiting[1], self._remote.next_s)
        if self._gcs_heartbeat_s is None or self.gcs or math.isinf(flight_parameters.gcs_timeout_s):
            return due_s
        return min(due_s, self._gcs_heartbeat_s + flight_parameters.gcs_timeout_s + LOOK_S)

    @property
    def gcs_missing(self) -> bool:
        """Whether no ground station was ever heard where one is watched."""
        return self._gcs_heartbeat_s is None and not math.isinf(self._vehicle.flight_parameters.gcs_timeout_s)

    def act(self, action: FailsafeAction, now: float, *, at_once: bool = False) -> None:
        """Carry out what a failsafe or a fence asks for, if the vehicle is in the air.

        On the ground there is nothing to bring down: there the motors stop, where the personality says so.
        Where the tuning says so, the vehicle holds for a while first, in which a ground station may choose
        another mode instead; `at_once` leaves that out.
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
        if delayed and self._waiting is None and vehicle.position_known(now) and not self._comes_down(action):
            self._waiting = (action, now + delay_s)
            vehicle.announce("failsafe_waits", seconds=round(delay_s))
            vehicle.modes.by_itself(Behaviour.HOLD)
            return
        vehicle.announce("failsafe")
        if action is not FailsafeAction.WARN:
            self._waiting = None
            self._carry_out(action, now)

    def _comes_down(self, action: FailsafeAction) -> bool:
        """Whether what it does already is at least as grave."""
        behaviour = _BEHAVIOURS[action]
        return _HOMEWARD.get(self._vehicle.mode.behaviour, 0) >= _HOMEWARD.get(behaviour, 1)

    def _go_on(self, now: float) -> None:
        """After the hold; whoever changed the mode meanwhile has taken over."""
        if self._waiting is None:
            return
        action, due_s = self._waiting
        if self._vehicle.mode.behaviour is not Behaviour.HOLD:
            self._waiting = None
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
        if mode is not None and _HOMEWARD.get(vehicle.mode.behaviour, 0) < _GRAVE.get(mode.behaviour, 1):
            vehicle.modes.enter(mode.number)
            if mode.behaviour is Behaviour.GUIDED:
                self._go_to_return_point()

    def _unless_landing(self, action: FailsafeAction) -> FailsafeAction:
        """A plane whose mission lands it is not called back."""
        vehicle = self._vehicle
        lands = vehicle.personality.start_landing is not None and vehicle.flight.landing_now
        return FailsafeAction.WARN if lands and action is not FailsafeAction.TERMINATE else action

    def _mode_of(self, action: FailsafeAction, now: float) -> Mode | None:
        """The mode that does what is asked for, or the next best; None: nothing does."""
        vehicle, behaviour = self._vehicle, _BEHAVIOURS[action]
        if behaviour is Behaviour.MISSION:
            goes_on = vehicle.mode.behaviour is behaviour or not vehicle.modes.mission_ready(now)
            return None if goes_on else vehicle.personality.mode_of(behaviour)
        needs_position = behaviour in (Behaviour.RETURN, Behaviour.HOLD, Behaviour.GUIDED)
        if needs_position and not vehicle.position_known(now):
            behaviour = Behaviour.LAND
        mode = vehicle.personality.find_mode(behaviour)
        if mode is None:  # a plane whose only landings are missions'
            behaviour = Behaviour.RETURN if vehicle.position_known(now) else Behaviour.HOLD
            mode = vehicle.personality.mode_of(behaviour)
        return mode

    def _go_to_return_point(self) -> None:
        """The fence's, else home, at the altitude that belongs to it."""
        vehicle = self._vehicle
        place_deg = vehicle.fence.return_point_deg or vehicle.home_and_rally.home_deg
        up_m = vehicle.flight.home().alt_amsl_m + vehicle.flight_parameters.fence_return_height_m
        vehicle.flight.guided_go(*place_deg, up_m)

    def gcs_late(self, now: float) -> bool:
        """Whether the ground station has been silent for too long."""
        flight_parameters = self._vehicle.flight_parameters
        if self._gcs_heartbeat_s is None:
            return self.gcs_missing and flight_parameters.gcs_missed_unheard
        return now - self._gcs_heartbeat_s > flight_parameters.gcs_timeout_s

    def _lost(
        self, link: str, normal: FailsafeAction, otherwise: Mapping[int, FailsafeAction], now: float
    ) -> None:
        """A link is lost: what is said and done, which in the air may depend on the mode."""
        vehicle = self._vehicle
        mode, flying = vehicle.mode, vehicle.flight.flying
        action = otherwise.get(mode.number, normal) if flying else normal
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
            self._lost("gcs", flight_parameters.gcs_action, flight_parameters.gcs_action_in, now)
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
            self._lost(stage, flight_parameters.rc_action, flight_parameters.rc_action_in, now)
        elif stage == SHORT and flight_parameters.rc_short_action is not None:
            self._lost(stage, flight_parameters.rc_short_action, flight_parameters.rc_short_action_in, now)
            self._remote.acted(before, vehicle.mode.number)

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
