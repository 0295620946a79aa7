"""Manoeuvres of a PX4 multicopter: Orbit, a circle that faces the centre, and Follow Target.

A follower keeps its place beside a target that FOLLOW_TARGET messages report. The place is at FLW_TGT_DST and
at the angle FLW_TGT_FA from the target's course; the angle changes no faster than FLW_TGT_MAX_VEL allows
(`FlightTaskAutoFollowTarget`). The messages are not filtered.
"""

import math
from typing import Any

from sim_vehicle.personalities.px4 import modes
from sim_vehicle.physics.body import Body
from sim_vehicle.vehicle.interface import Vehicle

# Follow Target
STALE_S = 3.0  # age of the last message from which the target stands still
COURSE_SPEED_M_S = 1.0  # slowest target with a course
ORBIT_ACCELERATION_M_S2 = 2.0
ALTITUDE_FIRST_M = 3.0  # altitude error from which the vehicle only climbs or sinks
LOWEST_M, ASCENT_M_S = 1.0, 0.5  # below this height above the ground the vehicle ascends
NEAREST_FACED_M = 1.0  # the vehicle does not turn to a nearer target
POSITION_GAIN_HZ = 0.95
GROUND_HEIGHT, TARGET_ALTITUDE = 1, 2  # FLW_TGT_ALT_M; 0: height above home
# Orbit
CORRECTION_PER_S = 0.5  # correction speed per distance from the circle, or from its altitude
CENTRIPETAL_M_S2 = 2.0  # largest centripetal acceleration, which limits the speed on a narrow circle
MIN_RADIUS_M, MAX_RADIUS_M = 1.0, 1000.0


class Orbit:
    """An endless circle: `update` always returns False.

    centre_m: east and north [m].
    up_m: altitude [m above mean sea level].
    radius_m: radius from 1 m to 1000 m, counter-clockwise if negative.
    """

    def __init__(
        self, body: Body, centre_m: tuple[float, float], up_m: float, radius_m: float, speed_m_s: float
    ) -> None:
        self._body, self._centre_m, self._up_m = body, centre_m, up_m
        self._radius_m = min(max(abs(radius_m), MIN_RADIUS_M), MAX_RADIUS_M)
        self._direction = -1.0 if radius_m < 0 else 1.0
        self._speed_m_s = min(speed_m_s, math.sqrt(CENTRIPETAL_M_S2 * self._radius_m))

    def update(self, _now: float) -> bool:
        east_m, north_m, up_m = self._body.position_m
        offset_m = (east_m - self._centre_m[0], north_m - self._centre_m[1])
        distance_m = math.hypot(*offset_m)
        east, north = (offset_m[0] / distance_m, offset_m[1] / distance_m) if distance_m > 0.1 else (1.0, 0.0)
        outward_m_s = self._limited((self._radius_m - distance_m) * CORRECTION_PER_S)
        # The tangential speed grows near the circle. Clockwise tangent at (east, north): (north, -east).
        nearness = max(0.0, 1.0 - abs(self._radius_m - distance_m) / self._radius_m)
        along_m_s = self._direction * self._speed_m_s * nearness
        velocity_m_s = (
            outward_m_s * east + along_m_s * north,
            outward_m_s * north - along_m_s * east,
            self._limited((self._up_m - up_m) * CORRECTION_PER_S),
        )
        self._body.move(velocity_m_s, yaw_rad=math.atan2(-east, -north))
        return False

    def _limited(self, speed_m_s: float) -> float:
        return min(max(speed_m_s, -self._speed_m_s), self._speed_m_s)


