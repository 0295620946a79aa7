"""One vehicle's airframe, as its autopilot commands it."""

import math
from functools import partial

from sim_vehicle.physics.body_state import BodyState
from sim_vehicle.physics.copter import HOVER_THROTTLE
from sim_vehicle.physics.following import follow
from sim_vehicle.physics.motion import NO_JERK_LIMIT_M_S3, MotionOrder
from sim_vehicle.physics.world import World

MIN_LEG_M = 2.0  # shortest leg that sets a copter's heading
RADIANS = math.radians(1.0)  # in a degree
# limit -> its array in `Motion`, the array's units in a unit of the limit, and the lowest and the highest
# limit that the equations of motion support
LIMITS = {
    "speed_m_s": ("speed_m_s", 1.0, 0.05, 100.0),  # plane: airspeed
    "climb_m_s": ("climb_m_s", 1.0, 0.05, 100.0),
    "descent_m_s": ("descent_m_s", 1.0, 0.05, 100.0),
    "acceleration_m_s2": ("acceleration_limit_m_s2", 1.0, 0.05, 30.0),
    "autopilot_jerk_m_s3": ("autopilot_jerk_m_s3", 1.0, 0.05, NO_JERK_LIMIT_M_S3),
    "vertical_acceleration_m_s2": ("vertical_acceleration_limit_m_s2", 1.0, 0.05, 30.0),
    "acceptance_radius_m": ("acceptance_radius_m", 1.0, 0.05, 1e4),
    "yaw_rate_deg_s": ("yaw_rate_max_rad_s", RADIANS, 1.0, 400.0),
    "lift_off_s": ("lift_off_s", 1.0, 0.0, 60.0),
    "airspeed_min_m_s": ("airspeed_min_m_s", 1.0, 0.05, 100.0),
    "airspeed_max_m_s": ("airspeed_max_m_s", 1.0, 0.05, 100.0),
    "loiter_radius_m": ("loiter_radius_m", 1.0, -1e4, 1e4),
    "bank_limit_deg": ("bank_limit_rad", RADIANS, 5.0, 75.0),
    "stall_m_s": ("stall_m_s", 1.0, 2.0, 50.0),
}
MAX_WIND_M_S = 100.0
MEAN_JERK_SHARE = 2.0 / math.pi  # mean jerk from a stand, as a share of the greatest one (`SCurve`: a cosine)
LEG_SHARE = 0.95  # highest speed on a blended leg, as a share of the highest one between two stops
CAPACITY_RANGE_MAH, VOLTAGE_RANGE_V = (1.0, 1e6), (1.0, 1000.0)


def _finite(*numbers: float) -> bool:
    return all(map(math.isfinite, numbers))


