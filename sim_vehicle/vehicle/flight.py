"""Flight control of one vehicle by mode: mission, guided flight, return, landing, sinking."""

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.behaviour import PILOTED, Behaviour, Mode
from sim_vehicle.vehicle.flight_parameters import FlightParameters
from sim_vehicle.vehicle.interface import FlightControl, Vehicle
from sim_vehicle.vehicle.manoeuvres import Landing, Manoeuvre, Return, Takeoff
from sim_vehicle.vehicle.mission import LANDINGS, Item, MissionState
from sim_vehicle.vehicle.mission_pilot import MissionPilot, circle_to_altitude, target_of
from sim_vehicle.vehicle.piloting import Piloting

LANDED_AFTER_S = 1.0  # time on the ground until the vehicle counts as landed
MAX_SPEED_M_S = 50.0
MAX_ALTITUDE_M = 1e6  # largest absolute altitude
RUN_INTERVAL_S = 0.1  # time between two runs by sticks, or while a manoeuvre is in progress


class Flight:
    """Steering of one vehicle's body by mode and mission."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle, self.body, self.mission = vehicle, vehicle.body, vehicle.mission
        self.pilot, self._piloting = MissionPilot(self), Piloting(self)
        self.cleared_for_takeoff = False  # until disarmed
        self.behaviour = Behaviour.MANUAL
        self.landing_now = False
        self.taking_off = False
        self.takeoff_amsl_m: float | None = None  # requested altitude; None: `takeoff.height_m` above home
        self.ground_since_s = -math.inf
        self.manoeuvre: Manoeuvre | None = None  # outside of missions
        self.guided_target_m: tuple[float, float, float] | None = None
        # limits set in flight, by name
        self._set_in_flight: dict[str, float] = {}

    # -- state --------------------------------------------------------------------------------------------

    @property
    def flight_parameters(self) -> FlightParameters:
        return self.vehicle.flight_parameters

    def home(self) -> GeodeticPosition:
        return self.vehicle.home_and_rally.home_or_here

    @property
    def armed(self) -> bool:
        return self.body.armed

    def landed(self, now: float) -> bool:
        return not self.body.airborne and now - self.ground_since_s >= LANDED_AFTER_S

    @property
    def flying(self) -> bool:
        return self.armed and self.body.airborne

    def landing_speed_m_s(self) -> float:
        return self.flight_parameters.landing.speed_at(self.vehicle.home_and_rally.height_above_home_m)

    def limit(self, **limits: float) -> None:
        """Replace limits of the parameters (see `Body.limit`) until the mode changes."""
        self._set_in_flight.update(limits)
        self.body.limit(**limits)

    def restore_speed(self) -> None:
        """Return to the speed of the parameters."""
        self._set_in_flight.pop("speed_m_s", None)
        self.apply_limits()

    def parameters_changed(self, before: FlightParameters) -> None:
        """Apply changed parameters; a limit set in flight stays unless its parameter changed."""
        old, new = vars(before.limits), vars(self.flight_parameters.limits)
        self._set_in_flight = {
            name: value for name, value in self._set_in_flight.items() if old[name] == new[name]
        }
        self.apply_limits()

    def apply_limits(self) -> None:
        """Set the airframe's limits: from the parameters, then from commands in flight."""
        parameters = self.flight_parameters
        self.body.limit(**vars(parameters.limits))
        self.body.limit(**self._set_in_flight)
        self.body.set_wind(*parameters.wind)
        self.body.set_battery(capacity_mah=parameters.battery.capacity_mah, full_v=parameters.battery.full_v)

    def disarm(self) -> None:
        """Disarm after a landing, if the end of a landing disarms."""
        if self.vehicle.personality.arming.landing_disarms:
            self.vehicle.arming.stop()

    def next_run_s(self, now: float) -> float:
        """Return the latest time of the next run [s]; an event of the body requires an immediate run."""
        if self.behaviour is Behaviour.MISSION:
            waits = self.pilot.busy or self.mission.waiting or not self.flying
            busy = waits and (self.armed or self.mission.state is MissionState.ACTIVE)
        else:
            busy = self.armed and (self.manoeuvre is not None or self.behaviour in PILOTED)
        settling = not self.body.airborne and not self.landed(now)
        if not (busy or settling):
            return math.inf
        if self.pilot.landing and self.flying:
            # Half of the time, because the estimate of the height has errors.
            height_m = self.vehicle.home_and_rally.height_above_home_m
            steady_s = 0.5 * self.flight_parameters.landing.steady_s(height_m)
            return now + max(steady_s, RUN_INTERVAL_S)
        return now + RUN_INTERVAL_S

    # -- modes --------------------------------------------------------------------------------------------

    def reboot(self, mode: Mode) -> None:
        """Forget the earlier flight after a reboot, and enter the mode of the boot."""
        self.pilot.reboot()
        self.cleared_for_takeoff = False
        self.enter(mode)

    def enter(self, mode: Mode) -> None:
        """Leave the present behaviour and begin the behaviour of `mode`."""
        vehicle, returns = self.vehicle, mode.behaviour is Behaviour.RETURN and self.flying
        # The items depend on the previous behaviour.
        by_mission = vehicle.personality.mission.return_by_mission(vehicle) if returns else None
        if self.behaviour is Behaviour.MISSION and mode.behaviour is not Behaviour.MISSION:
            self.mission.stop()
        self.behaviour = mode.behaviour
        self.manoeuvre, self.guided_target_m = None, None
        self.pilot.forget()
        self.taking_off = False
        self._piloting.begin()
        self._set_in_flight.clear()
        self.apply_limits()
        self.body.face(None)
        if mode.behaviour is Behaviour.MISSION:
            self.mission.start_or_resume(restart=self.flight_parameters.mission.restarts)
        elif self.flying:
            self.body.stop()
            if mode.behaviour is Behaviour.LAND:
                self.manoeuvre = Landing(self, None)
            elif mode.behaviour is Behaviour.RETURN:
                self.manoeuvre = Return(self) if by_mission is None else ReturnByMission(self, *by_mission)
        self.begin_takeoff()

    def begin_takeoff(self) -> None:
        """Climb if the mode is a take-off mode and the vehicle is armed."""
        if self.behaviour is not Behaviour.TAKEOFF:
            self.takeoff_amsl_m = None
        elif self.armed:
            target_amsl_m = self.home().alt_amsl_m + self.flight_parameters.takeoff.height_m
            if self.takeoff_amsl_m is not None:
                target_amsl_m = max(self.takeoff_amsl_m, target_amsl_m)
            self.climb_to(max(target_amsl_m, self.body.alt_amsl_m))

    def run(self, now: float) -> None:
        """Run the control loop at `now` [s]."""
        if self.body.airborne:
            self.ground_since_s = math.inf
        elif math.isinf(self.ground_since_s) and self.ground_since_s > 0:
            self.ground_since_s = now
        if self.behaviour is Behaviour.MISSION:
            self.mission.update(now)
        elif self.armed:
            self._run_without_mission(now)
        by_mission = isinstance(self.manoeuvre, ReturnByMission) and self.manoeuvre.landing
        self.landing_now = self.behaviour is Behaviour.LAND or self.pilot.landing or by_mission

    def _run_without_mission(self, now: float) -> None:
        if self.behaviour in PILOTED:
            self._piloting.run(self.vehicle.remote.sticks(now))
        elif self.behaviour in (Behaviour.LAND, Behaviour.RETURN):
            done = self.manoeuvre.update(now) if self.manoeuvre is not None else self.landed(now)
            if done:
                self.disarm()
        elif self.behaviour is Behaviour.TAKEOFF and self.manoeuvre is not None:
            if self.manoeuvre.update(now):
                self.manoeuvre, self.taking_off = None, False
                self.vehicle.modes.taken_off()
        elif self.manoeuvre is not None and not self.taking_off:
            if self.manoeuvre.update(now):
                self.manoeuvre = None
        elif self.taking_off and self.body.airborne and self.body.reached:
            self.taking_off, self.manoeuvre = False, None

    # -- guided -------------------------------------------------------------------------------------------

    def go(
        self,
        target_m: tuple[float, float, float],
        pass_speed_m_s: float = 0.0,
        *,
        jerk_m_s3: float = math.inf,
    ) -> None:
        """Fly to a point (east, north, up [m]) and hold (a plane circles), or pass the point at a speed."""
        self.guided_target_m = target_m
        if self.body.plane and pass_speed_m_s == 0.0:
            self.body.loiter(*target_m)
        else:
            self.body.fly_to(*target_m, pass_speed_m_s, jerk_m_s3=jerk_m_s3)

    def takeoff_to(self, alt_amsl_m: float) -> bool:
        """Take off to an altitude [m above mean sea level]; return False if the vehicle cannot take off."""
        if not self.armed or self.body.airborne or alt_amsl_m <= self.body.alt_amsl_m:
            return False
        self.climb_to(alt_amsl_m)
        return True

    def climb_to(self, alt_amsl_m: float) -> None:
        """Climb to an altitude [m above mean sea level], from the ground or in the air."""
        self.cleared_for_takeoff = self.taking_off = True
        self.manoeuvre = Takeoff(self, alt_amsl_m)

    def limit_climb(self) -> None:
        """Climb slowly near the ground, until `apply_limits`. Called during a take-off."""
        takeoff = self.flight_parameters.takeoff
        if takeoff.speed_m_s is None:
            return
        climb_m_s = self._set_in_flight.get("climb_m_s", self.flight_parameters.limits.climb_m_s)
        if self.vehicle.home_and_rally.height_above_home_m < takeoff.slow_below_m:
            climb_m_s = min(climb_m_s, takeoff.speed_m_s)
        self.body.limit(climb_m_s=climb_m_s)

    def guided_go(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Fly to a position; a vehicle on the ground stays there."""
        self.taking_off = False
        if self.flying:
            self.manoeuvre = None
            self.go((*self.body.locate(lat_deg, lon_deg), alt_amsl_m))

    def pause(self) -> bool:
        """Pause for MAV_CMD_DO_PAUSE_CONTINUE; return False if no mission or guided mode is active."""
        if self.behaviour is Behaviour.MISSION:
            if not self.mission.pause():
                return False
        elif self.behaviour is not Behaviour.GUIDED:
            return False
        if self.flying:
            self.body.stop()
        return True

    def resume(self) -> bool:
        """Continue for MAV_CMD_DO_PAUSE_CONTINUE; return False if the mode or mission cannot continue."""
        if self.behaviour is Behaviour.MISSION and self.mission.paused:
            return self.mission.resume()
        if self.behaviour is Behaviour.GUIDED and self.guided_target_m is not None and self.body.airborne:
            self.go(self.guided_target_m)
        return self.behaviour in (Behaviour.MISSION, Behaviour.GUIDED)

    def change_speed(self, kind: int, speed_m_s: float) -> bool:
        """Apply DO_CHANGE_SPEED until the mode changes; return False for an invalid SPEED_TYPE or speed."""
        if not speed_m_s > 0:
            return False
        speed_m_s = min(speed_m_s, MAX_SPEED_M_S)
        if kind in (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED):
            self.limit(speed_m_s=speed_m_s)
        elif kind == mavlink.SPEED_TYPE_CLIMB_SPEED:
            self.limit(climb_m_s=speed_m_s)
        elif kind == mavlink.SPEED_TYPE_DESCENT_SPEED:
            self.limit(descent_m_s=speed_m_s)
        else:
            return False
        return True

    def turn(self, angle_deg: float, rate_deg_s: float, *, direction: int, relative: bool) -> float | None:
        """Turn to a heading or by an angle (`relative`); return the heading [rad].

        Return None, without a turn, for planes and on the ground.
        """
        if self.body.plane or not self.flying:
            return None
        heading_deg = angle_deg
        if relative:
            heading_deg = math.degrees(self.body.heading_rad) + angle_deg * (-1 if direction < 0 else 1)
        rate_rad_s = math.radians(rate_deg_s) if rate_deg_s > 0 else None
        heading_rad = math.radians(heading_deg % 360.0)
        self.body.face(heading_rad, rate_rad_s)
        return heading_rad

    def altitude_amsl_m(self, frame: int, z_m: float) -> float:
        """Return the altitude of an item [m above mean sea level]; the present altitude for NaN and inf.

        The ground is flat, so a terrain altitude is relative to the ground at the start.
        """
        if not math.isfinite(z_m):
            return self.body.alt_amsl_m
        z_m = max(-MAX_ALTITUDE_M, min(z_m, MAX_ALTITUDE_M))
        if frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT):
            return z_m
        if frame in (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT):
            return self.body.ground_amsl_m + z_m
        return self.home().alt_amsl_m + z_m


class ReturnByMission:
    """Return by mission: a climb in place to `minimum_amsl_m`, then the items; the last item lands.

    Every item has a position. The vehicle does not stop at items; a plane can circle to change its altitude.
    """

    def __init__(self, flight: FlightControl, items: Sequence[Item], minimum_amsl_m: float) -> None:
        self._flight = flight
        self._remaining_items = list(items)
        self._manoeuvre: Manoeuvre | None = None
        if flight.body.alt_amsl_m < minimum_amsl_m:
            east_m, north_m, _ = flight.body.position_m
            flight.body.loiter(east_m, north_m, minimum_amsl_m)
        else:
            self._begin_next()

    @property
    def landing(self) -> bool:
        return isinstance(self._manoeuvre, Landing)

    def _begin_next(self) -> None:
        flight, item = self._flight, self._remaining_items.pop(0)
        if item.command in LANDINGS:
            self._manoeuvre = Landing(flight, item.place_deg)
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
            following = self._remaining_items[0] if self._remaining_items else None
            self._manoeuvre = circle_to_altitude(flight, item, following)
        else:
            self._manoeuvre = None
            flight.body.fly_to(*target_of(flight, item), flight.flight_parameters.limits.speed_m_s)

    def update(self, now: float) -> bool:
        done = self._flight.body.reached if self._manoeuvre is None else self._manoeuvre.update(now)
        if not done or self.landing or not self._remaining_items:
            return done
        self._begin_next()
        return False
