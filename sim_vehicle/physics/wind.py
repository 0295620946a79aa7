"""Wind over the fleet: a steady part, and gusts that are first-order Gauss-Markov processes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.noise import Normals

GUST_TIME_S = 3.0  # time in which a gust decays to 1/e
ESTIMATE_TIME_S = 2.0  # time constant of the autopilots' wind estimates
ESTIMATE_TOLERANCE_M_S = 0.01  # largest error at which the estimates of a wind without gusts become exact


@dataclass(frozen=True, slots=True)
class WindSettings:
    """Steady wind and gusts."""

    speed_m_s: float = 0.0
    from_deg: float = 0.0  # direction of the wind's origin, clockwise from north
    gust_m_s: float = 0.0  # standard deviation along an axis


def wind_vector_m_s(speed_m_s: float, from_deg: float) -> tuple[float, float]:
    """Return the east and north components of a wind [m/s]; `from_deg`: direction of its origin."""
    return -speed_m_s * math.sin(math.radians(from_deg)), -speed_m_s * math.cos(math.radians(from_deg))


class Wind:
    """Wind at n vehicles, east and north [m/s], arrays (2, n); each vehicle has its own gusts."""

    def __init__(self, settings: WindSettings, rngs: Sequence[np.random.Generator]) -> None:
        n = len(rngs)
        self._settings = settings
        self.steady = np.zeros((2, n))
        self.steady[:] = np.array(wind_vector_m_s(settings.speed_m_s, settings.from_deg))[:, None]
        self.now = self.steady.copy()
        self.estimate = self.steady.copy()  # the autopilots' estimates
        self.change = np.zeros((2, n))  # change since the previous step
        self._gust = np.zeros((2, n))
        self._normals = Normals(rngs, 2) if settings.gust_m_s > 0 else None
        self._estimate_is_exact = True  # without gusts, a step then changes nothing

    def set_steady(self, index: int, speed_m_s: float | None, from_deg: float) -> None:
        """Set the steady wind at one vehicle; speed None: speed and direction of the settings."""
        if speed_m_s is None:
            speed_m_s, from_deg = self._settings.speed_m_s, self._settings.from_deg
        vector = wind_vector_m_s(speed_m_s, from_deg)
        if vector != tuple(self.steady[:, index].tolist()):
            self.steady[:, index] = vector
            self._estimate_is_exact = False

    def step(self, dt_s: float) -> None:
        """Advance gusts and estimates by `dt_s` [s]."""
        if self._normals is None and self._estimate_is_exact:
            return
        before = self.now.copy()
        if self._normals is not None:
            decay = math.exp(-dt_s / GUST_TIME_S)
            self._gust *= decay
            self._gust += self._normals.take() * (self._settings.gust_m_s * math.sqrt(1.0 - decay * decay))
        np.add(self.steady, self._gust, out=self.now)
        np.subtract(self.now, before, out=self.change)
        self.estimate += (self.now - self.estimate) * (1.0 - math.exp(-dt_s / ESTIMATE_TIME_S))
        if self._normals is None and np.abs(self.now - self.estimate).max() < ESTIMATE_TOLERANCE_M_S:
            self.estimate[:] = self.now
            self.change[:] = 0.0
            self._estimate_is_exact = True

    @property
    def wind_m_s(self) -> Floats:
        """Wind east, north, up at each vehicle, (n, 3) [m/s]."""
        return np.column_stack([self.now[0], self.now[1], np.zeros(self.now.shape[1])])
