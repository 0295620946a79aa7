"""How the airframes move: arrays over the whole fleet, one fixed time step, no Python per vehicle.

The model is kinematic and honest about limits: a copter follows the straight leg to its target by pursuing a
point ahead of it on the leg, its horizontal and vertical accelerations are bounded, and it brakes in time to
pass the target at the speed it was allowed there (0 to stop). Wind and aerodynamics are not modelled.
"""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from sim_vehicle.geodesy import Floats

GRAVITY_M_S2 = 9.80665
TERMINAL_FALL_M_S = 15.0
BRAKING_SHARE = 0.7  # of the acceleration limit is planned for braking, the rest corrects the path
POSITION_GAIN_HZ = 2.0  # speed per metre close to a stopping point, where the square root would chatter
YAW_RATE_RAD_S = np.deg2rad(90.0)


class Vertical(IntEnum):
    """What the vertical axis of a vehicle is told to do."""

    GROUNDED = 0  # motors off or idling, on the ground
    POSITION = 1  # go to the target's altitude and stay
    RATE = 2  # climb or sink at a given rate
    FALL = 3  # no thrust


class Dynamics:
    """State and set-points of n vehicles; axes are east, north, up in metres, `up` above mean sea level.

    Parameters
    ----------
    position_m: (n, 3) start positions [m]; the ground under a vehicle is flat at its start altitude.
    """

    def __init__(self, position_m: Floats) -> None:
        n = len(position_m)
        self.position_m = position_m.astype(np.float64).copy()  # (n, 3)
        self.velocity_m_s = np.zeros((n, 3))
        self.acceleration_m_s2 = np.zeros((n, 2))  # horizontal
        self.heading_rad = np.zeros(n)  # clockwise from north
        self.ground_m = self.position_m[:, 2].copy()
        self.airborne: npt.NDArray[np.bool_] = np.zeros(n, dtype=bool)
        self.touchdown_m_s = np.zeros(n)  # speed of the last contact, 0 once it has been read

        self.leg_start_m = self.position_m[:, :2].copy()
        self.target_m = self.position_m.copy()
        self.pass_speed_m_s = np.zeros(n)  # speed allowed at the target
        self.reached: npt.NDArray[np.bool_] = np.zeros(n, dtype=bool)  # latched until the next target
        self.vertical = np.full(n, Vertical.GROUNDED, dtype=np.int64)
        self.rate_m_s = np.zeros(n)  # for Vertical.RATE, up positive

        self.speed_m_s = np.full(n, 10.0)
        self.climb_m_s = np.full(n, 2.5)
        self.descent_m_s = np.full(n, 1.5)
        self.acceleration_limit_m_s2 = np.full(n, 2.5)
        self.vertical_acceleration_limit_m_s2 = np.full(n, 1.0)
        self.radius_m = np.full(n, 2.0)  # within which a target counts as reached

    def step(self, dt_s: float) -> None:
        """Advance every vehicle by `dt_s` [s]."""
        self._lift_off()
        vertical_error_m = self.target_m[:, 2] - self.position_m[:, 2]
        self._move_horizontally(dt_s, vertical_error_m)
        self._move_vertically(dt_s, vertical_error_m)
        self._touch_ground()
        self._note_reached()

    def _lift_off(self) -> None:
        climbs = ((self.vertical == Vertical.POSITION) & (self.target_m[:, 2] > self.ground_m + 0.1)) | (
            (self.vertical == Vertical.RATE) & (self.rate_m_s > 0)
        )
        self.airborne |= climbs

    def _move_horizontally(self, dt_s: float, vertical_error_m: Floats) -> None:
        position = self.position_m[:, :2]
        velocity = self.velocity_m_s[:, :2]
        to_target = self.target_m[:, :2] - position
        distance = np.hypot(to_target[:, 0], to_target[:, 1])

        leg = self.target_m[:, :2] - self.leg_start_m
        leg_length = np.maximum(np.hypot(leg[:, 0], leg[:, 1]), 1e-9)
        along = np.einsum("ij,ij->i", position - self.leg_start_m, leg) / leg_length
        ahead = np.clip(along + np.maximum(3.0, self.speed_m_s), 0.0, leg_length) / leg_length
        to_carrot = self.leg_start_m + leg * ahead[:, None] - position
        to_carrot /= np.maximum(np.hypot(to_carrot[:, 0], to_carrot[:, 1]), 1e-9)[:, None]

        limit = self.acceleration_limit_m_s2
        braking = np.sqrt(self.pass_speed_m_s**2 + 2 * BRAKING_SHARE * limit * distance)
        stopping = np.minimum(braking, POSITION_GAIN_HZ * distance)
        speed = np.minimum(self.speed_m_s, np.where(self.pass_speed_m_s > 0, braking, stopping))
        # Both axes arrive together, so that a leg is a straight line in space.
        climb_limit = np.where(vertical_error_m > 0, self.climb_m_s, self.descent_m_s)
        climb_time = np.abs(vertical_error_m) / np.maximum(climb_limit, 0.1)
        coupled = (self.vertical == Vertical.POSITION) & (climb_time > 1.0)
        speed = np.where(coupled, np.minimum(speed, distance / np.maximum(climb_time, 1e-9)), speed)

        change = to_carrot * speed[:, None] - velocity
        size = np.maximum(np.hypot(change[:, 0], change[:, 1]), 1e-12)
        change *= np.minimum(1.0, limit * dt_s / size)[:, None]
        change[self.vertical == Vertical.FALL] = 0.0
        change[~self.airborne] = 0.0
        self.acceleration_m_s2 = change / dt_s
        velocity += change
        position += velocity * dt_s
        self._turn(dt_s, leg, distance)

    def _turn(self, dt_s: float, leg: Floats, distance: Floats) -> None:
        turns = self.airborne & (distance > 2.0)
        wanted = np.arctan2(leg[:, 0], leg[:, 1])
        error = (wanted - self.heading_rad + np.pi) % (2 * np.pi) - np.pi
        step = np.clip(error, -YAW_RATE_RAD_S * dt_s, YAW_RATE_RAD_S * dt_s)
        self.heading_rad = np.where(turns, self.heading_rad + step, self.heading_rad) % (2 * np.pi)

    def _move_vertically(self, dt_s: float, error_m: Floats) -> None:
        limit = self.vertical_acceleration_limit_m_s2
        size = np.abs(error_m)
        to_position = np.minimum(np.sqrt(2 * BRAKING_SHARE * limit * size), POSITION_GAIN_HZ * size)
        to_position = np.clip(np.sign(error_m) * to_position, -self.descent_m_s, self.climb_m_s)
        wanted = np.where(self.vertical == Vertical.RATE, self.rate_m_s, to_position)
        change = np.clip(wanted - self.velocity_m_s[:, 2], -limit * dt_s, limit * dt_s)
        falls = self.vertical == Vertical.FALL
        change = np.where(falls, -GRAVITY_M_S2 * dt_s, change)
        climb = np.maximum(self.velocity_m_s[:, 2] + change, -TERMINAL_FALL_M_S)
        self.velocity_m_s[:, 2] = np.where(self.airborne, climb, 0.0)
        self.position_m[:, 2] += self.velocity_m_s[:, 2] * dt_s

    def _touch_ground(self) -> None:
        touches = self.airborne & (self.position_m[:, 2] <= self.ground_m) & (self.velocity_m_s[:, 2] <= 0)
        self.touchdown_m_s = np.where(touches, -self.velocity_m_s[:, 2], self.touchdown_m_s)
        self.airborne &= ~touches
        self.velocity_m_s[~self.airborne] = 0.0
        below = touches | ~self.airborne
        self.position_m[:, 2] = np.where(below, self.ground_m, self.position_m[:, 2])

    def _note_reached(self) -> None:
        error = self.target_m - self.position_m
        distance = np.sqrt(np.einsum("ij,ij->i", error, error))
        leg = self.target_m[:, :2] - self.leg_start_m
        past = np.einsum("ij,ij->i", error[:, :2], leg) <= 0
        # A target that is flown through may be missed by a little at speed: passing it close by counts.
        passed = past & (self.pass_speed_m_s > 0) & (distance <= 3 * self.radius_m)
        self.reached |= (distance <= self.radius_m) | passed
