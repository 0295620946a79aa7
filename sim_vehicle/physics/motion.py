"""State of motion of the whole fleet: positions, limits and orders.

Arrays (3, n) have rows east, north, up, so that a step uses contiguous memory; up of a position is above mean
sea level. `position_m` and the other transposed names with a unit are views (n, 3). A vehicle navigates by
its estimate, which is the truth plus the error.
"""

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.wind import Wind

Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]
Selection = slice | npt.NDArray[np.intp]  # vehicles: all, or some by index

GRAVITY_M_S2 = 9.80665
MAX_YAW_RATE_RAD_S = np.deg2rad(90.0)
FULL_TURN_RAD = 2.0 * np.pi
NO_JERK_LIMIT_M_S3 = 1e6  # finite, so that its products with 0 are numbers


class MotionOrder:
    """Orders of an autopilot to its airframe: plain numbers, because NumPy compares enum members slowly."""

    GROUNDED = 0  # motors off or idling, on the ground
    POSITION = 1  # fly to the target: a copter stops or passes; a plane flies past or circles around
    RATE = 2  # climb or sink at a rate: a copter over the target, a plane along its leg or circle
    VELOCITY = 3  # move at a velocity; a plane keeps its own airspeed, in this direction
    GLIDE = 4  # a plane: descend along the leg, to touch the ground at the target
    FALL = 5  # no thrust
    TILT = 6  # a copter: accelerate by its tilt, climb at a rate
    THRUST = 7  # a copter: accelerate by its tilt and by the lift of its motors
    STICKS = 8  # a plane: bank; climb at a rate, or by pitch and throttle
    FOLLOW = 9  # a copter: follow a set-point of position, velocity and acceleration (`following`)


class FollowedSetpoints:
    """Set-points of MotionOrder.FOLLOW, and how a copter follows them (`following`).

    Arrays (3, n) have rows east, north, up; nan: this axis has no position, no velocity. Arrays (2, n) have
    rows horizontal, vertical.
    """

    def __init__(self, n: int) -> None:
        self.position_m = np.full((3, n), np.nan)
        self.velocity_m_s = np.full((3, n), np.nan)
        self.acceleration_m_s2 = np.zeros((3, n))
        self.wanted_velocity_m_s = np.zeros((3, n))  # of the position control
        self.wanted_acceleration_m_s2 = np.zeros((3, n))  # within the jerk limit
        self.position_hz, self.velocity_hz = np.ones((2, n)), np.ones((2, n))
        self.acceleration_limit_m_s2, self.braking_m_s2 = np.ones((2, n)), np.ones((2, n))
        self.jerk_limit_m_s3, self.lag_s = np.ones((2, n)), np.zeros((2, n))
        self.speed_m_s, self.climb_m_s, self.descent_m_s = np.ones(n), np.ones(n), np.ones(n)
        self.limits_total: Bools = np.zeros(n, dtype=bool)
        self.target_moves: Bools = np.zeros(n, dtype=bool)
        self.faces_course: Bools = np.zeros(n, dtype=bool)
        self.controls: list[object] = [None] * n  # origin of the gains


