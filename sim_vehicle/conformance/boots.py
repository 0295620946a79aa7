"""The boots of the vehicle under test: noticed by its own clock, whether asked for or not."""

from sim_vehicle.conformance.assertions import CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest

BOOTING_S = 5.0  # shortest time from a boot to the next check
PROVABLE_S = 20.0  # a vehicle that was on for this time shows a new boot by a lower time


def time_since_boot_s(vehicle: VehicleUnderTest) -> float | None:
    """Return the vehicle's time since its boot [s]; None if the vehicle does not answer."""
    try:
        return float(vehicle.request("SYSTEM_TIME").time_boot_ms) / 1000
    except (CheckFailed, Skip):
        return None


class BootWatch:
    """The vehicle's time since its boot after the latest check."""

    def __init__(self, vehicle: VehicleUnderTest) -> None:
        self._vehicle = vehicle
        self._latest_s: float | None = None

    def let_boot(self) -> bool:
        """Return True after a boot that was not seen before, and at least `BOOTING_S` after any boot.

        ArduPilot undoes mode changes before that time.
        """
        before_s, self._latest_s = self._latest_s, time_since_boot_s(self._vehicle)
        if self._latest_s is None:
            return False
        self._vehicle.wait(max(0.0, BOOTING_S - self._latest_s))
        return before_s is not None and self._latest_s < before_s
