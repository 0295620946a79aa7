"""Legs of missions as ArduCopter 4.6 flies them in software, with default parameters (docs/measured.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

from swarmctl.core.planar import PlanarPoint

N_LEGS = 12
START_LOSS_S = 3.9
"""time lost from a stand to 10 m/s [s]"""
GUIDED_START_LOSS_S = 2.25
"""the same in GUIDED to a position, by PSC_JERK_XY and WPNAV_ACCEL (`input_pos_xyz`) [s]"""
PX4_START_LOSS_S = 2.2
"""the same of PX4 1.15.3 [s]"""


@dataclass(frozen=True)
class FlownLeg:
    """One of many equal legs, with turns to the left and to the right."""

    turn_deg: float
    length_m: float
    speed_m_s: float
    """WPNAV_SPEED"""
    duration_s: float

    @property
    def corners_m(self) -> list[PlanarPoint]:
        """The corners of N_LEGS legs, (east, north) [m]."""
        half_rad = math.radians(0.5 * self.turn_deg)
        norths_m = [0.0] + N_LEGS * [self.length_m * math.cos(half_rad)]
        easts_m = [0.0] + N_LEGS // 2 * [x * self.length_m * math.sin(half_rad) for x in (-1.0, 1.0)]
        return list(zip(accumulate(easts_m), accumulate(norths_m), strict=True))


FLOWN_LEGS = [
    FlownLeg(0.0, 25.0, 14.0, 4.85),
    FlownLeg(18.0, 25.0, 14.0, 4.85),
    FlownLeg(45.0, 25.0, 10.0, 4.85),
    FlownLeg(0.0, 50.0, 10.0, 6.1),
    FlownLeg(45.0, 50.0, 10.0, 6.9),
    FlownLeg(90.0, 50.0, 10.0, 8.0),
]
