"""Motion of the airframes: arrays over the whole fleet, no Python loop over vehicles.

`copter` and `plane` convert orders to velocities. This module has the common part: the effect of failures on
orders, take-off, touchdown, and arrival at targets. The ground below a vehicle has the altitude of its start.
"""

import numpy as np

from sim_vehicle.physics import copter, plane
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.motion import GRAVITY_M_S2, Bools, Motion, MotionOrder, Selection
from sim_vehicle.physics.wind import Wind

CRASH_M_S = 5.0  # vertical speed of a ground contact above which the airframe breaks
MOTOR_LOST_SINK_M_S = 8.0  # final sink rate of a copter with one lost motor
PASSING_RADII = 3.0  # tolerance of a target that a copter passes without a stop, in acceptance radii
ALTITUDE_REACHED_M = 5.0  # altitude tolerance of a circling plane
CIRCLE_REACHED_SHARE = 0.25  # greatest distance outside the circle that counts as reached, in radii


class Dynamics(Motion):
    """The motion of n vehicles that start at `position_m` (n, 3): east, north, up above mean sea level [m].

    Parameters
    ----------
    planes: (n,) True for fixed wings.
    wind: the wind at the vehicles.
    """

    def __init__(self, position_m: Floats, planes: Bools, wind: Wind) -> None:
        super().__init__(position_m, planes, wind)
        self._copters: Selection = np.flatnonzero(~planes) if np.count_nonzero(planes) else slice(None)
        self._planes: Selection = slice(None) if planes.all() else np.flatnonzero(planes)
        self._has_copters, self._has_planes = not planes.all(), bool(planes.any())
        self._derived: dict[str, Floats] = {}

    def step(self, dt_s: float) -> None:
        """Advance every vehicle by `dt_s` [s]."""
        self._derived.clear()
        self._restrict_orders()
        waits = self.armed & ~self.airborne
        if np.count_nonzero(waits):
            self.armed_s[waits] += dt_s
            self._lift_off()
        rolls = self._has_planes and bool(np.count_nonzero(plane.rolls(self)))
        if rolls or np.count_nonzero(self.airborne):
            self._move(dt_s, rolls=rolls)
        elif np.count_nonzero(self.acceleration):
            self.acceleration[:] = 0.0
        np.add(self.position, self.error, out=self.estimate)
        np.add(self.velocity, self.velocity_error, out=self.estimate_velocity)
        if np.count_nonzero(self.airborne & ~self.reached):
            self._update_reached()

    def _move(self, dt_s: float, *, rolls: bool) -> None:
        before = self.velocity.copy()
        if self._has_copters and (not self._has_planes or np.count_nonzero(self.airborne[self._copters])):
            copter.fly(self, self._copters, dt_s)
        if self._has_planes and (rolls or np.count_nonzero(self.airborne[self._planes])):
            plane.fly(self, self._planes, dt_s)
        self.position += self.velocity * dt_s
        touches = self.airborne & (self.position[2] <= self.ground_m) & (self.velocity[2] <= 0)
        if np.count_nonzero(touches):
            self._touch_ground(touches)
        np.subtract(self.velocity, before, out=self.acceleration)
        self.acceleration /= dt_s

    def _restrict_orders(self) -> None:
        """Restrict orders to the abilities of damaged airframes.

        A copter with an empty battery, or with two or more lost motors, falls. With one of four motors lost,
        the copter spins to stay level, and the opposite motor slows down. The other two motors do not carry
        the weight, so the copter sinks ever faster. Only a descent from a few metres ends without a crash.
        """
        self.any_motor_lost = bool(np.count_nonzero(self.motors_lost))
        if not (self.any_motor_lost or np.count_nonzero(self.exhausted)):
            self.effective_order, self.effective_rate_m_s = self.order, self.rate_m_s
            return
        steered = (
            self.airborne
            & ~self.planes
            & (self.order != MotionOrder.GROUNDED)
            & (self.order != MotionOrder.FALL)
        )
        sinks = steered & (self.motors_lost == 1)
        self.effective_order, self.effective_rate_m_s = self.order.copy(), self.rate_m_s.copy()
        self.effective_order[sinks] = MotionOrder.RATE
        self.effective_rate_m_s[sinks] = -MOTOR_LOST_SINK_M_S
        self.effective_order[steered & (self.exhausted | (self.motors_lost > 1))] = MotionOrder.FALL

    def _lift_off(self) -> None:
        lifts = copter.lifts_off(self)
        if self._has_planes:
            lifts |= plane.lifts_off(self)
        self.airborne |= lifts
        self.has_event |= lifts

    def _touch_ground(self, touches: Bools) -> None:
        speed = -self.velocity[2]
        self.touchdown_m_s[touches] = np.maximum(speed, 1e-3)[touches]
        breaks = touches & (speed > CRASH_M_S)
        self.crashed |= breaks
        self.airborne &= ~touches
        self.has_event |= touches
        self.position[2, touches] = self.ground_m[touches]
        self.velocity[2, touches] = 0.0
        self.velocity[:2, touches & (breaks | ~self.planes)] = 0.0
        self.attitude[:2, touches] = self.wanted_tilt_rad[:, touches] = 0.0
        self.attitude_rate[:, touches] = 0.0
        self.airspeed_m_s[touches & ~self.planes] = 0.0
        self.thrust[touches & ~self.planes] = 0.0
        # A landed copter stays on the ground until the next order to fly.
        self.order[touches & ~self.planes] = MotionOrder.GROUNDED

    def _update_reached(self) -> None:
        to_target = self.target - self.estimate
        horizontal = np.hypot(to_target[0], to_target[1])
        past = to_target[0] * self.leg_direction[0] + to_target[1] * self.leg_direction[1] <= 0
        distance = np.hypot(horizontal, to_target[2])
        passed = past & (self.pass_speed_m_s > 0) & (distance <= PASSING_RADII * self.acceptance_radius_m)
        reached = (distance <= self.acceptance_radius_m) | passed
        if self._has_planes:
            near = horizontal <= np.abs(self.circle_radius_m) * (1.0 + CIRCLE_REACHED_SHARE)
            circling = near & (np.abs(to_target[2]) <= ALTITUDE_REACHED_M)
            flown_by = (horizontal <= self.acceptance_radius_m) | past
            reached = np.where(self.planes, np.where(self.circle_radius_m != 0, circling, flown_by), reached)
        newly = reached & self.airborne & ~self.reached
        self.reached |= newly
        self.has_event |= newly

    # -- derived quantities -------------------------------------------------------------------------------

    @property
    def throttle(self) -> Floats:
        """Share of the full throttle, (n,)."""
        if "throttle" not in self._derived:
            self._derived["throttle"] = np.where(self.planes, self.thrust, copter.throttle(self, slice(None)))
        return self._derived["throttle"]

    @property
    def load_w(self) -> Floats:
        """Electrical power of the motors, (n,) [W]."""
        load = np.zeros(len(self.thrust))
        if self._has_copters:
            load[self._copters] = copter.load_w(self, self._copters)
        if self._has_planes:
            load[self._planes] = plane.load_w(self, self._planes)
        return load

    @property
    def rates_rad_s(self) -> Floats:
        """Body rates about the forward, right and down axes, (n, 3) [rad/s]."""
        if "rates" not in self._derived:
            roll, pitch, _ = self.attitude
            roll_rate, pitch_rate, yaw_rate = self.attitude_rate
            sin, cos = np.sin(roll), np.cos(roll)
            turn = yaw_rate * np.cos(pitch)
            rates = (
                roll_rate - yaw_rate * np.sin(pitch),
                pitch_rate * cos + turn * sin,
                turn * cos - pitch_rate * sin,
            )
            self._derived["rates"] = np.column_stack(rates)
        return self._derived["rates"]

    @property
    def specific_force_m_s2(self) -> Floats:
        """Specific force (accelerometer) forward, right, down, (n, 3) [m/s2]; at rest 0, 0, -g."""
        if "force" not in self._derived:
            roll, pitch, yaw = self.attitude
            east, north, up = self.acceleration
            down = -up - GRAVITY_M_S2
            ahead, aside = east * np.sin(yaw) + north * np.cos(yaw), east * np.cos(yaw) - north * np.sin(yaw)
            forward = ahead * np.cos(pitch) - down * np.sin(pitch)
            below = ahead * np.sin(pitch) + down * np.cos(pitch)
            right = aside * np.cos(roll) + below * np.sin(roll)
            below = below * np.cos(roll) - aside * np.sin(roll)
            self._derived["force"] = np.column_stack((forward, right, below))
        return self._derived["force"]
