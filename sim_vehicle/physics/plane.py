"""Fixed-wing flight: arrays over the planes of the fleet; the controls are airspeed, bank and climb.

Turns are coordinated, so the rate of turn is g tan(bank) / airspeed. The velocity over the ground is the
velocity through the air plus the wind. A plane steers a course that converges to its leg or circle, corrected
for the wind. Below the stall speed a plane sinks; without power a plane glides.
"""

from dataclasses import dataclass

import numpy as np

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.motion import GRAVITY_M_S2, Bools, Ints, Motion, MotionOrder, Selection, wrapped

LOOKAHEAD_S = 2.5  # time of convergence to a leg
CIRCLE_LOOKAHEAD_S = 1.5  # time of convergence to a circle
HEADING_GAIN_HZ = 1.2
ROLL_TIME_S, ROLL_RATE_RAD_S = 0.35, 1.2
CLIMB_GAIN_HZ = 0.5  # climb rate per metre of altitude error
GLIDE_RATIO = 8.0
# airspeeds as multiples of the stall speed: in a glide, at lift-off, lowest for the full climb rate
GLIDE_OVER_STALL, ROTATE_OVER_STALL, CLIMBS_OVER_STALL = 1.3, 1.2, 1.1
GLIDE_ACCELERATION_M_S2 = 1.0  # change of airspeed in a glide
GROUND_ACCELERATION_M_S2, GROUND_BRAKING_M_S2 = 4.0, 3.0
START_THROTTLE = 0.8
# heights above the ground: wings are level below CLIMB_OUT_M at take-off and below FLARE_M at landing
CLIMB_OUT_M, FLARE_M = 15.0, 2.0
CLIMB_OUT_BELOW_M = 3.0  # the climb-out ends at this distance below the target
APPROACH_M = 20.0  # height above the ground below which a landing plane slows down
FLARE_SINK_M_S, FLARE_GAIN_HZ = 0.4, 0.4  # sink rate at touchdown, and its increase per metre of height
ATTACK_RAD = 0.05  # angle of attack at twice the stall speed
MIN_SPEED_M_S = 3.0  # lowest divisor in place of a smaller airspeed
MASS_KG, EFFICIENCY, FULL_W = 2.0, 0.5, 300.0
FULL_CLIMB_M_S = EFFICIENCY * FULL_W / (MASS_KG * GRAVITY_M_S2)  # climb rate by the full power without drag


@dataclass(slots=True)
class _PlaneState:
    """State of the planes `i` at the start of a step, each (n,)."""

    order: Ints
    airborne: Bools
    powered: Bools
    starts: Bools  # powered and commanded to climb; counts only on the ground
    sinks: Bools  # commanded to descend: RATE or GLIDE
    throttled: Bools  # powered, and the pilot sets pitch and throttle
    height_m: Floats  # above the ground
    sin_yaw: Floats
    cos_yaw: Floats


def fly(m: Motion, i: Selection, dt_s: float) -> None:
    """Advance velocities and attitudes of the planes `i` by `dt_s` [s], on the ground too."""
    state = _state_of(m, i)
    bank = _bank(m, i, state, dt_s)
    air = _airspeed(m, i, state, dt_s)
    climb = _climb(m, i, state, air, bank, dt_s)
    rolling = np.zeros_like(air)
    if not state.airborne.all():
        rolling = _ground_speed(m, i, state, dt_s)
        tailwind = m.wind.now[0][i] * state.sin_yaw + m.wind.now[1][i] * state.cos_yaw
        air = np.where(state.airborne, air, np.maximum(rolling - tailwind, 0.0))
    airspeed = np.maximum(air, MIN_SPEED_M_S)
    stall = m.stall_m_s[i]
    attack = ATTACK_RAD * (2.0 * stall / np.maximum(air, stall)) ** 2
    pitch = (np.arcsin(np.maximum(np.minimum(climb / airspeed, 1.0), -1.0)) + attack) * state.airborne
    yaw_rate = GRAVITY_M_S2 * np.tan(bank) / airspeed * state.airborne
    _turn(m, i, bank, pitch, yaw_rate, dt_s)
    _advance(m, i, state, air, climb, rolling)
    _set_power(m, i, state, air, climb, bank)


