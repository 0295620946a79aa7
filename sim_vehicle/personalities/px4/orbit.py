"""Orbit: a circle of a multicopter that faces the centre."""

import math

from sim_vehicle.physics.body import Body

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
