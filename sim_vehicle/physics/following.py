"""Following of set-points: position control with feed-forward of velocity and acceleration.

The distance from the target gives a velocity, to which the velocity of the set-point is added. The difference
from that velocity gives an acceleration, to which the acceleration of the set-point is added. Acceleration
and jerk are limited.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.motion import FollowedSetpoints, Motion, MotionOrder, Selection

MAX_SPEED_M_S, MAX_ACCELERATION_M_S2 = 50.0, 30.0  # of a set-point
NO_LIMIT = 1e6  # finite, so that its products with 0 are numbers
FACING_SHARE = 0.05  # of the speed limit: a slower copter keeps its heading
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains and limits of the control in one direction."""

    position_hz: float  # velocity per distance
    velocity_hz: float  # acceleration per difference of velocity
    acceleration_m_s2: float  # without the feed-forward
    braking_m_s2: float = NO_LIMIT  # a large distance gives the velocity that this acceleration stops
    jerk_m_s3: float = NO_LIMIT
    lag_s: float = 0.0  # time constant of the acceleration


@dataclass(frozen=True, slots=True)
class Following:
    """An autopilot's control by set-points; a speed of None is the airframe's limit."""

    horizontal: Gains
    vertical: Gains
    speed_m_s: float | None = None
    climb_m_s: float | None = None
    descent_m_s: float | None = None
    limits_total: bool = False  # the speeds limit the feed-forward too, not only the velocity to the target
    target_moves: bool = False  # between two set-points the target moves on
    faces_course: bool = False  # without a yaw a copter turns into the direction of its flight


def follow(
    motion: Motion, i: int, position_m: Vector, velocity_m_s: Vector, push_m_s2: Vector, control: Following
) -> None:
    """Order copter `i` to follow a set-point, each part east, north, up; nan: this axis has none."""
    target = motion.follow
    if motion.order[i] != MotionOrder.FOLLOW:
        target.wanted_acceleration_m_s2[:, i] = motion.acceleration[:, i]
    if motion.order[i] != MotionOrder.FOLLOW or target.controls[i] is not control:
        _set_gains(target, i, control)
    target.position_m[:, i] = position_m
    target.velocity_m_s[:, i] = [_within(v, MAX_SPEED_M_S) for v in velocity_m_s]
    target.acceleration_m_s2[:, i] = [
        0.0 if math.isnan(a) else _within(a, MAX_ACCELERATION_M_S2) for a in push_m_s2
    ]
    target.speed_m_s[i] = control.speed_m_s or motion.speed_m_s[i]
    target.climb_m_s[i] = control.climb_m_s or motion.climb_m_s[i]
    target.descent_m_s[i] = control.descent_m_s or motion.descent_m_s[i]
    here_m = motion.estimate[:, i].tolist()
    motion.target[:, i] = [
        at if math.isnan(wanted) else wanted for at, wanted in zip(here_m, position_m, strict=True)
    ]
    motion.pass_speed_m_s[i] = motion.circle_radius_m[i] = 0.0
    motion.order[i], motion.reached[i] = MotionOrder.FOLLOW, False


def _set_gains(target: FollowedSetpoints, i: int, control: Following) -> None:
    """Set the gains and limits of copter `i`."""
    target.controls[i] = control
    for row, gains in enumerate((control.horizontal, control.vertical)):
        target.position_hz[row, i], target.velocity_hz[row, i] = gains.position_hz, gains.velocity_hz
        target.acceleration_limit_m_s2[row, i] = gains.acceleration_m_s2
        target.braking_m_s2[row, i] = gains.braking_m_s2
        target.jerk_limit_m_s3[row, i], target.lag_s[row, i] = gains.jerk_m_s3, gains.lag_s
    target.limits_total[i], target.target_moves[i] = control.limits_total, control.target_moves
    target.faces_course[i] = control.faces_course


def _within(value: float, limit: float) -> float:
    """Return the value clipped to the limit on both sides; nan stays nan."""
    return value if math.isnan(value) else max(-limit, min(value, limit))


