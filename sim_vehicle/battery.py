"""Batteries of the whole fleet as arrays: charge used, current and voltage under load."""

import numpy as np
import numpy.typing as npt

from sim_vehicle.geodesy import Floats

IDLE_A = 0.6  # avionics
ARMED_A = 2.0  # motors idling on the ground
HOVER_A = 15.0
CLIMB_A_PER_M_S = 3.0
DRAG_A_PER_M2_S2 = 0.02  # current that grows with the square of the horizontal speed
RESISTANCE_OHM = 0.02
MAH_PER_A_S = 1000.0 / 3600.0


class Batteries:
    """n batteries; a lithium pack whose resting voltage falls slowly, and steeply in its last tenth."""

    def __init__(self, n: int) -> None:
        self.capacity_mah = np.full(n, 3300.0)
        self.full_v = np.full(n, 12.6)
        self.used_mah = np.zeros(n)
        self.current_a = np.full(n, IDLE_A)
        self.remaining: Floats = np.ones(n)  # share of the capacity that is left
        self.voltage_v: Floats = self.full_v.copy()  # under the present load

    def step(
        self,
        dt_s: float,
        armed: npt.NDArray[np.bool_],
        airborne: npt.NDArray[np.bool_],
        velocity_m_s: Floats,
    ) -> None:
        """Draw the current of this step: armed (n,), airborne (n,), velocity (n, 3) [m/s]."""
        speed_squared = velocity_m_s[:, 0] ** 2 + velocity_m_s[:, 1] ** 2
        flying = (
            HOVER_A + CLIMB_A_PER_M_S * velocity_m_s[:, 2].clip(min=-1.0) + DRAG_A_PER_M2_S2 * speed_squared
        )
        self.current_a = IDLE_A + np.where(armed, np.where(airborne, flying, ARMED_A), 0.0)
        self.used_mah += self.current_a * dt_s * MAH_PER_A_S
        left = np.clip(1.0 - self.used_mah / np.maximum(self.capacity_mah, 1.0), 0.0, 1.0)
        resting = self.full_v * (0.88 + 0.12 * left - 0.12 * np.clip(1.0 - left / 0.1, 0.0, 1.0))
        self.remaining, self.voltage_v = left, resting - RESISTANCE_OHM * self.current_a

    def empty(self) -> npt.NDArray[np.bool_]:
        """Whether nothing is left, (n,)."""
        return self.remaining <= 0
