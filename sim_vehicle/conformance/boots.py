"""The clock of the vehicle under test: its pace, and reboots that the suite did not ask for."""

from sim_vehicle.conformance.assertions import CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest

BOOTING_S = 5.0  # shortest time from a boot to the next check
MIN_UPTIME_S = 20.0  # shortest time since the boot before a reboot; a lower time afterwards proves it
PACE_S = 2.0  # shortest time for a measurement of the pace


def time_since_boot_s(vehicle: VehicleUnderTest) -> float | None:
    """Return the vehicle's time since its boot [s]; None if the vehicle does not answer."""
    try:
        return float(vehicle.request("SYSTEM_TIME").time_boot_ms) / 1000
    except (CheckFailed, Skip):
        return None


class BootWatch:
    """Reboots between checks, and the pace of the vehicle's clock, by its time since boot."""

    def __init__(self, vehicle: VehicleUnderTest) -> None:
        self._vehicle = vehicle
        self._latest_s: float | None = None
        self._pace_from: tuple[float, float] | None = None  # vehicle's time since boot, time of the wire [s]

    def let_boot(self) -> bool:
        """Wait until `BOOTING_S` after a boot; return True for a reboot since the previous call.

        ArduPilot undoes earlier mode changes.
        """
        before_s, self._latest_s = self._latest_s, time_since_boot_s(self._vehicle)
        if self._latest_s is None:
            return False
        rebooted = before_s is not None and self._latest_s < before_s
        self._measure_pace(self._latest_s, rebooted=rebooted)
        self._vehicle.wait(max(0.0, BOOTING_S - self._latest_s))
        return rebooted

    def _measure_pace(self, boot_s: float, *, rebooted: bool) -> None:
        """Set the pace of the vehicle's clock since the previous measurement."""
        wire_s = self._vehicle.wire_s
        if self._pace_from is None or rebooted:
            self._pace_from = boot_s, wire_s
            return
        passed_s = wire_s - self._pace_from[1]
        if passed_s >= PACE_S:
            self._vehicle.set_pace((boot_s - self._pace_from[0]) / passed_s)
            self._pace_from = boot_s, wire_s
