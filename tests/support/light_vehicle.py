"""A copter in a few lines: a point with limited acceleration that flies missions and modes, without MAVLink.

Rates and accelerations are ArduCopter's defaults. The vehicle knows nothing of the agent's code but the plan
and the telemetry record.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import FlightPlan
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import Landed, ModeRole, VehicleState

Mode = Literal["idle", "takeoff", "mission", "hold", "setpoints", "pilot", "return", "land"]
Vector = tuple[float, float, float]

ACCELERATION_M_S2, BRAKES_M_S2, JERK_M_S3 = 2.5, 2.5, 1.0
CLIMB_M_S, DESCENT_M_S, LAND_M_S, LOW_M = 2.5, 1.5, 0.5, 10.0
LIFT_S = 4.0
VERTICAL_M_S2 = {True: 1.0, False: 3.0}
"""acceleration of climbs, by `stops_for_missions` [m/s²]: WPNAV_ACCEL_Z, and the lesser of PX4's limits"""
RAMP_M_S3 = 2.0 / math.pi * JERK_M_S3
"""mean growth of the acceleration from a stand"""
START_DELAY_S = {True: 1.9, False: 0.0}
"""delay of a start from a stand, by `stops_for_missions` [s]"""
LEG_SHARE = 0.95
"""greatest speed on a short leg, as a share of the greatest one between two stops with JERK_M_S3"""
VERTICAL_LEAD_S = 0.2
"""time by which the climb leads the speed over ground on a leg [s]"""
REACHED_M = 1.5
CORNER_M = 2.0
"""distance from its new leg that a vehicle reaches after a corner [m]: the default of WPNAV_RADIUS"""
POSITION_HZ, FASTER = 0.95, 1.2
"""speed toward a demanded position for each metre [1/s]; greatest speed by set-points, in `speed_m_s`"""
STOPS_AFTER_S, FALLS_AFTER_S = 3.0, 1.0
"""time without set-points after which ArduCopter stops, and PX4 leaves the mode for hold [s]"""
ROLES: dict[Mode, tuple[str, ModeRole]] = {
    "idle": ("GUIDED", "hold"),
    "takeoff": ("AUTO", "mission"),
    "mission": ("AUTO", "mission"),
    "hold": ("GUIDED", "hold"),
    "setpoints": ("OFFBOARD", "setpoints"),
    "pilot": ("LOITER", "other"),
    "return": ("RTL", "return"),
    "land": ("LAND", "land"),
}


