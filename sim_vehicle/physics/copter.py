"""Copter flight: arrays over the copters of the fleet; kinematic, with limits of acceleration and tilt.

A copter follows the straight leg to its target by pursuing a point ahead on the leg. Horizontal and vertical
accelerations are limited. The copter brakes in time to pass the target at the allowed speed (0 to stop). The
copter tilts to accelerate and to balance drag. The tilt is limited, so a strong wind carries the copter away.
The autopilot compensates its estimate of the wind and reacts late to gusts.
"""

import math

import numpy as np

from sim_vehicle.physics import following
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.motion import (
    FULL_TURN_RAD,
    GRAVITY_M_S2,
    NO_JERK_LIMIT_M_S3,
    Bools,
    Ints,
    Motion,
    MotionOrder,
    Selection,
    wrapped,
)

TERMINAL_FALL_M_S = 15.0
BRAKING_SHARE = 0.7  # share of the acceleration limit planned for braking; the rest corrects the path
POSITION_GAIN_HZ = 2.0  # speed per distance near a stopping point; the braking speed would oscillate there
DRAG_PER_M = 0.016  # deceleration by drag [m/s2] per square of the airspeed [m2/s2]
MAX_TILT_SLOPE = np.tan(np.deg2rad(40.0))  # horizontal thrust by lift
TILT_TIME_S = 0.15  # time constant of the attitude
SPIN_RAD_S = FULL_TURN_RAD  # yaw rate with a lost motor
SPINNING_LIMIT_M_S2 = 0.5  # horizontal acceleration limit with a lost motor
MOTOR_LOST_SINK_M_S2 = 0.3 * GRAVITY_M_S2  # vertical acceleration limit with one lost motor
HOVER_W, MASS_KG, EFFICIENCY = 172.0, 1.5, 0.6
HOVER_THROTTLE = 0.35
MAX_LEAN_RAD = math.radians(60.0)
IDLE_W = 16.0


def fly(m: Motion, i: Selection, dt_s: float) -> None:
    """Advance the velocities and attitudes of the copters `i` by `dt_s` [s]."""
    order = m.effective_order[i]
    has_thrust = m.airborne[i] & (order != MotionOrder.FALL)
    climb_error_m = m.target[2][i] - m.estimate[2][i]
    acceleration = _horizontal_acceleration(m, i, order, climb_error_m, dt_s)
    follows = (order == MotionOrder.FOLLOW) & has_thrust
    pushed = _follow(m, i, follows, dt_s) if np.count_nonzero(follows) else None
    if pushed is not None:
        np.copyto(acceleration, pushed[:2], where=follows)
    acceleration *= has_thrust
    air = m.velocity[:2, i] - m.wind.now[:, i]
    airspeed = np.hypot(air[0], air[1])
    drag = air * (airspeed * DRAG_PER_M)
    known_air = m.velocity[:2, i] - m.wind.estimate[:, i]
    known_drag = known_air * (np.hypot(known_air[0], known_air[1]) * DRAG_PER_M)
    tilt = (acceleration + known_drag) * has_thrust
    tilts = (order == MotionOrder.TILT) | (order == MotionOrder.THRUST)
    if np.count_nonzero(tilts):
        np.copyto(tilt, m.wanted_thrust_acceleration[:, i], where=tilts & has_thrust)
    climb = _climb(m, i, order, climb_error_m, dt_s)
    if pushed is not None:
        climb = np.where(follows, m.velocity[2][i] + pushed[2] * dt_s, climb)
    lift = (GRAVITY_M_S2 + (climb - m.velocity[2][i]) / dt_s) * has_thrust
    tilt_limit = MAX_TILT_SLOPE * np.maximum(lift, 0.0)
    size = np.hypot(tilt[0], tilt[1])
    if np.count_nonzero(size > tilt_limit):
        tilt *= np.minimum(1.0, tilt_limit / np.maximum(size, 1e-9))
    change = (tilt - drag) * (dt_s * m.airborne[i])
    m.velocity[:2, i] += change
    m.velocity[2][i] = climb
    m.airspeed_m_s[i] = airspeed * m.airborne[i]
    m.thrust[i] = np.sqrt(tilt[0] ** 2 + tilt[1] ** 2 + lift**2) / GRAVITY_M_S2
    _turn(m, i, tilt, lift, dt_s)