def lifts_off(m: Motion) -> Bools:
    """Return the mask of the planes on the ground that are commanded, able and fast enough to fly, (n,)."""
    fast = m.airspeed_m_s >= ROTATE_OVER_STALL * m.stall_m_s
    able = m.planes & ~(m.airborne | m.crashed | m.exhausted) & m.armed & (m.motors_lost == 0)
    return np.asarray(fast & able & _is_commanded_up(m, slice(None), m.order))


def rolls(m: Motion) -> Bools:
    """Return the mask of the planes on the ground that move, or are armed and commanded to fly, (n,)."""
    moving = (m.velocity[0] != 0) | (m.velocity[1] != 0)
    return np.asarray(m.planes & ~m.airborne & (moving | (m.armed & (m.order != MotionOrder.GROUNDED))))


def load_w(m: Motion, i: Selection) -> Floats:
    """Return the electrical power of the motor, (n,) [W]."""
    return np.asarray(m.thrust[i] * FULL_W)


def _state_of(m: Motion, i: Selection) -> _PlaneState:
    order = m.effective_order[i]
    powered = m.armed[i] & ~(m.exhausted[i] | m.crashed[i]) & (m.motors_lost[i] == 0)
    powered &= (order != MotionOrder.FALL) & (order != MotionOrder.GROUNDED)
    yaw = m.attitude[2][i]
    return _PlaneState(
        order=order,
        airborne=m.airborne[i],
        powered=powered,
        starts=powered & _is_commanded_up(m, i, order),
        throttled=powered & (order == MotionOrder.STICKS) & ~np.isnan(m.wanted_throttle[i]),
        sinks=((order == MotionOrder.RATE) & (m.effective_rate_m_s[i] < 0)) | (order == MotionOrder.GLIDE),
        height_m=m.position[2][i] - m.ground_m[i],
        sin_yaw=np.sin(yaw),
        cos_yaw=np.cos(yaw),
    )


def _is_commanded_up(m: Motion, i: Selection, order: Ints) -> Bools:
    up = (order == MotionOrder.POSITION) & (m.target[2][i] > m.ground_m[i] + 0.1)
    at_rate = (order == MotionOrder.RATE) | (order == MotionOrder.VELOCITY)
    sticks = order == MotionOrder.STICKS
    throttle = m.wanted_throttle[i]
    at_rate |= sticks & np.isnan(throttle)
    up |= sticks & (throttle >= START_THROTTLE / 2) & (m.wanted_pitch_rad[i] >= 0)
    return np.asarray(up | (at_rate & (m.effective_rate_m_s[i] > 0)))


def _bank(m: Motion, i: Selection, state: _PlaneState, dt_s: float) -> Floats:
    """Return the bank after the step toward the course, right wing down positive, (n,) [rad]."""
    air = np.maximum(m.airspeed_m_s[i], MIN_SPEED_M_S)
    course, turn = _course(m, i, state, air)
    crosswind = m.wind.estimate[0][i] * np.cos(course) - m.wind.estimate[1][i] * np.sin(course)
    heading = course - np.arcsin(np.maximum(np.minimum(crosswind / air, 1.0), -1.0))
    turn = turn + HEADING_GAIN_HZ * wrapped(heading - m.attitude[2][i])
    climbs_out = (state.order == MotionOrder.POSITION) & (state.height_m < CLIMB_OUT_M)
    climbs_out &= m.target[2][i] > m.estimate[2][i] + CLIMB_OUT_BELOW_M
    wings_level = (
        climbs_out
        | ((state.sinks | ~state.powered) & (state.height_m < FLARE_M))
        | (state.order == MotionOrder.FALL)
    )
    limit = m.bank_limit_rad[i] * ~wings_level
    wanted = np.arctan(air * turn / GRAVITY_M_S2)
    wanted = np.where(state.order == MotionOrder.STICKS, m.wanted_bank_rad[i], wanted)
    wanted = np.minimum(np.maximum(wanted, -limit), limit)
    bank = m.attitude[0][i]
    rate = np.minimum(np.maximum((wanted - bank) / ROLL_TIME_S, -ROLL_RATE_RAD_S), ROLL_RATE_RAD_S)
    return np.asarray((bank + rate * dt_s) * state.airborne)


