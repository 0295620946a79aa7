"""What a vehicle does in each mode: the mission's pilot, return, landing, and sinking without a stick."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.mission import Item, Mission, MissionState
from sim_vehicle.params import Parameters
from sim_vehicle.personalities.base import Behaviour, Mode
from sim_vehicle.world import Body

LANDED_AFTER_S = 1.0  # on the ground for so long counts as landed
DROP_M_S = 8.0
SLOWEST_M_S, FASTEST_M_S = 0.1, 50.0
PILOT_ACCELERATION_M_S2 = 2.5


@dataclass(frozen=True, slots=True)
class Place:
    """A point: latitude, longitude [deg], altitude above mean sea level [m]."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class Landing:
    """Go over a place (or stay here) at this altitude, then down; done once on the ground for a second."""

    def __init__(self, flight: "Flight", place_deg: tuple[float, float] | None) -> None:
        self._flight = flight
        self._descends = place_deg is None
        if place_deg is None:
            flight.body.stop()
        else:
            flight.body.fly_to(*flight.body.locate(*place_deg), flight.body.alt_amsl_m)

    def update(self, now: float) -> bool:
        flight = self._flight
        if flight.body.airborne:
            self._descends = self._descends or flight.body.reached
            if self._descends:
                flight.body.move_vertically(-flight.landing_speed_m_s())
        else:
            flight.body.rest()
        return flight.landed(now)


class Return:
    """Return to launch: climb, fly home, wait, land."""

    def __init__(self, flight: "Flight") -> None:
        self._flight = flight
        body, home = flight.body, flight.home()
        east_m, north_m, up_m = body.position_m
        self._up_m = max(up_m, home.alt_amsl_m + flight.params["RTL_ALT"] / 100)
        body.limit(speed_m_s=flight.speed_m_s("RTL_SPEED", "WPNAV_SPEED"))
        body.fly_to(east_m, north_m, self._up_m)
        self._flies_home = False
        self._land_at_s: float | None = None
        self._landing: Landing | None = None

    def update(self, now: float) -> bool:
        flight = self._flight
        if self._landing is not None:
            return self._landing.update(now)
        if not flight.body.airborne:
            self._landing = Landing(flight, None)
        elif self._land_at_s is not None:
            if now >= self._land_at_s:
                self._landing = Landing(flight, None)
        elif flight.body.reached:
            if self._flies_home:
                self._land_at_s = now + flight.params["RTL_LOIT_TIME"] / 1000
            else:
                home = flight.home()
                flight.body.fly_to(*flight.body.locate(home.lat_deg, home.lon_deg), self._up_m)
                self._flies_home = True
        return False


