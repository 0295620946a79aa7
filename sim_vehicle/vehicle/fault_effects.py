"""Fault effects: the injected faults of one vehicle in the fleet's arrays for physics and telemetry."""

from sim_vehicle.physics.world import World
from sim_vehicle.vehicle.injected_faults import InjectedFaults
from sim_vehicle.wire.status import Status


class FaultEffectWriter:
    """Writer of the columns that faults change; call it with the vehicle's faults after each change."""

    def __init__(self, world: World, status: Status, index: int) -> None:
        self._world, self._status, self._index = world, status, index
        self._at_most, self._taken_mah = 1.0, 0.0

    def __call__(self, injected_faults: InjectedFaults, now: float) -> None:
        world, status, i = self._world, self._status, self._index
        world.gps.lost[i] = injected_faults.gps_lost
        world.gps.offset_m[i] = injected_faults.gps_offset_m
        world.batteries.sag_v[i] = injected_faults.battery_sag_v
        world.dynamics.motors_lost[i] = injected_faults.motors_lost
        status.clock_offset_s[i] = injected_faults.clock_offset_s(now)
        status.clock_since_s[i] = now
        status.clock_drift[i] = injected_faults.clock_drift_ppm * 1e-6
        self._take_charge(injected_faults.battery_at_most)
        world.events[i] = True  # wakes the autopilot

    def _take_charge(self, at_most: float) -> None:
        """Reduce the charge to `at_most` (share of the full charge); return it when the limit rises."""
        if at_most == self._at_most:
            return
        self._at_most = at_most
        batteries, i = self._world.batteries, self._index
        batteries.used_mah[i] -= self._taken_mah
        capacity_mah = float(batteries.capacity_mah[i])
        left_mah = capacity_mah - float(batteries.used_mah[i])
        self._taken_mah = max(left_mah - at_most * capacity_mah, 0.0)
        batteries.used_mah[i] += self._taken_mah
