"""Times of a copter's take-off, climbs and descents. Pure."""

from __future__ import annotations

import math

from swarmctl.core.vehicle import VERTICAL_ACCELERATION_M_S2

CLIMB_M_S = 2.5
"""assumed climb rate [m/s]: the default of ArduCopter's WPNAV_SPEED_UP"""
DESCENT_M_S = 1.5
"""descent rate down to `copter_trajectory.LOW_M` [m/s]: the default of ArduCopter's WPNAV_SPEED_DN"""
LIFT_S = 4.0
"""time from arming to the lift-off [s]: ArduCopter 4.6.2 and PX4 1.15.3 rise 10 cm in 3.9 to 4.1 s"""


def climb_s(rise_m: float) -> float:
    """Return the time of a climb, or of a descent with `rise_m` below 0, from level flight or a stand [s].

    The rest of a climb under way takes up to 1.25 s less.
    With LIFT_S, an ArduCopter 4.6.2 flies on from a take-off to 40 m 0.1 s after this time, a PX4 0.9 s.
    """
    rate_m_s, way_m = CLIMB_M_S if rise_m > 0.0 else DESCENT_M_S, abs(rise_m)
    if way_m < rate_m_s**2 / VERTICAL_ACCELERATION_M_S2:
        return 2.0 * math.sqrt(way_m / VERTICAL_ACCELERATION_M_S2)
    return way_m / rate_m_s + rate_m_s / VERTICAL_ACCELERATION_M_S2