def _horizontal_acceleration(
    m: Motion, i: Selection, order: Ints, climb_error_m: Floats, dt_s: float
) -> Floats:
    """Return the acceleration toward the required velocity within the limit, (2, n) [m/s2]."""
    wanted = _pursuit(m, i, order, climb_error_m)
    moves = order == MotionOrder.VELOCITY
    if np.count_nonzero(moves):
        np.copyto(wanted, m.wanted_velocity[:, i], where=moves)
    limit, jerk = m.acceleration_limit_m_s2[i], m.start_jerk_m_s3[i]
    if np.count_nonzero(jerk < NO_JERK_LIMIT_M_S3):
        speed = np.hypot(m.estimate_velocity[0, i], m.estimate_velocity[1, i])
        growing = np.minimum(limit, np.sqrt(2.0 * jerk * speed) + jerk * dt_s)
        limit = np.where(np.hypot(wanted[0], wanted[1]) > speed, growing, limit)
    wanted -= m.estimate_velocity[:2, i]
    if m.any_motor_lost:
        limit = np.where(m.motors_lost[i] > 0, np.minimum(limit, SPINNING_LIMIT_M_S2), limit)
    wanted *= np.minimum(1.0 / dt_s, limit / np.maximum(np.hypot(wanted[0], wanted[1]), 1e-12))
    return wanted


def _follow(m: Motion, i: Selection, follows: Bools, dt_s: float) -> Floats:
    """Return the acceleration of the copters that follow a set-point, 0 of others, (3, n) [m/s2]."""
    if follows.all():
        selected, pushed = i, following.accelerate(m, i, dt_s)  # views of a slice cost less than copies
    else:
        selected, pushed = np.arange(len(m.order))[i][follows], np.zeros((3, len(follows)))
        pushed[:, follows] = following.accelerate(m, selected, dt_s)
    followed = m.follow.position_m[:, selected]
    m.target[:, selected] = np.where(np.isnan(followed), m.estimate[:, selected], followed)
    following.face_course(m, selected)
    return pushed


def _pursuit(m: Motion, i: Selection, order: Ints, climb_error_m: Floats) -> Floats:
    """Return the velocity along the leg, slow enough to stop or to pass at its end, (2, n) [m/s]."""
    here = m.estimate[:2, i]
    to_target = m.target[:2, i] - here
    distance = np.hypot(to_target[0], to_target[1])
    travelled = here - m.leg_start[:, i]
    leg = m.leg_direction[:, i]
    ahead = travelled[0] * leg[0] + travelled[1] * leg[1] + np.maximum(m.speed_m_s[i], 3.0)
    ahead = np.minimum(np.maximum(ahead, 0.0), m.leg_length_m[i])
    course: Floats = leg * ahead - travelled

    passing = m.pass_speed_m_s[i]
    braking = np.sqrt(passing**2 + (2 * BRAKING_SHARE) * m.acceleration_limit_m_s2[i] * distance)
    stopping = np.where(passing > 0, np.inf, POSITION_GAIN_HZ * distance)
    speed = np.minimum(np.minimum(np.minimum(m.speed_m_s[i], m.leg_speed_m_s[i]), braking), stopping)
    # Horizontal and vertical motion end together, so that a leg is a straight line in space.
    climb_limit = np.where(climb_error_m > 0, m.climb_m_s[i], m.descent_m_s[i])
    climb_time = np.abs(climb_error_m) / np.maximum(climb_limit, 0.1)
    coupled = (order == MotionOrder.POSITION) & (climb_time > 1.0)
    if np.count_nonzero(coupled):
        speed = np.where(coupled, np.minimum(speed, distance / np.maximum(climb_time, 1e-9)), speed)
    course *= speed / np.maximum(np.hypot(course[0], course[1]), 1e-9)
    return course


def _climb(m: Motion, i: Selection, order: Ints, error_m: Floats, dt_s: float) -> Floats:
    """Return the vertical speed after the step, (n,) [m/s]."""
    limit = m.vertical_acceleration_limit_m_s2[i]
    if m.any_motor_lost:
        limit = np.where(m.motors_lost[i] == 1, MOTOR_LOST_SINK_M_S2, limit)
    size = np.abs(error_m)
    wanted = np.minimum(np.sqrt((2 * BRAKING_SHARE) * limit * size), POSITION_GAIN_HZ * size)
    wanted = np.where(error_m > 0, np.minimum(wanted, m.climb_m_s[i]), -np.minimum(wanted, m.descent_m_s[i]))
    wanted = np.where(order == MotionOrder.POSITION, wanted, m.effective_rate_m_s[i])
    step = limit * dt_s
    change = np.minimum(np.maximum(wanted - m.velocity[2][i], -step), step)
    lifts = order == MotionOrder.THRUST
    if np.count_nonzero(lifts):
        climb = m.velocity[2][i] / TERMINAL_FALL_M_S  # the drag balances the weight in the fastest fall
        change = np.where(lifts, GRAVITY_M_S2 * (m.wanted_lift[i] - 1.0 - climb) * dt_s, change)
    falls = order == MotionOrder.FALL
    if np.count_nonzero(falls):
        change = np.where(falls, -GRAVITY_M_S2 * dt_s, change)
    return np.asarray(np.maximum(m.velocity[2][i] + change, -TERMINAL_FALL_M_S) * m.airborne[i])


