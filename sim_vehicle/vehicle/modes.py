"""The flight mode of one vehicle: changes by ground stations, and changes by the vehicle itself."""

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.behaviour import PILOTED, Behaviour, Mode
from sim_vehicle.vehicle.interface import Vehicle

LEAP_LIFT = 0.5  # largest thrust, as a multiple of the weight, that cannot begin a take-off


class Modes:
    """The mode of one vehicle and the rules of mode changes."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle, self._table = vehicle, vehicle.personality.modes
        self.reset(0.0)

    def reset(self, now: float) -> None:
        """Enter the boot mode at `now` [s]."""
        self.mode: Mode = self._table.by_number[self._table.boot]
        self._armable_mode = self.mode
        self.chosen = False  # a ground station or a pilot has changed the mode since the boot
        self.mission_checked_s = now  # end of the check of a new mission [s]

    # -- by a ground station -----------------------------------------------------------------------------

    def set_behaviour(self, behaviour: Behaviour, now: float) -> bool:
        """Change to the personality's mode of this behaviour, as a ground station does."""
        return self.set(self._table.of(behaviour).number, now)

    def set(self, number: int, now: float) -> bool:
        """Change the mode as a ground station does; return False if the vehicle refuses the command."""
        vehicle = self._vehicle
        if vehicle.injected_faults.effect.mode_stuck is not None:
            return vehicle.injected_faults.effect.mode_stuck
        mode = self._table.by_number.get(number)
        if mode is None or not mode.selectable:
            vehicle.announce("no_such_mode", number=number)
            return False
        self._vehicle.setpoints.mode_chosen()
        if mode is self.mode:
            return True
        if self.mode.terminates:
            vehicle.announce("mode_terminated", mode=mode.name)
            return False
        if mode.behaviour is Behaviour.MISSION and self._returns_without_mission:
            vehicle.announce("no_mission_returns")
            mode = self._table.of(Behaviour.RETURN)
        if vehicle.armed and not self._may_enter(mode, now):
            return False
        self.chosen = True
        vehicle.fence_watch.mode_changed_by_station(now)
        self._enter(mode)
        return True

    @property
    def _returns_without_mission(self) -> bool:
        """Return True for ArduPlane without a mission: it accepts AUTO and returns (ModeAuto::update)."""
        vehicle = self._vehicle
        return vehicle.personality.mission.ends_in is Behaviour.RETURN and vehicle.mission.empty

    def _may_enter(self, mode: Mode, now: float) -> bool:
        """Return True if an armed vehicle can enter the mode; else announce the reason."""
        vehicle = self._vehicle
        if mode.needs_position and not vehicle.position_known(now):
            refusal = "mode_needs_position"
        elif mode.setpoints_only and not vehicle.setpoints.streaming(now):
            refusal = "mode_needs_setpoints"
        elif mode.needs_pilot and vehicle.remote.missing(now):
            refusal = "mode_needs_pilot"
        elif self._would_leap(mode, now):
            refusal = "mode_throttle_high"
        elif mode.behaviour is Behaviour.MISSION and not self._mission_may_start(now):
            refusal = "mode_needs_mission"
        else:
            return True
        vehicle.announce(refusal, mode=mode.name)
        return False

    def _would_leap(self, mode: Mode, now: float) -> bool:
        """Return True if a vehicle on the ground would take off by entering a manual mode."""
        vehicle = self._vehicle
        enters = mode.behaviour is Behaviour.MANUAL and self.mode.behaviour is not Behaviour.MANUAL
        if not enters or vehicle.body.airborne or not self._table.refuses_leap:
            return False
        return vehicle.flight_parameters.pilot.lift(vehicle.remote.sticks(now).throttle) > LEAP_LIFT

    def _mission_may_start(self, now: float) -> bool:
        vehicle = self._vehicle
        if not self.mission_ready(now):
            return False
        on_ground = vehicle.personality.mission.home_item and not vehicle.body.airborne
        if on_ground and not vehicle.mission.starts_with_takeoff():
            vehicle.announce("mission_without_takeoff")
            return False
        return True

    def mission_ready(self, now: float) -> bool:
        """Return True if the mission has items, is flyable, and its check after the upload is complete."""
        mission = self._vehicle.mission
        return not mission.empty and mission.flyable and now + EPSILON_S >= self.mission_checked_s

    # -- by the vehicle ----------------------------------------------------------------------------------

    def enter_behaviour(self, behaviour: Behaviour) -> None:
        """Change to the personality's mode of this behaviour without any check."""
        self._enter(self._table.of(behaviour))

    def enter(self, number: int) -> None:
        """Change to a mode by its number without any check; the mode need not be selectable."""
        self._enter(self._table.by_number[number])

    def _enter(self, mode: Mode) -> None:
        self.mode = mode
        if mode.armable:
            self._armable_mode = mode
        self._vehicle.setpoints.reset()
        self._vehicle.flight.enter(mode)
        self._forget_landing(mode)

    def _forget_landing(self, mode: Mode) -> None:
        """Reset the mission of a landed, disarmed vehicle on the entry into a manual mode."""
        vehicle, mission = self._vehicle, self._vehicle.mission
        manual = mode.behaviour in PILOTED
        if vehicle.personality.mission.stays_landed and mission.in_landing and manual and not vehicle.armed:
            vehicle.announce("mission_reset")
            mission.reset()

    def mode_switch_read(self) -> None:
        """Enter the boot mode when a disarmed vehicle first reads the RC mode switch after a boot."""
        if self._table.rereads_switch and not self._vehicle.armed and self.mode.number != self._table.boot:
            self.enter(self._table.boot)

    def disarmed(self) -> None:
        """Restore the last armable mode after disarming, as some personalities do."""
        if self._table.restored_by_disarming and not self.mode.terminates:
            self._enter(self._armable_mode)

    def taken_off(self) -> None:
        """Change mode after the climb of a take-off, if `takeoff.then` of the flight parameters is set."""
        vehicle = self._vehicle
        behaviour = vehicle.flight_parameters.takeoff.then
        if behaviour is None:
            return
        if behaviour is Behaviour.MISSION and not self.mission_ready(vehicle.now):
            behaviour = Behaviour.HOLD
        target_m = vehicle.flight.guided_target_m
        self.enter_behaviour(behaviour)
        if behaviour is Behaviour.HOLD and target_m is not None:
            vehicle.flight.go(target_m)  # completes the climb

    def mission_over(self) -> None:
        """Change mode in flight after the last item of a mission, if `mission.ends_in` is set."""
        ends_in = self._vehicle.personality.mission.ends_in
        if ends_in is not None and self._vehicle.flight.flying:
            self.enter_behaviour(ends_in)