def _course(m: Motion, i: Selection, state: _PlaneState, air: Floats) -> tuple[Floats, Floats]:
    """Return the course over the ground [rad] and its rate of change [rad/s], (n,)."""
    here = m.estimate[:2, i]
    travelled = here - m.leg_start[:, i]
    leg = m.leg_direction[:, i]
    cross_track = travelled[0] * leg[1] - travelled[1] * leg[0]  # to the right of the leg
    cross_track *= state.order != MotionOrder.VELOCITY  # a velocity order has a direction but no line
    course = m.leg_heading_rad[i] - np.arctan(cross_track / (LOOKAHEAD_S * air))
    circle = m.circle_radius_m[i]
    circles = circle != 0
    if not np.count_nonzero(circles):
        return course, np.zeros_like(course)
    from_centre = here - m.target[:2, i]
    radius = np.maximum(np.abs(circle), 1.0)
    radial_error = np.hypot(from_centre[0], from_centre[1]) - radius
    side = np.sign(circle)
    tangent = np.arctan2(from_centre[0], from_centre[1]) + side * (np.pi / 2)
    course = np.where(circles, tangent + side * np.arctan(radial_error / (CIRCLE_LOOKAHEAD_S * air)), course)
    near = np.maximum(1.0 - np.abs(radial_error) / radius, 0.0)
    velocity = m.estimate_velocity[:2, i]
    return course, side * near * np.hypot(velocity[0], velocity[1]) / radius


def _airspeed(m: Motion, i: Selection, state: _PlaneState, dt_s: float) -> Floats:
    """Return the airspeed after the step, including gusts, (n,) [m/s]."""
    air = m.airspeed_m_s[i] - (m.wind.change[0][i] * state.sin_yaw + m.wind.change[1][i] * state.cos_yaw)
    lowest, stall = m.airspeed_min_m_s[i], m.stall_m_s[i]
    wanted = np.minimum(np.maximum(m.speed_m_s[i], lowest), m.airspeed_max_m_s[i])
    lands = state.sinks & (state.height_m < APPROACH_M)
    if np.count_nonzero(lands):  # half of the headwind is added: the wind can drop
        headwind = -(m.wind.estimate[0][i] * state.sin_yaw + m.wind.estimate[1][i] * state.cos_yaw)
        approach = np.maximum(GLIDE_OVER_STALL * stall, lowest) + np.maximum(headwind, 0.0) / 2
        wanted = np.where(lands, np.minimum(wanted, approach), wanted)
    wanted = np.where(state.powered, wanted, GLIDE_OVER_STALL * stall)
    limit = np.where(state.powered, m.acceleration_limit_m_s2[i], GLIDE_ACCELERATION_M_S2) * dt_s
    change = np.minimum(np.maximum(wanted - air, -limit), limit)
    if np.count_nonzero(state.throttled):  # power that neither drag nor the climb takes
        drag = air / (GLIDE_RATIO * np.cos(m.attitude[0][i]) ** 2)
        surplus = m.wanted_throttle[i] * FULL_CLIMB_M_S - drag - m.velocity[2][i]
        surplus *= GRAVITY_M_S2 * dt_s / np.maximum(air, MIN_SPEED_M_S)
        change = np.where(state.throttled, np.minimum(surplus, m.airspeed_max_m_s[i] - air), change)
    air = np.maximum(air + change, 0.0)
    # A sinking plane below the stall speed converts height to speed.
    stalls = air < stall
    if np.count_nonzero(stalls):
        sink = np.maximum(-m.velocity[2][i], 0.0)
        air += stalls * (GRAVITY_M_S2 * dt_s) * sink / np.maximum(air, MIN_SPEED_M_S)
    return np.asarray(air)