def accelerate(m: Motion, i: Selection, dt_s: float) -> Floats:
    """Return the acceleration east, north, up of the copters `i`, (3, n) [m/s2]; move their targets on."""
    f = m.follow
    position, wanted, push = f.position_m[:, i], f.velocity_m_s[:, i], f.acceleration_m_s2[:, i]
    has_position, has_velocity = ~np.isnan(position), ~np.isnan(wanted)
    feed = np.where(has_velocity, wanted, 0.0)
    velocity = _total(m, i, _correction(m, i, np.where(has_position, position - m.estimate[:, i], 0.0)), feed)
    f.wanted_velocity_m_s[:, i] = velocity
    error = velocity - m.estimate_velocity[:, i]
    size, jerk = _sizes(error), f.jerk_limit_m_s3[:, i]
    change = np.minimum(_root(size, f.velocity_hz[:, i], jerk), f.acceleration_limit_m_s2[:, i])
    acceleration = error * _rows(np.minimum(change, size / dt_s) / np.maximum(size, 1e-9))
    acceleration = np.where(has_position | has_velocity, acceleration, 0.0) + push
    before = f.wanted_acceleration_m_s2[:, i]
    step = acceleration - before
    share = np.minimum(dt_s / np.maximum(f.lag_s[:, i], dt_s), jerk * dt_s / np.maximum(_sizes(step), 1e-9))
    acceleration = before + step * _rows(share)
    f.wanted_acceleration_m_s2[:, i] = acceleration
    moves = f.target_moves[i]
    if np.count_nonzero(moves):
        f.position_m[:, i] = position + np.where(moves, (feed + push * (dt_s / 2)) * dt_s, 0.0)
        f.velocity_m_s[:, i] = wanted + np.where(moves, push * dt_s, 0.0)
    return acceleration


def _sizes(vector: Floats) -> Floats:
    """Return the horizontal and the vertical size, (2, n)."""
    sizes = np.empty((2, vector.shape[1]))
    np.hypot(vector[0], vector[1], out=sizes[0])
    np.abs(vector[2], out=sizes[1])
    return sizes


def _rows(pair: Floats) -> Floats:
    """Return horizontal and vertical values, (2, n), for east, north, up, (3, n)."""
    return pair[[0, 0, 1]]


def _root(size: Floats, gain: Floats, limit: Floats) -> Floats:
    """Return `gain` times the size; for a large size the root, whose slope in time is `limit`."""
    linear = limit / gain**2
    root = np.sqrt(2 * limit * np.maximum(size - linear / 2, 0.0), where=size > linear, out=gain * size)
    return np.asarray(root)


def _correction(m: Motion, i: Selection, error: Floats) -> Floats:
    """Return the velocity toward the target within the speed limits, (3, n) [m/s]."""
    f, size = m.follow, _sizes(error)
    speed = _root(size, f.position_hz[:, i], f.braking_m_s2[:, i])
    highest = np.empty_like(size)
    highest[0], highest[1] = f.speed_m_s[i], np.where(error[2] > 0, f.climb_m_s[i], f.descent_m_s[i])
    # The flight to a resting target is a straight line in space, if the autopilot knows that it rests.
    straight = f.target_moves[i]
    if np.count_nonzero(straight):
        straight = straight & np.isnan(f.velocity_m_s[:, i]).all(axis=0)
        share = size / np.maximum(np.hypot(size[0], size[1]), 1e-9)
        along = (highest / np.maximum(share, 1e-9)).min(axis=0)
        highest = np.where(straight, along * share, highest)
    return np.asarray(error * _rows(np.minimum(speed, highest) / np.maximum(size, 1e-9)))


def _total(m: Motion, i: Selection, correction: Floats, feed: Floats) -> Floats:
    """Return the correction, and as much of the feed-forward as the speed limits allow, (3, n) [m/s]."""
    f = m.follow
    total = correction + feed
    limited = f.limits_total[i]
    if np.count_nonzero(limited):
        size = np.hypot(feed[0], feed[1])
        unit = feed[:2] / np.maximum(size, 1e-9)
        along = (unit * correction[:2]).sum(axis=0)
        room = f.speed_m_s[i] ** 2 - (correction[:2] ** 2).sum(axis=0)
        most = np.sqrt(np.maximum(along**2 + room, 0.0)) - along
        horizontal = correction[:2] + unit * np.clip(most, 0.0, size)
        vertical = np.clip(total[2], -f.descent_m_s[i], f.climb_m_s[i])
        total = np.where(limited, np.vstack([horizontal, vertical]), total)
    return np.minimum(np.maximum(total, -MAX_SPEED_M_S), MAX_SPEED_M_S)


def face_course(m: Motion, i: Selection) -> None:
    """Turn the copters that face their course into the direction of their wanted velocity."""
    east, north, _ = m.follow.wanted_velocity_m_s[:, i]
    fast = np.hypot(east, north) > FACING_SHARE * m.follow.speed_m_s[i]
    faces = m.follow.faces_course[i] & fast & ~m.heading_is_commanded[i]
    m.wanted_heading_rad[i] = np.where(faces, np.arctan2(east, north), m.wanted_heading_rad[i])