class Body(BodyState):
    """One vehicle's state and its commands."""

    def __init__(self, world: World, index: int) -> None:
        super().__init__(world, index)
        self.follow = partial(follow, world.dynamics, index)

    def arm(self, armed: bool) -> None:
        """Start or stop the motors; stopped in the air, a copter falls and a plane glides."""
        i, motion = self._index, self._motion
        motion.armed[i] = armed and not motion.crashed[i]
        motion.armed_s[i] *= armed
        if not armed:
            motion.order[i] = MotionOrder.FALL if self.airborne else MotionOrder.GROUNDED
        elif self.airborne and motion.order[i] == MotionOrder.FALL:
            self.stop()

    def rest(self) -> None:
        """Idle on the ground."""
        self._motion.order[self._index] = MotionOrder.GROUNDED

    def fly_to(
        self,
        east_m: float,
        north_m: float,
        up_m: float,
        pass_speed_m_s: float = 0.0,
        *,
        jerk_m_s3: float = math.inf,
    ) -> None:
        """Fly a straight leg from the previous target (if reached) or from the present position.

        A copter stops at the end unless `pass_speed_m_s` [m/s] is positive; a plane flies past the end.
        `jerk_m_s3` limits a copter's speed on a short leg, and its acceleration from a stand.
        """
        i, motion = self._index, self._motion
        if not _finite(east_m, north_m, up_m):
            return
        continues = (
            bool(motion.reached[i])
            and motion.order[i] == MotionOrder.POSITION
            and motion.circle_radius_m[i] == 0
        )
        start = motion.target if continues else motion.estimate
        self._set_leg(float(start[0, i]), float(start[1, i]), east_m, north_m)
        motion.target[:, i] = (east_m, north_m, up_m)
        motion.pass_speed_m_s[i] = pass_speed_m_s
        motion.leg_speed_m_s[i] = self.leg_speed_m_s(float(motion.leg_length_m[i]), jerk_m_s3)
        motion.circle_radius_m[i] = 0.0
        start_jerk_m_s3 = min(MEAN_JERK_SHARE * jerk_m_s3, float(motion.autopilot_jerk_m_s3[i]))
        self._begin(MotionOrder.POSITION, start_jerk_m_s3)

    def loiter(self, east_m: float, north_m: float, up_m: float, radius_m: float | None = None) -> None:
        """Circle around a point, clockwise if `radius_m` is positive; None or 0: the default radius."""
        i, motion = self._index, self._motion
        if not _finite(east_m, north_m, up_m):
            return
        if not radius_m or not math.isfinite(radius_m):
            radius_m = float(motion.loiter_radius_m[i])
        motion.circle_radius_m[i] = math.copysign(max(abs(radius_m), 1.0), radius_m)
        motion.target[:, i] = (east_m, north_m, up_m)
        self._begin(MotionOrder.POSITION)

    def land_at(self, east_m: float, north_m: float) -> None:
        """Land a plane: descend on a straight slope from here to a point on the ground."""
        if not _finite(east_m, north_m):
            return
        i, motion = self._index, self._motion
        here_east_m, here_north_m, up_m = self.position_m
        self._set_leg(here_east_m, here_north_m, east_m, north_m)
        motion.target[:, i] = (east_m, north_m, self.ground_amsl_m)
        motion.slope[i] = (up_m - self.ground_amsl_m) / max(float(motion.leg_length_m[i]), 1.0)
        motion.circle_radius_m[i] = 0.0
        self._begin(MotionOrder.GLIDE)

    def stop(self) -> None:
        """Brake, then hold position and altitude; a plane circles around its present position."""
        i, motion = self._index, self._motion
        east, north, up = self.position_m
        velocity = self.velocity_m_s
        climb_s = abs(velocity[2]) / (2 * float(motion.vertical_acceleration_limit_m_s2[i]))
        up += velocity[2] * climb_s
        if self.plane:
            self.loiter(east, north, up)
            return
        braking_s = math.hypot(*velocity[:2]) / (2 * float(motion.acceleration_limit_m_s2[i]))
        self.fly_to(east + velocity[0] * braking_s, north + velocity[1] * braking_s, up)

    def move(
        self,
        velocity_m_s: tuple[float, float, float],
        *,
        yaw_rad: float | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> None:
        """Move at a velocity east, north, up [m/s] within the limits; a plane flies in that direction."""
        i, motion = self._index, self._motion
        east, north, up = velocity_m_s
        speed = math.hypot(east, north)
        if not _finite(speed, up):
            return
        scale = min(1.0, float(motion.speed_m_s[i]) / max(speed, 1e-9))
        motion.wanted_velocity[:, i] = (east * scale, north * scale)
        motion.rate_m_s[i] = max(-float(motion.descent_m_s[i]), min(up, float(motion.climb_m_s[i])))
        here = self.position_m
        motion.target[:, i] = here
        if speed > 0:
            self._set_leg(here[0], here[1], here[0] + east / speed, here[1] + north / speed)
        motion.circle_radius_m[i] = 0.0
        self._begin(MotionOrder.VELOCITY)
        self.turn(yaw_rad, yaw_rate_rad_s)

    def tilt(
        self,
        acceleration_m_s2: tuple[float, float],
        climb_m_s: float,
        *,
        yaw_rad: float | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> None:
        """Tilt a copter to an acceleration by thrust east, north [m/s2]; drag is not compensated."""
        i, motion = self._index, self._motion
        if not _finite(*acceleration_m_s2, climb_m_s):
            return
        motion.wanted_thrust_acceleration[:, i] = acceleration_m_s2
        motion.rate_m_s[i] = max(-float(motion.descent_m_s[i]), min(climb_m_s, float(motion.climb_m_s[i])))
        motion.target[:, i], motion.circle_radius_m[i] = self.position_m, 0.0
        self._begin(MotionOrder.TILT)
        self.turn(yaw_rad, yaw_rate_rad_s)

    def thrust(
        self, acceleration_m_s2: tuple[float, float], lift: float, *, yaw_rate_rad_s: float | None = None
    ) -> None:
        """Tilt a copter as `tilt` does, with a lift as a multiple of the weight."""
        i, motion = self._index, self._motion
        self.tilt(acceleration_m_s2, lift - 1.0, yaw_rate_rad_s=yaw_rate_rad_s)
        motion.wanted_lift[i] = min(max(lift, 0.0), 1.0 / HOVER_THROTTLE)
        motion.order[i] = MotionOrder.THRUST

    def bank(
        self, bank_rad: float, *, climb_m_s: float = 0.0, pitch_rad: float = 0.0, throttle: float = math.nan
    ) -> None:
        """Bank a plane, and climb at a rate; with a throttle in [0, 1] climb at an angle, at any airspeed."""
        i, motion = self._index, self._motion
        motion.wanted_bank_rad[i], motion.wanted_pitch_rad[i] = bank_rad, pitch_rad
        motion.wanted_throttle[i], motion.rate_m_s[i] = throttle, climb_m_s
        motion.target[:, i], motion.circle_radius_m[i] = self.position_m, 0.0
        self._begin(MotionOrder.STICKS)

    def move_vertically(self, rate_m_s: float) -> None:
        """Climb (positive rate) or sink over the target; a plane follows its leg or circle."""
        if _finite(rate_m_s):
            self._motion.order[self._index] = MotionOrder.RATE
            self._motion.rate_m_s[self._index] = rate_m_s

    def face(self, heading_rad: float | None, rate_rad_s: float | None = None) -> None:
        """Turn a copter to a heading, not faster than `rate_rad_s`; heading None: along its legs."""
        i, motion = self._index, self._motion
        motion.wanted_yaw_rate_rad_s[i] = 0.0
        motion.yaw_rate_limit_rad_s[i] = math.inf
        motion.heading_is_commanded[i] = heading_rad is not None and math.isfinite(heading_rad)
        if motion.heading_is_commanded[i]:
            motion.wanted_heading_rad[i] = heading_rad
            if rate_rad_s is not None and rate_rad_s > 0:
                motion.yaw_rate_limit_rad_s[i] = rate_rad_s
        elif motion.order[i] == MotionOrder.POSITION and not motion.reached[i]:
            self._face_along_leg()

    def limit(self, **limits: float) -> None:
        """Set the given `LIMITS` within the supported range; ignore NaN and infinity."""
        for name, value in limits.items():
            array, scale, lowest, highest = LIMITS[name]
            if math.isfinite(value):
                getattr(self._motion, array)[self._index] = max(lowest, min(value, highest)) * scale

    def corner_speed_m_s(self, turn_rad: float) -> float:
        """Return the highest speed at which a corner stays within the acceptance radius [m/s]."""
        i, motion = self._index, self._motion
        speed = float(motion.speed_m_s[i])
        widening = 1.0 / max(math.cos(min(turn_rad, math.pi - 1e-6) / 2), 1e-6) - 1.0
        if widening < 1e-6:
            return speed
        turn_radius_m = float(motion.acceptance_radius_m[i]) / widening
        return min(speed, math.sqrt(float(motion.acceleration_limit_m_s2[i]) * turn_radius_m))

    def leg_speed_m_s(self, leg_m: float, jerk_m_s3: float) -> float:
        """Return the highest speed on a leg of a mission [m/s].

        ArduCopter plans each leg from rest to rest, with limited jerk and acceleration, and blends it with
        its neighbours (`SCurve`): so a short leg is slow, even straight on. Infinite jerk: without a limit.
        """
        if jerk_m_s3 == math.inf:
            return math.inf
        i, motion = self._index, self._motion
        leg_m = max(leg_m, float(motion.acceptance_radius_m[i]))
        by_jerk_m_s = LEG_SHARE * math.cbrt(0.25 * jerk_m_s3 * leg_m**2)
        return min(by_jerk_m_s, math.sqrt(float(motion.acceleration_limit_m_s2[i]) * leg_m))

    def set_gps_fix(self, fix_type: int) -> None:
        """Set the best and the present GPS_FIX_TYPE of the receiver."""
        gps = self._world.gps
        gps.best_fix_type[self._index] = gps.fix_type[self._index] = fix_type

    def set_battery(self, *, capacity_mah: float, full_v: float) -> None:
        """Set capacity and full resting voltage of the battery within the supported range.

        A capacity of 0 or less leaves the capacity unchanged.
        """
        i, batteries = self._index, self._world.batteries
        if capacity_mah > 0:
            batteries.capacity_mah[i] = max(CAPACITY_RANGE_MAH[0], min(capacity_mah, CAPACITY_RANGE_MAH[1]))
        batteries.full_v[i] = max(VOLTAGE_RANGE_V[0], min(full_v, VOLTAGE_RANGE_V[1]))

    def set_wind(self, speed_m_s: float | None, from_deg: float) -> None:
        """Set the steady wind at this vehicle, at most MAX_WIND_M_S; speed None: the scenario's wind.

        from_deg: direction from which the wind blows.
        """
        if speed_m_s is not None:
            speed_m_s = min(speed_m_s, MAX_WIND_M_S)
        self._world.wind.set_steady(self._index, speed_m_s, from_deg)

    # -- internals ----------------------------------------------------------------------------------------

    def _begin(self, order: int, start_jerk_m_s3: float = NO_JERK_LIMIT_M_S3) -> None:
        self._motion.order[self._index] = order
        self._motion.reached[self._index] = False
        self._motion.start_jerk_m_s3[self._index] = start_jerk_m_s3
        if order == MotionOrder.POSITION and not self._motion.heading_is_commanded[self._index]:
            self._face_along_leg()

    def _set_leg(self, start_east_m: float, start_north_m: float, east_m: float, north_m: float) -> None:
        i, motion = self._index, self._motion
        leg_east_m, leg_north_m = east_m - start_east_m, north_m - start_north_m
        length_m = math.hypot(leg_east_m, leg_north_m)
        motion.leg_start[:, i] = (start_east_m, start_north_m)
        motion.leg_length_m[i] = length_m
        if length_m > 1e-6:
            motion.leg_direction[:, i] = (leg_east_m / length_m, leg_north_m / length_m)
            motion.leg_heading_rad[i] = math.atan2(leg_east_m, leg_north_m)
        else:
            motion.leg_direction[:, i] = 0.0
            motion.leg_heading_rad[i] = motion.attitude[2, i]

    def turn(self, yaw_rad: float | None, yaw_rate_rad_s: float | None) -> None:
        """Turn a copter to a heading, else at a rate, while it follows its order."""
        i, motion = self._index, self._motion
        if yaw_rad is not None:
            self.face(yaw_rad)
        elif yaw_rate_rad_s is not None and _finite(yaw_rate_rad_s):
            self.face(self.heading_rad)
            limit = float(motion.yaw_rate_max_rad_s[i])
            motion.wanted_yaw_rate_rad_s[i] = max(-limit, min(yaw_rate_rad_s, limit))

    def _face_along_leg(self) -> None:
        i, motion = self._index, self._motion
        if motion.leg_length_m[i] > MIN_LEG_M:
            motion.wanted_heading_rad[i] = motion.leg_heading_rad[i]
        else:
            motion.wanted_heading_rad[i] = motion.attitude[2, i]