class Flight:
    """Steers one body by mode and mission; reports by `say`, `send` and `disarm`."""

    def __init__(
        self,
        body: Body,
        params: Parameters,
        mission: Mission,
        *,
        home: Callable[[], Place],
        say: Callable[[int, str], None],
        send: Callable[[Any], None],
        disarm: Callable[[], None],
    ) -> None:
        self.body, self.params, self.mission, self.home = body, params, mission, home
        self._say, self._send, self._disarm = say, send, disarm
        self.armed = False
        self.cleared_for_takeoff = False  # by MISSION_START or a take-off command, until disarmed
        self.behaviour = Behaviour.DROP
        self.landing_now = False  # for EXTENDED_SYS_STATE
        self.taking_off = False
        self._ground_since_s = -math.inf
        self._machine: Landing | Return | None = None
        self._wait_until_s: float | None = None
        self.guided_target_m: tuple[float, float, float] | None = None

    # -- facts -------------------------------------------------------------------------------------------

    def landed(self, now: float) -> bool:
        return not self.body.airborne and now - self._ground_since_s >= LANDED_AFTER_S

    @property
    def ground_since_s(self) -> float:
        return self._ground_since_s

    def speed_m_s(self, *names: str) -> float:
        """The first of these parameters [cm/s] that is not 0, in m/s, within what the airframe can do."""
        value = next((self.params[name] for name in names if self.params[name] != 0), 0.0)
        return min(max(value / 100, SLOWEST_M_S), FASTEST_M_S)

    def landing_speed_m_s(self) -> float:
        above_home_m = self.body.alt_amsl_m - self.home().alt_amsl_m
        if above_home_m < self.params["LAND_ALT_LOW"] / 100:
            return self.speed_m_s("LAND_SPEED")
        return self.speed_m_s("LAND_SPEED_HIGH", "WPNAV_SPEED_DN")

    def apply_limits(self) -> None:
        """Set the airframe's limits from the parameters."""
        params = self.params
        self.body.limit(
            speed_m_s=self.speed_m_s("WPNAV_SPEED"),
            climb_m_s=self.speed_m_s("WPNAV_SPEED_UP"),
            descent_m_s=self.speed_m_s("WPNAV_SPEED_DN"),
            acceleration_m_s2=max(params["WPNAV_ACCEL"], 10.0) / 100,
            vertical_acceleration_m_s2=max(params["WPNAV_ACCEL_Z"], 10.0) / 100,
            radius_m=max(params["WPNAV_RADIUS"], 10.0) / 100,
        )
        self.body.set_battery(capacity_mah=params["BATT_CAPACITY"], full_v=params["SIM_BATT_VOLTAGE"])

    # -- modes -------------------------------------------------------------------------------------------

    def enter(self, mode: Mode) -> None:
        """Leave the present behaviour and begin that of `mode`."""
        if self.behaviour is Behaviour.MISSION and mode.behaviour is not Behaviour.MISSION:
            self.mission.stop()
        self.behaviour = mode.behaviour
        self._machine, self._wait_until_s, self.guided_target_m = None, None, None
        self.taking_off = False
        self.apply_limits()
        if mode.behaviour is Behaviour.MISSION:
            self.mission.start_or_resume(self, restart=self.params["MIS_RESTART"] == 1)
        elif self.body.airborne and self.armed:
            self.body.stop()
            if mode.behaviour is Behaviour.LAND:
                self._machine = Landing(self, None)
            elif mode.behaviour is Behaviour.RETURN:
                self._machine = Return(self)

    def run(self, now: float) -> None:
        """Control at `now` [s], some ten times a second."""
        if self.body.airborne:
            self._ground_since_s = math.inf
        elif math.isinf(self._ground_since_s) and self._ground_since_s > 0:
            self._ground_since_s = now
        if self.behaviour is Behaviour.MISSION:
            self.mission.update(self, now)
        elif self.armed:
            self._run_alone(now)
        self.landing_now = isinstance(self._machine, Landing) or self.behaviour is Behaviour.LAND

    def _run_alone(self, now: float) -> None:
        if self.behaviour in (Behaviour.SINK, Behaviour.DROP):
            self._sink()
        elif self.behaviour in (Behaviour.LAND, Behaviour.RETURN):
            done = self._machine.update(now) if self._machine is not None else self.landed(now)
            if done:
                self._disarm()
        elif self.taking_off and self.body.airborne and self.body.reached:
            self.taking_off = False

    def _sink(self) -> None:
        if not self.body.airborne:
            self.body.rest()
            return
        self.body.limit(vertical_acceleration_m_s2=PILOT_ACCELERATION_M_S2)
        pilot_m_s = self.speed_m_s("PILOT_SPEED_DN", "PILOT_SPEED_UP")
        self.body.move_vertically(-(pilot_m_s if self.behaviour is Behaviour.SINK else DROP_M_S))

    # -- guided ------------------------------------------------------------------------------------------

    def guided_takeoff(self, height_m: float) -> bool:
        """Climb to a height above home; only from the ground, armed, and upward."""
        up_m = self.home().alt_amsl_m + height_m
        if not self.armed or self.body.airborne or up_m <= self.body.alt_amsl_m:
            return False
        east_m, north_m, _ = self.body.position_m
        self.cleared_for_takeoff = self.taking_off = True
        self._fly((east_m, north_m, up_m))
        return True

    def guided_go(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Fly to a place, if in the air; on the ground nothing happens."""
        self.taking_off = False
        if self.armed and self.body.airborne:
            self._fly((*self.body.locate(lat_deg, lon_deg), alt_amsl_m))

    def _fly(self, target_m: tuple[float, float, float], pass_speed_m_s: float = 0.0) -> None:
        self.guided_target_m = target_m
        self.body.fly_to(*target_m, pass_speed_m_s)

    def pause(self) -> bool:
        """MAV_CMD_DO_PAUSE_CONTINUE, pause; False where it makes no sense."""
        if self.behaviour is Behaviour.MISSION:
            if self.mission.state is not MissionState.ACTIVE or self.mission.count < 2:
                return False
            self.mission.paused = True
        elif self.behaviour is not Behaviour.GUIDED:
            return False
        if self.body.airborne and self.armed:
            self.body.stop()
        return True

    def resume(self) -> bool:
        """MAV_CMD_DO_PAUSE_CONTINUE, continue."""
        if self.behaviour is Behaviour.MISSION and self.mission.paused:
            self.mission.paused = False
            return self.mission.restart_current(self)
        if self.behaviour is Behaviour.GUIDED and self.guided_target_m is not None and self.body.airborne:
            self._fly(self.guided_target_m)
        return self.behaviour in (Behaviour.MISSION, Behaviour.GUIDED)

    def change_speed(self, kind: int, speed_m_s: float) -> bool:
        """DO_CHANGE_SPEED: kind is SPEED_TYPE; until the mode changes."""
        if not speed_m_s > 0:
            return False
        speed_m_s = min(speed_m_s, FASTEST_M_S)
        if kind in (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED):
            self.body.limit(speed_m_s=speed_m_s)
        elif kind == mavlink.SPEED_TYPE_CLIMB_SPEED:
            self.body.limit(climb_m_s=speed_m_s)
        elif kind == mavlink.SPEED_TYPE_DESCENT_SPEED:
            self.body.limit(descent_m_s=speed_m_s)
        else:
            return False
        return True

    # -- the mission's pilot -----------------------------------------------------------------------------

    def altitude_amsl_m(self, frame: int, z_m: float) -> float:
        """Altitude of an item [m above mean sea level]; the ground is flat, so terrain is the start's."""
        if frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT):
            return z_m
        if frame in (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT):
            return self.body.ground_amsl_m + z_m
        return self.home().alt_amsl_m + z_m

    def _item_target_m(self, item: Item) -> tuple[float, float, float]:
        east_m, north_m, up_m = self.body.position_m
        if item.place_deg is not None:
            east_m, north_m = self.body.locate(*item.place_deg)
        return east_m, north_m, self.altitude_amsl_m(item.frame, item.z) if item.z != 0 else up_m

    def start_navigation(self, item: Item, following: Item | None) -> None:
        self._machine, self._wait_until_s = None, None
        self.taking_off = item.command == mavlink.MAV_CMD_NAV_TAKEOFF
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            east_m, north_m, up_m = self.body.position_m
            target_m = (east_m, north_m, max(self.altitude_amsl_m(item.frame, item.z), up_m))
        else:
            target_m = self._item_target_m(item)
        self.guided_target_m = target_m
        if not (self.armed and self.body.airborne):
            return
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            self._machine = Landing(self, item.place_deg)
        elif item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._machine = Return(self)
        else:
            self.body.fly_to(*target_m, self._pass_speed_m_s(item, target_m, following))

    def _pass_speed_m_s(
        self, item: Item, target_m: tuple[float, float, float], following: Item | None
    ) -> float:
        """Speed at which a waypoint may be flown through; 0 where the vehicle is to stop."""
        through = item.command == mavlink.MAV_CMD_NAV_WAYPOINT and item.param1 == 0
        if not through or following is None or following.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return 0.0
        here_m, next_m = self.body.position_m, self._item_target_m(following)
        inbound = math.atan2(target_m[0] - here_m[0], target_m[1] - here_m[1])
        outbound = math.atan2(next_m[0] - target_m[0], next_m[1] - target_m[1])
        turn_rad = abs(math.remainder(outbound - inbound, 2 * math.pi))
        return self.body.corner_speed_m_s(turn_rad)

    def navigation_done(self, now: float) -> bool:
        item = self.mission.flown
        if item is None:
            return False
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return self._takeoff_done()
        if self._machine is not None or item.command in (
            mavlink.MAV_CMD_NAV_LAND,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        ):
            done = self._machine.update(now) if self._machine is not None else self.landed(now)
            if done and self.armed:
                # Landing ends the mission: disarming resets it, and the item is not reported as reached.
                self.mission.state = MissionState.COMPLETE
                self._disarm()
                return False
            return done
        return self._waypoint_done(item, now)

    def _takeoff_done(self) -> bool:
        if not (self.armed and self.cleared_for_takeoff) or self.guided_target_m is None:
            return False
        if not self.body.airborne:
            self.body.fly_to(*self.guided_target_m)
            return False
        return self.body.reached

    def _waypoint_done(self, item: Item, now: float) -> bool:
        if self.body.airborne:
            reached = self.body.reached
        else:  # an unarmed vehicle does not move, but its mission does
            reached = math.dist(self.guided_target_m or (0, 0, 0), self.body.position_m) <= (
                self.params["WPNAV_RADIUS"] / 100
            )
        if not reached or item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return False
        if self._wait_until_s is None:
            self._wait_until_s = now + item.param1
        return now >= self._wait_until_s

    def do(self, item: Item) -> None:
        if item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            self.change_speed(int(item.param1), item.param2)

    def mission_item_reached(self, index: int, item: Item) -> None:
        self._send(mavlink.MAVLink_mission_item_reached_message(index))
        if item.command in (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LOITER_TIME):
            self._say(mavlink.MAV_SEVERITY_INFO, f"Reached command #{index}")

    def mission_ended(self) -> None:
        self._machine = None
        if self.body.airborne and self.armed:
            self.body.stop()
        elif self.armed:
            self._disarm()
