"""Acceleration of a leaning copter."""

import math

from sim_vehicle.physics.motion import GRAVITY_M_S2

MAX_LEAN_RAD = math.radians(60.0)


def lean_acceleration_m_s2(roll: float, pitch: float, yaw: float) -> tuple[float, float]:
    """Return the acceleration east, north by a lean [rad] whose vertical thrust equals the weight."""
    vertical_share = max(math.cos(roll) * math.cos(pitch), math.cos(MAX_LEAN_RAD) ** 2)
    forward = -GRAVITY_M_S2 * math.sin(pitch) * math.cos(roll) / vertical_share
    right = GRAVITY_M_S2 * math.sin(roll) / vertical_share
    east = forward * math.sin(yaw) + right * math.cos(yaw)
    return east, forward * math.cos(yaw) - right * math.sin(yaw)
