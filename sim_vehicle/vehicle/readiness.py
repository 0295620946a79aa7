"""Readiness after a boot: GPS fix, home, position estimate."""

import math
from dataclasses import dataclass

from sim_vehicle.epoch import EPSILON_S

# Times after the boot [s] of a vehicle whose position estimate is ready after 41 s.
# Another time (`Readiness.ready_s`) scales all four milestones in proportion.
POSITION_S = 41.0  # position estimate
GPS_FIX_S = 10.0
HOME_S = 20.0  # home and origin
MODE_SWITCH_READ_S = 2.0  # first reading of the RC mode switch; on ArduPilot it undoes earlier mode changes
MILESTONES_S = (MODE_SWITCH_READ_S, GPS_FIX_S, HOME_S, POSITION_S)


@dataclass(frozen=True, slots=True)
class Readiness:
    """Milestones after a boot at `boot_s` [s]; the position estimate is ready `ready_s` [s] later."""

    boot_s: float
    ready_s: float

    def _passed(self, milestone_s: float, now: float) -> bool:
        return now - self.boot_s >= milestone_s * self.ready_s / POSITION_S - EPSILON_S

    def gps_fix_ready(self, now: float) -> bool:
        return self._passed(GPS_FIX_S, now)

    def home_ready(self, now: float) -> bool:
        return self._passed(HOME_S, now)

    def position_ready(self, now: float) -> bool:
        return self._passed(POSITION_S, now)

    def mode_switch_read(self, now: float) -> bool:
        return self._passed(MODE_SWITCH_READ_S, now)

    def next_s(self, now: float) -> float:
        """Return the time of the next milestone [s]; inf after the last milestone."""
        scale = self.ready_s / POSITION_S
        due_s = (self.boot_s + milestone_s * scale for milestone_s in MILESTONES_S)
        return min((s for s in due_s if s > now), default=math.inf)