@dataclass
class LightVehicle:
    frame: LocalFrame
    home_m: tuple[float, float]
    home_amsl_m: float
    speed_m_s: float
    return_height_m: float
    stops_for_missions: bool
    """True: brakes to a stop before it flies by a new mission, and has one mode for hold and for set-points,
    as ArduCopter; False: as PX4"""
    gust_m_s: float
    rng: random.Random
    at: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    velocity: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    mode: Mode = "idle"
    armed: bool = False
    plan: FlightPlan | None = None
    battery_percent: float = 90.0
    commanded_m_s: float | None = None
    """speed of the mission by a command; None: `speed_m_s`"""
    setpoint_age_s: float = math.inf
    _setpoint: SetPoint | None = None
    _fell: bool = False
    """True: holds only because its set-points have stopped"""
    _targets: list[Vector] = field(default_factory=list)
    _leg_from: Vector = (0.0, 0.0, 0.0)
    _braking: bool = False
    _lifts_off_in_s: float = 0.0
    _anchor: Vector | None = None
    _gust: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def __post_init__(self) -> None:
        self.at[:2] = self.home_m

    # --- commands

    def arm(self) -> None:
        self.armed, self._lifts_off_in_s = True, LIFT_S

    def disarm(self) -> None:
        self.armed, self.mode, self.velocity = False, "idle", [0.0, 0.0, 0.0]

    def take_off(self) -> None:
        self.mode = "takeoff"

    def set_mission(self, plan: FlightPlan) -> None:
        """Store a plan; in flight, fly it from here on."""
        self.plan = plan
        if self.armed and self.mode != "takeoff":
            moves = math.hypot(*self.velocity[:2]) > 1.0
            self._begin_mission(stop=self.stops_for_missions and moves)

    def hold(self) -> None:
        self.mode, self._anchor, self._braking, self._fell = "hold", None, True, False

    def take_over(self) -> None:
        """Stop and hover in a pilot's mode."""
        self.hold()
        self.mode = "pilot"

    def follow_setpoints(self) -> bool:
        """Leave the mission for the mode of set-points; return whether the vehicle has taken the mode."""
        if self.mode not in ("takeoff", "mission") or self.is_descending:
            return False
        if not self.stops_for_missions and self.setpoint_age_s > FALLS_AFTER_S:
            return False
        if self.setpoint_age_s > STOPS_AFTER_S:
            self._setpoint = None
        self.mode, self._anchor, self._braking = "setpoints", None, True
        return True

    def take_setpoint(self, setpoint: SetPoint) -> None:
        """Fly by a set-point, if the mode follows set-points."""
        self._setpoint, self.setpoint_age_s = setpoint, 0.0
        if self._fell and self.mode == "hold":
            self.mode = "setpoints"
        if self.stops_for_missions and self.mode == "hold" and self.armed:
            self.mode = "setpoints"

    def return_home(self) -> None:
        self.mode, self._braking = "return", True
        self._fly_to([(*self.home_m, max(self.at[2], self.return_height_m))])

    def land(self) -> None:
        self.mode, self._anchor, self._braking = "land", None, True

    @property
    def is_descending(self) -> bool:
        """True once the vehicle flies the landing of its mission, its return or its mode."""
        over_spot = self.mode in ("mission", "return") and not self._targets
        return self.armed and (over_spot or self.mode == "land")

    def passed(self, east_m: float, north_m: float) -> bool:
        """Return whether a point lies behind the vehicle."""
        ahead = (east_m - self.at[0]) * self.velocity[0] + (north_m - self.at[1]) * self.velocity[1]
        return ahead < 0.0

    def _begin_mission(self, *, stop: bool) -> None:
        assert self.plan is not None
        points = (*self.plan.track, self.plan.landing)
        if self.mode != "mission":
            self.commanded_m_s = None
        self.mode, self._braking, self._anchor = "mission", stop, None
        self._fly_to([(*self.frame.to_local(p.lat_deg, p.lon_deg), p.alt_rel_m) for p in points])

    def _fly_to(self, targets: Sequence[Vector]) -> None:
        self._targets, self._leg_from = list(targets), (self.at[0], self.at[1], self.at[2])

    # --- motion

    def step(self, dt_s: float) -> None:
        if not self.armed or self.mode == "idle":
            return
        self.setpoint_age_s += dt_s
        self._lifts_off_in_s -= dt_s
        if self._lifts_off_in_s > 0.0:
            return
        east, north, up = self._wanted_velocity()
        self._accelerate(east, north, up, dt_s)
        for axis in range(2):
            self._gust[axis] += -0.5 * self._gust[axis] * dt_s + self.gust_m_s * math.sqrt(
                dt_s
            ) * self.rng.gauss(0.0, 1.0)
        blown = self._gust if self.at[2] > 0.5 else [0.0, 0.0]
        self.at = [
            self.at[0] + (self.velocity[0] + blown[0]) * dt_s,
            self.at[1] + (self.velocity[1] + blown[1]) * dt_s,
            self.at[2] + self.velocity[2] * dt_s,
        ]
        if self.at[2] <= 0.0:
            self.at[2] = 0.0
            if self.is_descending:
                self.disarm()

    def _accelerate(self, east: float, north: float, up: float, dt_s: float) -> None:
        de, dn = east - self.velocity[0], north - self.velocity[1]
        most, flown_m_s = ACCELERATION_M_S2 * dt_s, math.hypot(*self.velocity[:2])
        is_limited = self.stops_for_missions and self.mode in ("mission", "return")
        if is_limited and math.hypot(east, north) > flown_m_s:
            most = min(most, (math.sqrt(2.0 * RAMP_M_S3 * flown_m_s) + RAMP_M_S3 * dt_s) * dt_s)
        share = min(most / max(math.hypot(de, dn), 1e-9), 1.0)
        self.velocity[0] += share * de
        self.velocity[1] += share * dn
        most = VERTICAL_M_S2[self.stops_for_missions] * dt_s
        self.velocity[2] += max(-most, min(most, up - self.velocity[2]))

    def _wanted_velocity(self) -> Vector:
        if self.mode == "takeoff":
            assert self.plan is not None
            if self.at[2] >= self.plan.takeoff_alt_m - 0.5:
                self._begin_mission(stop=False)
            return self._hover(self.home_m, self._climb_to(self.plan.takeoff_alt_m))
        if self.mode == "setpoints":
            if (wanted := self._by_setpoint()) is not None:
                self._anchor, self._braking = None, True
                return wanted
            if not self.stops_for_missions:
                self.hold()
                self._fell = True
        if self._braking:
            # ArduCopter holds where it stops; PX4 takes the height at which it no longer moves over ground.
            climbs = self.stops_for_missions and abs(self.velocity[2]) > 0.3
            if climbs or math.hypot(*self.velocity[:2]) > 0.3:
                return 0.0, 0.0, 0.0
            self._begin_from_stand()
        if self.mode in ("hold", "pilot", "setpoints"):
            assert self._anchor is not None
            return self._hover(self._anchor[:2], self._climb_to(self._anchor[2]))
        if self.mode == "land":
            assert self._anchor is not None
            return self._hover(self._anchor[:2], self._descent())
        while self._targets:
            wanted = self._towards(self._targets[0], self._targets[1:2])
            if wanted is not None:
                return wanted
            self._leg_from, last = self._targets.pop(0), len(self._targets) == 0
            if last:
                self._anchor = self._leg_from
        assert self._anchor is not None
        return self._hover(self._anchor[:2], self._descent())

    def _begin_from_stand(self) -> None:
        self._braking, self._anchor = False, (self.at[0], self.at[1], self.at[2])
        self._leg_from = self._anchor
        if self.mode == "return":  # it climbs where it has stopped
            self._targets.insert(0, (*self._anchor[:2], self._targets[0][2]))

    def _by_setpoint(self) -> Vector | None:
        """Return the velocity by the last set-point; None if it is too old."""
        setpoint, age_s = self._setpoint, self.setpoint_age_s
        if setpoint is None or age_s > (STOPS_AFTER_S if self.stops_for_missions else FALLS_AFTER_S):
            return None
        east, north, up = setpoint.velocity_m_s
        if setpoint.at is not None and setpoint.alt_amsl_m is not None:
            # ArduCopter moves its target between two set-points; PX4's target rests.
            moved_s = age_s if self.stops_for_missions else 0.0
            there = (*self.frame.to_local(*setpoint.at), setpoint.alt_amsl_m - self.home_amsl_m)
            east, north, up = (
                v + POSITION_HZ * (to + moved_s * v - here)
                for v, to, here in zip((east, north, up), there, self.at, strict=True)
            )
        share = min(FASTER * self.speed_m_s / max(math.hypot(east, north), 1e-9), 1.0)
        return share * east, share * north, max(-DESCENT_M_S, min(CLIMB_M_S, up))

    def _towards(self, target: Vector, after: Sequence[Vector]) -> Vector | None:
        """Return the velocity on the straight leg to a target; None once it is reached."""
        de, dn, du = (there - here for there, here in zip(target, self.at, strict=True))
        away_m = math.hypot(de, dn)
        if away_m < REACHED_M and abs(du) < 0.5 and (after or math.hypot(*self.velocity[:2]) < 0.5):
            return None
        if away_m < 0.5:
            return self._hover(target[:2], self._climb_to(target[2]))
        turn = self._turn_speed(target, after[0]) if after else 0.0
        to_turn_m = max(away_m - REACHED_M, 0.0) if after else away_m
        fastest = self._leg_m_s(self._leg_from, target)
        speed = min(fastest, math.sqrt(turn * turn + 2.0 * 0.7 * BRAKES_M_S2 * to_turn_m))
        if du:
            rate = CLIMB_M_S if du > 0.0 else DESCENT_M_S
            speed = min(speed, rate * away_m / abs(du))
        # The vehicle stays on the straight leg, also while it speeds up, and levels off in time.
        ahead = (de * self.velocity[0] + dn * self.velocity[1]) / away_m + ACCELERATION_M_S2 * VERTICAL_LEAD_S
        up = du * max(min(speed, ahead), 0.0) / away_m
        most_m_s = self._levelling_m_s(du)
        return de / away_m * speed, dn / away_m * speed, max(-most_m_s, min(most_m_s, up))

    def _levelling_m_s(self, away_m: float) -> float:
        """Return the greatest climb rate at a distance from a height, at which the vehicle levels off."""
        return math.sqrt(1.4 * VERTICAL_M_S2[self.stops_for_missions] * abs(away_m))

    @property
    def _cruise_m_s(self) -> float:
        return self.speed_m_s if self.commanded_m_s is None else self.commanded_m_s

    def _leg_m_s(self, begin: Vector, end: Vector) -> float:
        """Return the greatest speed on a leg: ArduCopter limits its jerk between the ends of a short leg."""
        leg_m = max(math.dist(begin[:2], end[:2]), CORNER_M)
        short_m_s = LEG_SHARE * math.cbrt(0.25 * JERK_M_S3 * leg_m**2)
        return min(self._cruise_m_s, short_m_s if self.stops_for_missions else math.inf)

    def _turn_speed(self, corner: Vector, after: Vector) -> float:
        a = (corner[0] - self._leg_from[0], corner[1] - self._leg_from[1])
        b = (after[0] - corner[0], after[1] - corner[1])
        turn_rad = abs(math.remainder(math.atan2(a[0], a[1]) - math.atan2(b[0], b[1]), math.tau))
        # While the velocity turns, the vehicle moves v² · turn² / 2a beside its new leg.
        turns_m_s = math.sqrt(2.0 * ACCELERATION_M_S2 * CORNER_M) / max(turn_rad, 1e-6)
        stops_m_s = math.sqrt(1.4 * BRAKES_M_S2 * math.dist(corner[:2], after[:2]))
        return min(self._leg_m_s(corner, after), turns_m_s, stops_m_s)

    def _hover(self, place: Sequence[float], up_m_s: float) -> Vector:
        e, n = (max(-2.0, min(2.0, there - here)) for there, here in zip(place, self.at[:2], strict=True))
        return e, n, up_m_s

    def _climb_to(self, up_m: float) -> float:
        away_m = up_m - self.at[2]
        rate_m_s = min(abs(away_m), self._levelling_m_s(away_m))
        return max(-DESCENT_M_S, min(CLIMB_M_S, math.copysign(rate_m_s, away_m)))

    def _descent(self) -> float:
        return -(DESCENT_M_S if self.at[2] > LOW_M else LAND_M_S)

    # --- telemetry

    def telemetry(self, boot_s: float) -> VehicleState:
        lat_deg, lon_deg = self.frame.to_geodetic(self.at[0], self.at[1])
        home_lat_deg, home_lon_deg = self.frame.to_geodetic(*self.home_m)
        is_guided = self.mode == "setpoints" and self.stops_for_missions
        mode, role = ROLES["hold" if is_guided else self.mode]
        east, north = (v + g for v, g in zip(self.velocity[:2], self._gust, strict=True))
        landed = Landed.LANDING if self.is_descending else Landed.IN_AIR
        if not self.armed or self.at[2] < 0.1:
            east = north = 0.0
            landed = Landed.ON_GROUND
        return VehicleState(
            time_boot_s=boot_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_rel_m=self.at[2],
            alt_amsl_m=self.at[2] + self.home_amsl_m,
            ground_speed_m_s=math.hypot(east, north),
            east_m_s=east,
            north_m_s=north,
            climb_m_s=self.velocity[2],
            mode=mode,
            mode_role=role,
            armed=self.armed,
            landed=landed,
            ready=True,
            gps_ok=True,
            battery_percent=round(self.battery_percent),
            brakes_m_s2=BRAKES_M_S2 if self.stops_for_missions else None,
            start_delay_s=START_DELAY_S[self.stops_for_missions],
            home_lat_deg=home_lat_deg,
            home_lon_deg=home_lon_deg,
            home_alt_amsl_m=self.home_amsl_m,
            heartbeat_s=boot_s,
            status_s=boot_s,
            position_s=boot_s,
        )
