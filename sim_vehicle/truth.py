"""The true state of a fleet, for tests, checks and displays; telemetry contains estimates."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats


@dataclass(frozen=True, slots=True)
class Truth:
    """The true state, one entry per vehicle in the scenario's order."""

    sysid: npt.NDArray[np.int64]
    lat_deg: Floats
    lon_deg: Floats
    alt_amsl_m: Floats
    height_m: Floats  # above the ground
    speed_m_s: Floats  # horizontal
    airborne: npt.NDArray[np.bool_]
    armed: npt.NDArray[np.bool_]
    crashed: npt.NDArray[np.bool_]  # hit the ground too hard
    battery_remaining: Floats  # share, in [0, 1]
    strikes: npt.NDArray[np.int64]
    mode: tuple[str, ...]
