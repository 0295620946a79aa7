"""What a vehicle watches by itself and what it does then: ground station, battery, RC, position, fence.

Which limits apply and what follows is the personality's `Tuning`; how it is said, its `texts`.
"""

import math
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities.base import Behaviour, FailsafeAction

if TYPE_CHECKING:
    from sim_vehicle.vehicle.autopilot import Autopilot

LOOK_S = 0.1
_BEHAVIOURS = {
    FailsafeAction.HOLD: Behaviour.HOLD,
    FailsafeAction.RETURN: Behaviour.RETURN,
    FailsafeAction.LAND: Behaviour.LAND,
    FailsafeAction.RETURN_POINT: Behaviour.GUIDED,
}
# How grave they are: a failsafe does not interrupt one that brings the vehicle down already.
_HOMEWARD = {Behaviour.RETURN: 1, Behaviour.LAND: 2}


class Failsafes:
    """Latches of one vehicle; `update` is called whenever it decides."""

    def __init__(self, vehicle: "Autopilot") -> None:
        self._vehicle = vehicle
        self.gcs = self.rc = self.position = False
        self.battery = 0  # 1 low, 2 critical; stays until the next boot
        self.battery_warned = False
        self._gcs_heard_s: float | None = None
        self._waiting: tuple[FailsafeAction, float] | None = None  # what follows a hold, and when [s]
        self._voltage_low_since_s = [math.inf, math.inf]

    @property
    def any(self) -> bool:
        """Whether one is latched (MAV_STATE_CRITICAL)."""
        return self.gcs or self.rc or self.position or self.battery > 0

    @property
    def battery_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE."""
        return int(mavlink.MAV_BATTERY_CHARGE_STATE_OK) + self.battery

    def heard_ground_station(self, sysid: int, now: float) -> None:
        wanted = self._vehicle.tuning.gcs_sysid
        if wanted is None or sysid == wanted:
            self._gcs_heard_s = now

    def update(self, now: float) -> float:
        """Look at everything; when to look again at the latest [s]."""
        self._watch_gcs(now)
        self._watch_battery(now)
        self._watch_rc()
        self._watch_position(now)
        self._go_on(now)
        tuning = self._vehicle.tuning
        due_s = math.inf if self._waiting is None else self._waiting[1]
        if self._gcs_heard_s is None or self.gcs or math.isinf(tuning.gcs_timeout_s):
            return due_s
        return min(due_s, self._gcs_heard_s + tuning.gcs_timeout_s + LOOK_S)

    @property
    def gcs_missing(self) -> bool:
        """Whether no ground station was ever heard where one is watched."""
        return self._gcs_heard_s is None and not math.isinf(self._vehicle.tuning.gcs_timeout_s)

    def act(self, action: FailsafeAction, now: float, *, at_once: bool = False) -> None:
        """Carry out what a failsafe or a fence asks for, if the vehicle is in the air.

        On the ground there is nothing to bring down: there the motors stop, where the personality says so.
        Where the tuning says so, the vehicle holds for a while first, in which a ground station may choose
        another mode instead; `at_once` leaves that out.
        """
        vehicle = self._vehicle
        delay_s = vehicle.tuning.failsafe_delay_s
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
            vehicle.tell("failsafe_waits", seconds=round(delay_s))
            vehicle.modes.by_itself(Behaviour.HOLD)
            return
        vehicle.tell("failsafe")
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
        elif now + 1e-9 >= due_s:
            self.act(action, now, at_once=True)

    def _carry_out(self, action: FailsafeAction, now: float) -> None:
        vehicle = self._vehicle
        if action is FailsafeAction.WARN:
            return
        if action is FailsafeAction.TERMINATE:
            vehicle.tell("terminated")
            vehicle.disarm(force=True)
            return
        behaviour = _BEHAVIOURS[action]
        needs_position = behaviour in (Behaviour.RETURN, Behaviour.HOLD, Behaviour.GUIDED)
        if needs_position and not vehicle.position_known(now):
            behaviour = Behaviour.LAND
        if vehicle.personality.find_mode(behaviour) is None:  # a plane whose only landings are missions'
            behaviour = Behaviour.RETURN if vehicle.position_known(now) else Behaviour.HOLD
        if _HOMEWARD.get(vehicle.mode.behaviour, 0) < _HOMEWARD.get(behaviour, 1):
            vehicle.modes.by_itself(behaviour)
            if behaviour is Behaviour.GUIDED:
                self._go_to_return_point()

    def _go_to_return_point(self) -> None:
        """The fence's, else home, at the altitude that belongs to it."""
        vehicle = self._vehicle
        place_deg = vehicle.fence.return_point_deg or vehicle.landmarks.home_deg
        up_m = vehicle.flight.home().alt_amsl_m + vehicle.tuning.fence_return_height_m
        vehicle.flight.guided_go(*place_deg, up_m)

    def gcs_late(self, now: float) -> bool:
        """Whether the ground station has been silent for too long."""
        tuning = self._vehicle.tuning
        if self._gcs_heard_s is None:
            return self.gcs_missing and tuning.gcs_missed_unheard
        return now - self._gcs_heard_s > tuning.gcs_timeout_s

    def _watch_gcs(self, now: float) -> None:
        vehicle, tuning = self._vehicle, self._vehicle.tuning
        late = self.gcs_late(now)
        if late and not self.gcs and vehicle.armed:
            self.gcs = True
            vehicle.tell("gcs_lost")
            self.act(tuning.gcs_action, now)
        elif self.gcs and not late:
            self.gcs = False
            vehicle.tell("gcs_back")

    def _watch_battery(self, now: float) -> None:
        tuning, body = self._vehicle.tuning, self._vehicle.body
        stages = (
            (1, "battery_low", tuning.battery_low_v, tuning.battery_low_share, tuning.battery_low_action),
            (
                2,
                "battery_critical",
                tuning.battery_critical_v,
                tuning.battery_critical_share,
                tuning.battery_critical_action,
            ),
        )
        if not self.battery_warned and body.battery_remaining < tuning.battery_warning_share:
            self.battery_warned = True
            self._vehicle.tell("battery_warning")
            self.act(FailsafeAction.WARN, now)
        for stage, text, low_v, low_share, action in stages:
            if self.battery >= stage:
                continue
            if not body.voltage_v < low_v:
                self._voltage_low_since_s[stage - 1] = math.inf
            elif math.isinf(self._voltage_low_since_s[stage - 1]):
                self._voltage_low_since_s[stage - 1] = now
            long_enough = now - self._voltage_low_since_s[stage - 1] >= tuning.battery_delay_s
            if long_enough or body.battery_remaining < low_share:
                self.battery = stage
                self._vehicle.tell(text, volts=body.voltage_v, used_mah=body.used_mah)
                self.act(action, now)

    def _watch_rc(self) -> None:
        vehicle, tuning = self._vehicle, self._vehicle.tuning
        lost = tuning.rc_required or vehicle.afflictions.rc_lost
        if lost and not self.rc and vehicle.armed:
            self.rc = True
            vehicle.tell("rc_lost")
            self.act(tuning.rc_action, vehicle.now)
        elif self.rc and not lost:
            self.rc = False
            vehicle.tell("rc_back")

    def _watch_position(self, now: float) -> None:
        vehicle = self._vehicle
        lost = vehicle.readiness.position(now) and not vehicle.body.position_ok
        if lost and not self.position and vehicle.armed:
            self.position = True
            vehicle.tell("position_lost")
            if vehicle.mode.needs_position:
                self.act(vehicle.tuning.position_lost_action, now, at_once=True)
        elif self.position and not lost:
            self.position = False
            vehicle.tell("position_back")
