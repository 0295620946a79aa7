"""Battery failsafe: the level of one vehicle's battery, and the action when the level gets worse.

Level 0 is normal; the next levels are warning (some autopilots only), low and critical. The level of an armed
vehicle never improves. A disarmed autopilot with `battery_latches` does not check the battery and keeps the
level until a reboot. Any other disarmed autopilot follows the battery; its level before arming causes no
action in flight.
"""

import math

from sim_vehicle.vehicle.flight_parameters import BatteryParameters, FailsafeAction
from sim_vehicle.vehicle.interface import Vehicle

MAX_LEVEL = 3


class BatteryWatch:
    """The latched battery level of one vehicle; call `update` at each decision of the vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.level = 0
        self._level_at_arming = 0
        self._low_since_s = [math.inf] * MAX_LEVEL

    @property
    def _parameters(self) -> BatteryParameters:
        return self._vehicle.flight_parameters.battery

    @property
    def failsafe_level(self) -> int:
        """0 none (or a warning), 1 low, 2 critical."""
        return max(self.level - len(self._parameters.levels) + 2, 0)

    def update(self, now: float) -> FailsafeAction:
        """Check the battery, announce a worse level, and return the action of that level."""
        vehicle = self._vehicle
        if vehicle.personality.failsafes.battery_latches and not vehicle.armed:
            return FailsafeAction.NOTHING
        present, before = self._present_level(now), self.level
        if not vehicle.armed:
            self.level = self._level_at_arming = present
        self.level = max(self.level, present)
        if self.level <= before:
            return FailsafeAction.NOTHING
        stage, body = self._parameters.levels[present - 1], vehicle.body
        vehicle.announce(stage.event, volts=body.voltage_v, used_mah=body.used_mah)
        return stage.action if present > self._level_at_arming else FailsafeAction.WARN

    def _present_level(self, now: float) -> int:
        """Return the present level; a low voltage counts after `delay_s`."""
        body, delay_s = self._vehicle.body, self._parameters.delay_s
        voltage_v, share = body.voltage_v, body.battery_remaining
        level = 0
        for index, stage in enumerate(self._parameters.levels):
            if not voltage_v < stage.below_v:
                self._low_since_s[index] = math.inf
            elif math.isinf(self._low_since_s[index]):
                self._low_since_s[index] = now
            if now - self._low_since_s[index] >= delay_s or share < stage.below_share:
                level = index + 1
        return level
