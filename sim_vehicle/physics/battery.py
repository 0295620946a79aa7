"""Batteries of the whole fleet as arrays: charge used, current and voltage under the load of the flight.

A motor takes power: as the voltage falls, its current rises, and so the charge goes the faster.
"""

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats

AVIONICS_W = 7.0
RESISTANCE_OHM = 0.02
MAH_PER_A_S = 1000.0 / 3600.0
# Voltage of a lithium polymer pack at rest, as a share of the full one's (4.2 V a cell), over the charge.
CHARGE_SHARE = (0.0, 0.05, 0.1, 0.2, 0.5, 0.8, 1.0)
RESTING_SHARE = (0.714, 0.81, 0.845, 0.876, 0.905, 0.945, 1.0)
LOWEST_SHARE = 0.5  # of the full voltage, below which regulators no longer draw more current


class Batteries:
    """n batteries; arrays are (n,)."""

    def __init__(self, n: int) -> None:
        self.capacity_mah = np.full(n, 3300.0)
        self.full_v = np.full(n, 12.6)
        self.used_mah = np.zeros(n)
        self.used_j = np.zeros(n)
        self.sag_v = np.zeros(n)  # missing for another reason than charge and load
        self.current_a: Floats = AVIONICS_W / self.full_v
        self.remaining: Floats = np.ones(n)  # share of the capacity that is left
        self.voltage_v: Floats = self.full_v - RESISTANCE_OHM * self.current_a  # under the present load

    def step(self, dt_s: float, load_w: Floats) -> None:
        """Draw `load_w` (n,) [W] and what the avionics need for `dt_s` [s]."""
        power_w = load_w + AVIONICS_W
        self.current_a = power_w / np.maximum(self.voltage_v, LOWEST_SHARE * self.full_v)
        self.used_mah += self.current_a * (dt_s * MAH_PER_A_S)
        self.used_j += power_w * dt_s
        self.remaining = np.maximum(1.0 - self.used_mah / self.capacity_mah, 0.0)
        resting_v = self.full_v * np.interp(self.remaining, CHARGE_SHARE, RESTING_SHARE)
        self.voltage_v = np.maximum(resting_v - RESISTANCE_OHM * self.current_a - self.sag_v, 0.0)

    def empty(self) -> npt.NDArray[np.bool_]:
        """Whether nothing is left, (n,)."""
        return self.remaining <= 0.0
