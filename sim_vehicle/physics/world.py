"""The physics of the fleet: wind, estimates, airframes, GPS and batteries, stepped in this order."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sim_vehicle.physics import gps as receivers
from sim_vehicle.physics.dynamics import Dynamics
from sim_vehicle.physics.estimator import Estimator
from sim_vehicle.physics.geodesy import Floats, LocalFrame
from sim_vehicle.physics.gps import Gps, GpsSettings
from sim_vehicle.physics.motion import Bools
from sim_vehicle.physics.noise import Normals
from sim_vehicle.physics.wind import Wind, WindSettings

STEPS_PER_GPS_SAMPLE = 4
STEPS_PER_BATTERY_UPDATE = 2
AVIONICS_W = 7.0
RESISTANCE_OHM = 0.02
MAH_PER_A_S = 1000.0 / 3600.0
# Lithium polymer battery at rest: share of the charge -> share of the full voltage (4.2 V per cell).
CHARGE_SHARE = (0.0, 0.05, 0.1, 0.2, 0.5, 0.8, 1.0)
RESTING_VOLTAGE_SHARE = (0.714, 0.81, 0.845, 0.876, 0.905, 0.945, 1.0)
LOWEST_VOLTAGE_SHARE = 0.5  # share of the full voltage below which the current no longer increases


class Batteries:
    """The batteries of n vehicles; arrays are (n,).

    The load is a power: as the voltage falls, the current rises and the charge decreases faster.
    """

    def __init__(self, n: int) -> None:
        self.capacity_mah = np.full(n, 3300.0)
        self.full_v = np.full(n, 12.6)
        self.used_mah = np.zeros(n)
        self.used_j = np.zeros(n)
        self.sag_v = np.zeros(n)  # voltage lost by a fault
        self.current_a: Floats = AVIONICS_W / self.full_v
        self.remaining: Floats = np.ones(n)  # share of the capacity
        self.voltage_v: Floats = self.full_v - RESISTANCE_OHM * self.current_a  # under the present load

    def step(self, dt_s: float, load_w: Floats) -> None:
        """Draw `load_w` (n,) [W] and the power of the avionics for `dt_s` [s]."""
        power_w = load_w + AVIONICS_W
        self.current_a = power_w / np.maximum(self.voltage_v, LOWEST_VOLTAGE_SHARE * self.full_v)
        self.used_mah += self.current_a * (dt_s * MAH_PER_A_S)
        self.used_j += power_w * dt_s
        self.remaining = np.maximum(1.0 - self.used_mah / self.capacity_mah, 0.0)
        resting_v = self.full_v * np.interp(self.remaining, CHARGE_SHARE, RESTING_VOLTAGE_SHARE)
        self.voltage_v = np.maximum(resting_v - RESISTANCE_OHM * self.current_a - self.sag_v, 0.0)

    def empty(self) -> npt.NDArray[np.bool_]:
        """Return the mask of the empty batteries, (n,)."""
        return self.remaining <= 0.0


class World:
    """The physics of all vehicles as arrays.

    Parameters
    ----------
    frame: the local frame of the map.
    lat_deg, lon_deg, alt_amsl_m: (n,) start positions [deg, deg, m].
    planes: (n,) True for fixed wings.
    rngs: one generator per vehicle, the only source of the vehicle's noise and gusts.
    wind: steady wind and gusts.
    gps: errors of the receivers.
    """

    def __init__(
        self,
        frame: LocalFrame,
        lat_deg: Floats,
        lon_deg: Floats,
        alt_amsl_m: Floats,
        *,
        planes: Bools,
        rngs: Sequence[np.random.Generator],
        wind: WindSettings,
        gps: GpsSettings,
    ) -> None:
        streams = [rng.spawn(3) for rng in rngs]
        self.frame = frame
        east_m, north_m = frame.to_local(lat_deg, lon_deg)
        self.wind = Wind(wind, [gusts for gusts, _, _ in streams])
        start_m = np.column_stack([east_m, north_m, alt_amsl_m])
        self.dynamics = Dynamics(start_m, planes, self.wind)
        self.batteries = Batteries(len(lat_deg))
        dynamics = self.dynamics
        self.armed = dynamics.armed
        self.has_event = dynamics.has_event  # (n,), for the vehicle's autopilot
        self.estimate_m, self.estimate_velocity_m_s = dynamics.estimate_m, dynamics.estimate_velocity_m_s
        self.gps = Gps(gps, frame, dynamics.position)
        bias_draws = np.column_stack([sensors.standard_normal(2) for _, _, sensors in streams])
        self.estimator = Estimator(dynamics.error, dynamics.velocity_error, bias_draws, gps.drift_m)
        self._draws: Normals | None = None
        if gps.noise_m > 0 or gps.drift_m > 0:
            self._draws = Normals([receiver for _, receiver, _ in streams], receivers.DRAWS + 1)
            self.gps.begin(self._draws.take()[: receivers.DRAWS])
            self.estimator.begin(self.gps)
        self._steps = 0
        self._battery_s = self._gps_s = 0.0
        self._geodetic: tuple[Floats, Floats] | None = None
        self._estimated_geodetic: tuple[Floats, Floats] | None = None

    def step(self, dt_s: float) -> None:
        """Advance the physics by one tick of `dt_s` [s]."""
        self._steps += 1
        self._battery_s += dt_s
        self._gps_s += dt_s
        self._geodetic = self._estimated_geodetic = None
        self.wind.step(dt_s)
        self.estimator.predict(dt_s)
        self.dynamics.step(dt_s)
        if self._steps % STEPS_PER_GPS_SAMPLE == 0:
            self._measure()
        if self._steps % STEPS_PER_BATTERY_UPDATE == 0:
            self._draw_current()

    def _measure(self) -> None:
        gps_draws = height_draws = None
        if self._draws is not None:
            draws = self._draws.take()
            gps_draws, height_draws = draws[: receivers.DRAWS], draws[receivers.DRAWS]
        self.gps.sample(self._gps_s, self.dynamics.position, gps_draws)
        was_ok = self.estimator.position_ok
        self.estimator.correct(self._gps_s, self.gps, height_draws)
        self.has_event |= was_ok != self.estimator.position_ok
        self._gps_s = 0.0

    def _draw_current(self) -> None:
        self.batteries.step(self._battery_s, self.dynamics.load_w)
        empty = self.batteries.empty()
        self.has_event |= empty != self.dynamics.exhausted
        self.dynamics.exhausted = empty
        self._battery_s = 0.0

    @property
    def position_ok(self) -> Bools:
        """True for estimates good enough for navigation, (n,)."""
        return self.estimator.position_ok

    def geodetic(self) -> tuple[Floats, Floats]:
        """Return the true latitude and longitude of all vehicles, (n,), (n,) [deg]."""
        if self._geodetic is None:
            self._geodetic = self.frame.to_geodetic(self.dynamics.position[0], self.dynamics.position[1])
        return self._geodetic

    def estimated_geodetic(self) -> tuple[Floats, Floats]:
        """Return the estimated latitude and longitude of all vehicles, (n,), (n,) [deg]."""
        if self._estimated_geodetic is None:
            estimate = self.dynamics.estimate
            self._estimated_geodetic = self.frame.to_geodetic(estimate[0], estimate[1])
        return self._estimated_geodetic