class Follow:
    """Flight beside a target: `update` always returns False."""

    def __init__(self, vehicle: Vehicle, now: float) -> None:
        self._vehicle = vehicle
        self._target_m = self._velocity_m_s = (0.0, 0.0, 0.0)  # east, north, up
        self._received_s = self._updated_s = now
        self._course_rad = self._angle_rad = self._rate_rad_s = 0.0
        vehicle.flight.limit(speed_m_s=vehicle.params["MPC_XY_VEL_MAX"])

    def receive(self, message: Any, now: float) -> None:
        east_m, north_m = self._vehicle.body.locate(message.lat * 1e-7, message.lon * 1e-7)
        north, east, down = (v if math.isfinite(v) else 0.0 for v in message.vel)
        self._target_m, self._velocity_m_s = (east_m, north_m, message.alt), (east, north, -down)
        self._received_s = now
        if math.hypot(east, north) >= COURSE_SPEED_M_S:
            self._course_rad = math.atan2(east, north)

    def update(self, now: float) -> bool:
        vehicle, body, params = self._vehicle, self._vehicle.body, self._vehicle.params
        age_s = min(now - self._received_s, STALE_S)
        target = [x + v * age_s for x, v in zip(self._target_m, self._velocity_m_s, strict=True)]
        velocity = self._velocity_m_s if age_s < STALE_S else (0.0, 0.0, 0.0)
        distance_m = max(params["FLW_TGT_DST"], 0.1)
        self._turn(distance_m, now)
        sin, cos = math.sin(self._angle_rad), math.cos(self._angle_rad)
        east_m, north_m, up_m = body.position_m
        climb_m = self._altitude_m(target[2]) - up_m
        move = [0.0, 0.0, climb_m * POSITION_GAIN_HZ]
        if up_m - body.ground_amsl_m < LOWEST_M:
            move[2] = ASCENT_M_S
        elif abs(climb_m) < ALTITUDE_FIRST_M:
            error_m = (target[0] + distance_m * sin - east_m, target[1] + distance_m * cos - north_m)
            tangential_m_s = self._rate_rad_s * distance_m
            move[0] = velocity[0] + tangential_m_s * cos + error_m[0] * POSITION_GAIN_HZ
            move[1] = velocity[1] - tangential_m_s * sin + error_m[1] * POSITION_GAIN_HZ
        away_m = (target[0] - east_m, target[1] - north_m)
        faces = math.hypot(*away_m) > NEAREST_FACED_M
        body.move((move[0], move[1], move[2]), yaw_rad=math.atan2(*away_m) if faces else None)
        vehicle.flight.guided_target_m = (target[0], target[1], up_m + climb_m)
        return False

    def _turn(self, distance_m: float, now: float) -> None:
        """Move the angle of the place on its circle toward the target's course and FLW_TGT_FA."""
        params, duration_s = self._vehicle.params, now - self._updated_s
        self._updated_s = now
        wanted_rad = self._course_rad + math.radians(params["FLW_TGT_FA"])
        rest_rad = math.remainder(wanted_rad - self._angle_rad, 2 * math.pi)
        acceleration = ORBIT_ACCELERATION_M_S2 / distance_m
        fastest = min(params["FLW_TGT_MAX_VEL"] / distance_m, math.sqrt(2 * acceleration * abs(rest_rad)))
        wanted = math.copysign(min(fastest, abs(rest_rad) / max(duration_s, 1e-3)), rest_rad)
        change = max(-acceleration * duration_s, min(wanted - self._rate_rad_s, acceleration * duration_s))
        self._rate_rad_s += change
        self._angle_rad += self._rate_rad_s * duration_s

    def _altitude_m(self, target_amsl_m: float) -> float:
        vehicle, kind = self._vehicle, int(self._vehicle.params["FLW_TGT_ALT_M"])
        reference_m = vehicle.flight.home().alt_amsl_m
        if kind == GROUND_HEIGHT:
            reference_m = vehicle.body.ground_amsl_m
        elif kind == TARGET_ALTITUDE:
            reference_m = target_amsl_m
        return float(reference_m + vehicle.params["FLW_TGT_HT"])


def on_follow_target(vehicle: Vehicle, message: Any, now: float) -> None:
    """Follow the target in the mode Follow Target; ignore the message in other modes and on the ground."""
    if vehicle.mode.number != modes.FOLLOW or not vehicle.flight.flying or vehicle.body.plane:
        return
    if abs(message.lat) > 90 * 10**7 or abs(message.lon) > 180 * 10**7 or not math.isfinite(message.alt):
        return
    follow = vehicle.flight.manoeuvre
    if not isinstance(follow, Follow):
        follow = Follow(vehicle, now)
        vehicle.flight.manoeuvre = follow
    follow.receive(message, now)
