"""Position estimates of the autopilots as arrays: a linear filter of GPS and inertial measurements.

The error of a linear filter does not depend on the motion. Only the error is stored; the estimate is the
truth plus the error. A GPS sample with a large innovation is rejected; after RESET_AFTER_S without an
accepted sample it restarts the filter, as in the autopilots. Height comes from the barometer.
"""

import math

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.gps import DRIFT_TIME_S, Gps

POSITION_GAIN, VELOCITY_GAIN = 0.05, 0.1  # per sample
GATE_M, GATE_GROWTH_M_S = 5.0, 1.0  # largest accepted innovation, and its growth without accepted samples
RESET_AFTER_S = 7.0  # time without an accepted sample, before a restart
LOST_AFTER_S = 8.0  # time without an accepted sample until the position is lost
ACCELERATION_BIAS_M_S2 = 0.03  # standard deviation; the bias acts only while no GPS sample is accepted
MAX_VELOCITY_ERROR_M_S = 5.0


class Estimator:
    """Errors of n estimates, (3, n) east, north, up: `error` [m], `velocity_error` [m/s], written in place.

    Parameters
    ----------
    bias_draws: (2, n) standard normal draws for the inertial biases.
    height_drift_m: standard deviation of the barometer's drift [m].
    """

    def __init__(
        self, error: Floats, velocity_error: Floats, bias_draws: Floats, height_drift_m: float
    ) -> None:
        n = error.shape[1]
        self._error, self._velocity_error = error, velocity_error
        self._bias = bias_draws * ACCELERATION_BIAS_M_S2
        self._height_drift_m = height_drift_m
        self.unaided_s = np.zeros(n)  # time since the last accepted sample
        self.position_ok: npt.NDArray[np.bool_] = np.ones(n, dtype=bool)
        self._any_unaided = False

    def begin(self, gps: Gps) -> None:
        """Start at the first GPS sample."""
        self._error[:2] = gps.error[:2]

    def predict(self, dt_s: float) -> None:
        """Propagate the horizontal errors over `dt_s` [s]."""
        if self._any_unaided:
            velocity_error = self._velocity_error[:2] + self._bias * (dt_s * (self.unaided_s > 0))
            self._velocity_error[:2] = velocity_error.clip(-MAX_VELOCITY_ERROR_M_S, MAX_VELOCITY_ERROR_M_S)
        self._error[:2] += self._velocity_error[:2] * dt_s

    def correct(self, dt_s: float, gps: Gps, height_draws: Floats | None) -> None:
        """Process a GPS sample `dt_s` [s] after the previous sample.

        height_draws: (n,) standard normal draws; None for an exact barometer.
        """
        innovation = gps.error[:2] - self._error[:2]
        accepted = np.hypot(innovation[0], innovation[1]) <= GATE_M + GATE_GROWTH_M_S * self.unaided_s
        accepted &= ~gps.lost
        restarts = ~(gps.lost | accepted) & (self.unaided_s >= RESET_AFTER_S)
        self._error[:2] += innovation * np.where(restarts, 1.0, accepted * POSITION_GAIN)
        difference = gps.velocity_error[:2] - self._velocity_error[:2]
        self._velocity_error[:2] += difference * np.where(restarts, 1.0, accepted * VELOCITY_GAIN)
        self.unaided_s = np.where(accepted | restarts, 0.0, self.unaided_s + dt_s)
        self._any_unaided = bool(np.count_nonzero(self.unaided_s))
        self.position_ok = self.unaided_s <= LOST_AFTER_S
        if height_draws is not None:
            decay = math.exp(-dt_s / DRIFT_TIME_S)
            self._error[2] *= decay
            self._error[2] += height_draws * (self._height_drift_m * math.sqrt(1.0 - decay * decay))
