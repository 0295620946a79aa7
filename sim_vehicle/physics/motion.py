"""The state of motion of the whole fleet: what it is doing, what it may do, and what it has been told to do.

Arrays of (3, n) have east, north, up (above mean sea level) as rows, so that a step runs along contiguous
memory; the same memory seen a row a vehicle, (n, 3), has its unit in the name. A vehicle navigates by its
estimate: the truth plus the errors.
"""

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.wind import Wind

Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]
Selection = slice | npt.NDArray[np.intp]  # of vehicles: all, or some by index

GRAVITY_M_S2 = 9.80665
YAW_RATE_RAD_S = np.deg2rad(90.0)
TURN_RAD = 2.0 * np.pi


class MotionOrder:
    """What a vehicle is told to do; plain numbers, as arrays compare with an enum's members slowly."""

    GROUNDED = 0  # motors off or idling, on the ground
    POSITION = 1  # to the target: a copter stays there; a plane flies on past it, or circles around it
    RATE = 2  # climb or sink at a rate: a copter over the target's place, a plane along its leg or circle
    VELOCITY = 3  # move at a velocity; a plane flies in its direction
    GLIDE = 4  # a plane: down along the leg, to touch the ground at the target
    FALL = 5  # no thrust
    TILT = 6  # a copter: accelerate as a lean does, climb at a rate


class Motion:
    """State, limits and orders of n vehicles that start at `position_m` (n, 3); planes (n,): fixed wings."""

    def __init__(self, position_m: Floats, planes: Bools, wind: Wind) -> None:
        n = len(position_m)
        self.wind = wind
        self.planes = planes
        self.events: Bools = np.zeros(n, dtype=bool)  # something happened that an autopilot acts upon
        self._begin_state(position_m)
        self._begin_orders(n)
        self._begin_limits(n)
        # What is in force in the present step: the orders, unless a failure does not let it.
        self.acting = self.order
        self.acting_rate_m_s = self.rate_m_s

    def _begin_state(self, position_m: Floats) -> None:
        n = len(position_m)
        self.position = np.array(position_m.T, dtype=np.float64, order="C")
        self.velocity = np.zeros((3, n))
        self.acceleration = np.zeros((3, n))
        self.attitude = np.zeros((3, n))  # roll, pitch, yaw; yaw clockwise from north, in (-pi, pi]
        self.attitude_rate = np.zeros((3, n))  # of these angles
        self.airspeed_m_s = np.zeros(n)
        self.thrust = np.zeros(n)  # of a copter, in weights; of a plane, its power as a share of the most
        self.ground_m = self.position[2].copy()
        self.airborne: Bools = np.zeros(n, dtype=bool)
        self.touchdown_m_s = np.zeros(n)  # speed of the last contact, 0 once it has been read
        self.crashed: Bools = np.zeros(n, dtype=bool)
        self.position_m, self.velocity_m_s = self.position.T, self.velocity.T
        self.acceleration_m_s2, self.attitude_rad = self.acceleration.T, self.attitude.T
        # what it is taken for
        self.error = np.zeros((3, n))
        self.velocity_error = np.zeros((3, n))
        self.estimate = self.position.copy()
        self.estimate_velocity = np.zeros((3, n))
        self.estimate_m, self.estimate_velocity_m_s = self.estimate.T, self.estimate_velocity.T
        # what fails
        self.motors_lost = np.zeros(n, dtype=np.int64)
        self.any_motor_lost = False
        self.exhausted: Bools = np.zeros(n, dtype=bool)  # the battery

    def _begin_orders(self, n: int) -> None:
        self.armed: Bools = np.zeros(n, dtype=bool)
        self.order = np.full(n, MotionOrder.GROUNDED, dtype=np.int64)
        self.target = self.position.copy()
        self.target_m = self.target.T
        self.leg_start = self.position[:2].copy()
        self.leg_direction = np.zeros((2, n))  # of unit length, or 0 where the leg has none
        self.leg_length_m = np.zeros(n)
        self.leg_heading_rad = np.zeros(n)
        self.circle_m = np.zeros(n)  # radius around the target, clockwise if positive; 0: a leg
        self.slope = np.zeros(n)  # for Order.GLIDE: height lost per length of the leg
        self.pass_speed_m_s = np.zeros(n)  # speed allowed at the target
        self.reached: Bools = np.zeros(n, dtype=bool)  # latched until the next target
        self.rate_m_s = np.zeros(n)  # for Order.RATE, VELOCITY and LEAN, up positive
        self.wanted_velocity = np.zeros((2, n))  # for Order.VELOCITY
        self.wanted_tilt = np.zeros((2, n))  # for Order.LEAN: the acceleration of its thrust
        self.wanted_heading_rad = np.zeros(n)
        self.wanted_yaw_rate_rad_s = np.zeros(n)  # by which that heading goes round
        self.faces: Bools = np.zeros(n, dtype=bool)  # a heading it was told, not along the leg

    def _begin_limits(self, n: int) -> None:
        self.speed_m_s = np.full(n, 10.0)  # of a plane: the airspeed it flies at
        self.climb_m_s = np.full(n, 2.5)
        self.descent_m_s = np.full(n, 1.5)
        self.acceleration_limit_m_s2 = np.full(n, 2.5)
        self.vertical_acceleration_limit_m_s2 = np.full(n, 1.0)
        self.radius_m = np.full(n, 2.0)  # within which a target counts as reached
        self.yaw_rate_max_rad_s = np.full(n, YAW_RATE_RAD_S)
        self.yaw_rate_limit_rad_s = np.full(n, np.inf)  # of this turn, below that
        self.airspeed_min_m_s = np.full(n, 10.0)
        self.airspeed_max_m_s = np.full(n, 22.0)
        self.stall_m_s = np.full(n, 8.0)  # airspeed in level flight, below which a wing does not carry
        self.bank_limit_rad = np.full(n, np.deg2rad(45.0))
        self.loiter_radius_m = np.full(n, 60.0)


def wrapped(angle_rad: Floats) -> Floats:
    """The same angle in (-pi, pi]."""
    return np.asarray(angle_rad - TURN_RAD * np.ceil((angle_rad - np.pi) / TURN_RAD))
