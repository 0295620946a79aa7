"""Arming and disarming: refusals, home, motors, and automatic disarming."""

import math

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle


class Arming:
    """The armed state of one vehicle and the rules of arming and disarming."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle, self._rules = vehicle, vehicle.personality.arming
        self._armed_at_s = 0.0
        self._idle_since_s = -math.inf  # the sticks have not prevented the automatic disarming since
        self._flown = self._was_airborne = False
        self._taken_off_at_s = math.nan

    @property
    def armed_since_s(self) -> float:
        """Time of the arming [s]; nan while disarmed."""
        return self._armed_at_s if self._vehicle.armed else math.nan

    @property
    def flying_since_s(self) -> float:
        """Time of the latest take-off since arming [s]; nan before the take-off and while disarmed."""
        return self._taken_off_at_s if self._vehicle.armed else math.nan

    def arm(self, now: float, *, force: bool, text: str = "armed") -> bool:
        """Start the motors and return True; after a refusal, announce the reasons and return False."""
        vehicle = self._vehicle
        if self._vehicle.armed:
            return True
        if vehicle.body.crashed:  # a crashed vehicle cannot be armed, even by force
            vehicle.announce("arm_refused", reason="Crashed")
            return False
        in_mission = vehicle.mode.behaviour is Behaviour.MISSION
        if not (self._may_arm_by_force(now) if force else self._may_arm(in_mission=in_mission, now=now)):
            return False
        if vehicle.home_and_rally.home is not None and not vehicle.home_and_rally.home_locked:
            vehicle.home_and_rally.set_home(vehicle.here(), now)
        self._armed_at_s, self._flown = now, False
        self._was_airborne = vehicle.body.airborne
        self._taken_off_at_s = math.nan
        vehicle.flight.cleared_for_takeoff = in_mission and vehicle.flight_parameters.mission.takes_off
        vehicle.body.arm(True)
        vehicle.announce(text)
        vehicle.flight.begin_takeoff()
        return True

    def _may_arm_by_force(self, now: float) -> bool:
        reasons = self._rules.mandatory_refusals(self._vehicle, now)
        for reason in reasons:
            self._vehicle.announce("arm_refused", reason=reason)
        return not reasons

    def _may_arm(self, *, in_mission: bool, now: float) -> bool:
        vehicle = self._vehicle
        reasons = self._rules.refusals(vehicle, now)
        armable = vehicle.mode.armable or (in_mission and vehicle.flight_parameters.arming.in_mission_mode)
        if not armable:
            reasons = [*reasons, *vehicle.sender.texts_for("not_armable", mode=vehicle.mode.name)]
        for reason in reasons:
            vehicle.announce("arm_refused", reason=reason)
        if reasons:
            vehicle.announce("arm_denied")
        if reasons or not armable:
            return False
        reasons = self._rules.stick_refusals(vehicle, now)
        for reason in reasons:
            vehicle.announce("sticks_refused", reason=reason)
        return not reasons

    def disarm(self, *, force: bool) -> bool:
        """Stop the motors and return True; return False in the air unless `force` is set.

        A forced stop in the air makes the vehicle fall.
        """
        if self._vehicle.body.airborne and self._vehicle.armed and not force:
            self._vehicle.announce("disarm_refused")
            return False
        if self._vehicle.armed:
            self.stop()
        return True

    def stop(self, text: str = "disarmed") -> None:
        """Stop the motors unconditionally."""
        vehicle = self._vehicle
        vehicle.flight.cleared_for_takeoff = False
        vehicle.body.arm(False)
        if not (vehicle.personality.mission.stays_landed and vehicle.mode.behaviour is Behaviour.MISSION):
            vehicle.mission.reset()
        counter = self._rules.flight_counter
        if counter is not None:
            vehicle.params.set_internal(counter, vehicle.params[counter] + 1)
        vehicle.announce(text)
        vehicle.modes.disarmed()

    def update(self, now: float) -> float:
        """Disarm after a landing, or if no take-off follows arming; return the next check [s] (inf: none)."""
        if not self._vehicle.armed:
            return math.inf
        vehicle = self._vehicle
        airborne = vehicle.body.airborne
        if airborne != self._was_airborne:
            self._was_airborne = airborne
            if airborne:
                self._taken_off_at_s = now
            vehicle.announce("taken_off" if airborne else "touched_down")
        self._flown = self._flown or airborne
        if airborne:
            return math.inf
        parameters = vehicle.flight_parameters.arming
        delay_s = parameters.disarm_landed_s if self._flown else parameters.disarm_unflown_s
        if vehicle.remote.keeps_armed(now) or vehicle.body.spools_up:
            self._idle_since_s = now
        due_s = max(self._armed_at_s, vehicle.flight.ground_since_s, self._idle_since_s) + delay_s
        if self._flown and vehicle.flies_mission and not self._rules.landing_disarms:
            return math.inf
        if vehicle.flight.landed(now) and now + EPSILON_S >= due_s:
            self.stop("disarmed_landed" if self._flown else "disarmed_unflown")
            return math.inf
        return due_s