class Motion:
    """State, limits and orders of n vehicles that start at `position_m` (n, 3); planes: (n,)."""

    def __init__(self, position_m: Floats, planes: Bools, wind: Wind) -> None:
        n = len(position_m)
        self.wind = wind
        self.planes = planes
        self.has_event: Bools = np.zeros(n, dtype=bool)  # for the autopilot
        self._begin_state(position_m)
        self._begin_orders(n)
        self.follow = FollowedSetpoints(n)
        self._begin_limits(n)
        # Orders in force in the present step, after the effect of failures.
        self.effective_order = self.order
        self.effective_rate_m_s = self.rate_m_s

    def _begin_state(self, position_m: Floats) -> None:
        n = len(position_m)
        self.position = np.array(position_m.T, dtype=np.float64, order="C")
        self.velocity = np.zeros((3, n))
        self.acceleration = np.zeros((3, n))
        self.attitude = np.zeros((3, n))  # roll, pitch, yaw; yaw clockwise from north, in (-pi, pi]
        self.attitude_rate = np.zeros((3, n))  # rates of roll, pitch, yaw
        self.airspeed_m_s = np.zeros(n)
        self.thrust = np.zeros(n)  # copter: thrust divided by weight; plane: share of the full power
        self.ground_m = self.position[2].copy()
        self.airborne: Bools = np.zeros(n, dtype=bool)
        self.touchdown_m_s = np.zeros(n)  # speed of the last touchdown; 0 once read
        self.crashed: Bools = np.zeros(n, dtype=bool)
        self.position_m, self.velocity_m_s = self.position.T, self.velocity.T
        self.acceleration_m_s2, self.attitude_rad = self.acceleration.T, self.attitude.T
        # estimates
        self.error = np.zeros((3, n))
        self.velocity_error = np.zeros((3, n))
        self.estimate = self.position.copy()
        self.estimate_velocity = np.zeros((3, n))
        self.estimate_m, self.estimate_velocity_m_s = self.estimate.T, self.estimate_velocity.T
        # failures
        self.motors_lost = np.zeros(n, dtype=np.int64)
        self.any_motor_lost = False
        self.exhausted: Bools = np.zeros(n, dtype=bool)  # battery empty

    def _begin_orders(self, n: int) -> None:
        self.armed: Bools = np.zeros(n, dtype=bool)
        self.armed_s = np.zeros(n)  # time on the ground since arming: a later take-off is not delayed
        self.order = np.full(n, MotionOrder.GROUNDED, dtype=np.int64)
        self.target = self.position.copy()
        self.target_m = self.target.T
        self.leg_start = self.position[:2].copy()
        self.leg_direction = np.zeros((2, n))  # unit vector, or 0 for an empty leg
        self.leg_length_m = np.zeros(n)
        self.leg_heading_rad = np.zeros(n)
        self.circle_radius_m = np.zeros(n)  # around the target, clockwise if positive; 0: a leg
        self.slope = np.zeros(n)  # for MotionOrder.GLIDE: height lost per length of the leg
        self.leg_speed_m_s = np.full(n, np.inf)  # highest speed of a copter on its leg
        self.start_jerk_m_s3 = np.full(
            n, NO_JERK_LIMIT_M_S3
        )  # mean jerk of a copter that speeds up by this order
        self.autopilot_jerk_m_s3 = np.full(n, NO_JERK_LIMIT_M_S3)  # the highest start_jerk_m_s3 of any order
        self.pass_speed_m_s = np.zeros(n)  # allowed speed at the target
        self.reached: Bools = np.zeros(n, dtype=bool)  # latched until the next target
        self.rate_m_s = np.zeros(n)  # for MotionOrder.RATE, VELOCITY, TILT and STICKS, up positive
        self.wanted_velocity = np.zeros((2, n))  # for MotionOrder.VELOCITY
        self.wanted_tilt_rad = np.zeros((2, n))  # roll and pitch that a copter turns to
        # for MotionOrder.TILT and THRUST: east, north [m/s2]
        self.wanted_thrust_acceleration = np.zeros((2, n))
        self.wanted_lift = np.zeros(n)  # for MotionOrder.THRUST: multiple of the weight
        # for MotionOrder.STICKS; pitch is the angle of climb; throttle nan: rate_m_s and speed_m_s hold
        self.wanted_bank_rad, self.wanted_pitch_rad = np.zeros(n), np.zeros(n)
        self.wanted_throttle = np.full(n, np.nan)
        self.wanted_heading_rad = np.zeros(n)
        self.wanted_yaw_rate_rad_s = np.zeros(n)  # rate of the wanted heading
        self.heading_is_commanded: Bools = np.zeros(n, dtype=bool)  # False: each new leg sets the heading

    def _begin_limits(self, n: int) -> None:
        self.speed_m_s = np.full(n, 10.0)  # plane: airspeed
        self.climb_m_s = np.full(n, 2.5)
        self.descent_m_s = np.full(n, 1.5)
        self.acceleration_limit_m_s2 = np.full(n, 2.5)
        self.vertical_acceleration_limit_m_s2 = np.full(n, 1.0)
        self.acceptance_radius_m = np.full(n, 2.0)  # of a target
        self.yaw_rate_max_rad_s = np.full(n, MAX_YAW_RATE_RAD_S)
        self.lift_off_s = np.zeros(n)  # least time from arming to the lift-off of a copter
        self.yaw_rate_limit_rad_s = np.full(n, np.inf)  # of the present turn; the maximum holds too
        self.airspeed_min_m_s = np.full(n, 10.0)
        self.airspeed_max_m_s = np.full(n, 22.0)
        self.stall_m_s = np.full(n, 8.0)  # stall speed in level flight
        self.bank_limit_rad = np.full(n, np.deg2rad(45.0))
        self.loiter_radius_m = np.full(n, 60.0)


def wrapped(angle_rad: Floats) -> Floats:
    """Return an angle wrapped into (-pi, pi] [rad]."""
    return np.asarray(angle_rad - FULL_TURN_RAD * np.ceil((angle_rad - np.pi) / FULL_TURN_RAD))