def _turn(m: Motion, i: Selection, tilt: Floats, lift: Floats, dt_s: float) -> None:
    """Turn yaw toward the commanded heading, and roll and pitch toward the direction of the thrust."""
    yaw = m.attitude[2][i]
    airborne = m.airborne[i]
    if np.count_nonzero(m.wanted_yaw_rate_rad_s):
        m.wanted_heading_rad[i] += m.wanted_yaw_rate_rad_s[i] * (dt_s * airborne)
    limit = np.minimum(m.yaw_rate_limit_rad_s[i], m.yaw_rate_max_rad_s[i])
    yaw_rate = np.minimum(np.maximum(wrapped(m.wanted_heading_rad[i] - yaw) / dt_s, -limit), limit) * airborne
    if m.any_motor_lost:
        yaw_rate = np.where((m.motors_lost[i] > 0) & airborne, SPIN_RAD_S, yaw_rate)
    sin, cos = np.sin(yaw), np.cos(yaw)
    forward = tilt[0] * sin + tilt[1] * cos
    right = tilt[0] * cos - tilt[1] * sin
    up = np.maximum(lift, 1e-3)
    roll, pitch = np.arctan2(right, np.hypot(forward, up)) * airborne, -np.arctan2(forward, up) * airborne
    m.wanted_tilt_rad[0][i], m.wanted_tilt_rad[1][i] = roll, pitch
    roll_rate = (roll - m.attitude[0][i]) * (airborne / TILT_TIME_S)
    pitch_rate = (pitch - m.attitude[1][i]) * (airborne / TILT_TIME_S)
    m.attitude_rate[0][i], m.attitude_rate[1][i], m.attitude_rate[2][i] = roll_rate, pitch_rate, yaw_rate
    m.attitude[0][i] += roll_rate * dt_s
    m.attitude[1][i] += pitch_rate * dt_s
    m.attitude[2][i] = wrapped(yaw + yaw_rate * dt_s)


def load_w(m: Motion, i: Selection) -> Floats:
    """Return the electrical power of the motors, (n,) [W]: downwash, climb and drag."""
    thrust, air = m.thrust[i], m.airspeed_m_s[i]
    climb = np.maximum(m.velocity[2][i], -1.0)
    work = MASS_KG * (GRAVITY_M_S2 * climb + DRAG_PER_M * air**3) / EFFICIENCY
    flying = HOVER_W * thrust * np.sqrt(thrust) + work
    return np.asarray(np.where(m.airborne[i], np.maximum(flying, 0.0), IDLE_W) * m.armed[i])


def throttle(m: Motion, i: Selection) -> Floats:
    """Return the share of the full throttle, (n,)."""
    return np.minimum(HOVER_THROTTLE * m.thrust[i], 1.0) * m.airborne[i]


def lifts_off(m: Motion) -> Bools:
    """Return the mask of the copters on the ground that are commanded and able to climb by now, (n,)."""
    up = (m.order == MotionOrder.POSITION) & (m.target[2] > m.ground_m + 0.1)
    up |= (
        (m.order == MotionOrder.RATE) | (m.order == MotionOrder.VELOCITY) | (m.order == MotionOrder.TILT)
    ) & (m.rate_m_s > 0)
    up |= (m.order == MotionOrder.THRUST) & (m.wanted_lift > 1.0)
    rises = (m.follow.position_m[2] > m.ground_m + 0.1) | (m.follow.velocity_m_s[2] > 0)
    up |= (m.order == MotionOrder.FOLLOW) & rises
    able = ~(m.crashed | m.exhausted | m.planes | m.airborne) & (m.motors_lost == 0)
    return np.asarray(up & m.armed & able & (m.armed_s >= m.lift_off_s))


def lean_acceleration_m_s2(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float]:
    """Return the acceleration east, north of a copter that leans and keeps its height."""
    vertical_share = max(math.cos(roll_rad) * math.cos(pitch_rad), math.cos(MAX_LEAN_RAD) ** 2)
    forward = -GRAVITY_M_S2 * math.sin(pitch_rad) * math.cos(roll_rad) / vertical_share
    right = GRAVITY_M_S2 * math.sin(roll_rad) / vertical_share
    east = forward * math.sin(yaw_rad) + right * math.cos(yaw_rad)
    return east, forward * math.cos(yaw_rad) - right * math.sin(yaw_rad)