def _climb(m: Motion, i: Selection, state: _PlaneState, air: Floats, bank: Floats, dt_s: float) -> Floats:
    """Return the vertical speed after the step, (n,) [m/s]."""
    error = m.target[2][i] - m.estimate[2][i]
    wanted = np.where(state.order == MotionOrder.POSITION, CLIMB_GAIN_HZ * error, m.effective_rate_m_s[i])
    wanted = np.where(state.throttled, air * np.sin(m.wanted_pitch_rad[i]), wanted)
    glides = state.order == MotionOrder.GLIDE
    if np.count_nonzero(glides):
        wanted = np.where(glides, _glide_path_climb(m, i), wanted)
    highest = m.climb_m_s[i]
    wanted = np.where(state.throttled, wanted, np.minimum(np.maximum(wanted, -m.descent_m_s[i]), highest))
    # No climb close to the stall speed.
    cos = np.cos(bank)
    over_stall = air * np.sqrt(cos) / m.stall_m_s[i]
    margin = np.maximum((over_stall - 1.0) / (CLIMBS_OVER_STALL - 1.0), 0.0)
    wanted = np.minimum(wanted, highest * margin)
    wanted = np.where(state.powered, wanted, np.minimum(wanted, -air / (GLIDE_RATIO * cos**2)))
    flares = (state.sinks | ~state.powered) & (state.height_m < FLARE_M)
    if np.count_nonzero(flares):
        slowest = -FLARE_SINK_M_S - FLARE_GAIN_HZ * state.height_m
        wanted = np.where(flares, np.maximum(wanted, slowest), wanted)
    climb = m.velocity[2][i]
    limit = m.vertical_acceleration_limit_m_s2[i] * dt_s
    change = np.minimum(np.maximum(wanted - climb, -limit), limit)
    stalls = over_stall < 1.0
    if np.count_nonzero(stalls):
        change = np.where(stalls, -GRAVITY_M_S2 * (1.0 - over_stall**2) * dt_s, change)
    return np.asarray((climb + change) * state.airborne)


def _glide_path_climb(m: Motion, i: Selection) -> Floats:
    """Return the vertical speed that follows the straight glide path to the target, (n,) [m/s]."""
    travelled = m.estimate[:2, i] - m.leg_start[:, i]
    leg, velocity, slope = m.leg_direction[:, i], m.estimate_velocity[:2, i], m.slope[i]
    remaining = m.leg_length_m[i] - (travelled[0] * leg[0] + travelled[1] * leg[1])
    above = m.estimate[2][i] - m.target[2][i] - slope * remaining
    return np.asarray(-slope * (velocity[0] * leg[0] + velocity[1] * leg[1]) - CLIMB_GAIN_HZ * above)


def _ground_speed(m: Motion, i: Selection, state: _PlaneState, dt_s: float) -> Floats:
    """Return the speed of planes on the ground after the step, (n,) [m/s]."""
    along = m.velocity[0][i] * state.sin_yaw + m.velocity[1][i] * state.cos_yaw
    change = np.where(state.starts, GROUND_ACCELERATION_M_S2, -GROUND_BRAKING_M_S2) * dt_s
    return np.asarray(np.maximum(along + change, 0.0))


def _turn(m: Motion, i: Selection, bank: Floats, pitch: Floats, yaw_rate: Floats, dt_s: float) -> None:
    m.attitude_rate[0][i] = (bank - m.attitude[0][i]) / dt_s
    m.attitude_rate[1][i] = (pitch - m.attitude[1][i]) / dt_s
    m.attitude_rate[2][i] = yaw_rate
    m.attitude[0][i], m.attitude[1][i] = bank, pitch
    m.attitude[2][i] = wrapped(m.attitude[2][i] + yaw_rate * dt_s)


def _advance(
    m: Motion, i: Selection, state: _PlaneState, air: Floats, climb: Floats, rolling: Floats
) -> None:
    yaw = m.attitude[2][i]
    horizontal = np.where(state.airborne, np.sqrt(np.maximum(air * air - climb * climb, 0.0)), rolling)
    m.velocity[0][i] = horizontal * np.sin(yaw) + m.wind.now[0][i] * state.airborne
    m.velocity[1][i] = horizontal * np.cos(yaw) + m.wind.now[1][i] * state.airborne
    m.velocity[2][i] = climb
    m.airspeed_m_s[i] = air


def _set_power(m: Motion, i: Selection, state: _PlaneState, air: Floats, climb: Floats, bank: Floats) -> None:
    """Set the power for the climb and for the drag, which grows with the lift in a turn."""
    drag = air / (GLIDE_RATIO * np.cos(bank) ** 2)
    share = (drag + climb) * (MASS_KG * GRAVITY_M_S2 / (EFFICIENCY * FULL_W))
    share = np.where(state.throttled, m.wanted_throttle[i], share)
    flying = np.minimum(np.maximum(share, 0.0), 1.0) * state.powered
    m.thrust[i] = np.where(state.airborne, flying, START_THROTTLE * state.starts)
