"""GPS receivers of the fleet: a sample is the truth plus white noise, slow drift and a fault's offset."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats, LocalFrame

NO_FIX, FIX = 1, 6  # GPS_FIX_TYPE; the autopilots' own simulators report 6 for a fix
SATELLITES = 10  # with a fix
EPH_M = 1.21  # the same number serves as HDOP
DRIFT_TIME_S = 60.0  # time in which drift decays to 1/e
VERTICAL_SHARE = 1.6  # ratio of vertical to horizontal errors
SPEED_NOISE_PER_S = 0.25  # ratio of velocity noise [m/s] to position noise [m]
DRAWS = 9  # random draws per vehicle and sample


@dataclass(frozen=True, slots=True)
class GpsSettings:
    """Standard deviations along a horizontal axis [m]: white noise of each sample, and drift."""

    noise_m: float = 0.15
    drift_m: float = 0.06


class Gps:
    """The receivers of n vehicles; positions, offsets and errors are east, north, up."""

    def __init__(self, settings: GpsSettings, frame: LocalFrame, truth: Floats) -> None:
        n = truth.shape[1]
        self._frame = frame
        axes = np.array([1.0, 1.0, VERTICAL_SHARE])[:, None]
        self._noise_m, self._drift_m = settings.noise_m * axes, settings.drift_m * axes
        self.lost: npt.NDArray[np.bool_] = np.zeros(n, dtype=bool)
        self.offset_m = np.zeros((n, 3))  # injected by a fault
        self.best_fix_type = np.full(n, FIX)  # while GPS is not lost
        self.fix_type = np.full(n, FIX)
        self._drift = np.zeros((3, n))
        self._position = truth.copy()
        self.position_m: Floats = self._position.T
        self.error = np.zeros((3, n))  # of the latest sample [m]
        self.velocity_error = np.zeros((3, n))  # [m/s]
        self._geodetic: tuple[Floats, Floats] | None = None

    def begin(self, draws: Floats) -> None:
        """Start at a random drift; draws: (DRAWS, n)."""
        self._drift[:] = draws[3:6] * self._drift_m
        self.error[:] = self._drift

    def sample(self, dt_s: float, truth: Floats, draws: Floats | None) -> None:
        """Measure positions `dt_s` [s] after the previous sample.

        truth: (3, n) [m].
        draws: (DRAWS, n) standard normal draws; None: no noise and no drift.
        """
        np.copyto(self.error, self.offset_m.T)
        if draws is not None:
            decay = math.exp(-dt_s / DRIFT_TIME_S)
            self._drift *= decay
            self._drift += draws[3:6] * (self._drift_m * math.sqrt(1.0 - decay * decay))
            self.error += self._drift
            self.error += draws[:3] * self._noise_m
            np.multiply(draws[6:9], self._noise_m * SPEED_NOISE_PER_S, out=self.velocity_error)
        np.add(truth, self.error, out=self._position)
        np.copyto(self.fix_type, np.where(self.lost, NO_FIX, self.best_fix_type))
        self._geodetic = None

    def geodetic(self) -> tuple[Floats, Floats]:
        """Return latitude and longitude of the latest measurements, (n,), (n,) [deg]."""
        if self._geodetic is None:
            self._geodetic = self._frame.to_geodetic(self._position[0], self._position[1])
        return self._geodetic
