"""The pilot's remote control of one vehicle: since when it is not heard, and which stage of a loss that is.

A loss may have two stages. What the short one did to the mode is undone when the remote control is heard
again; after the long one the mode stays.
"""

import math
from typing import TYPE_CHECKING

from sim_vehicle.epoch import EPSILON_S

if TYPE_CHECKING:
    from sim_vehicle.vehicle.autopilot import Autopilot

SHORT, LONG = "rc_short", "rc"


class RemoteWatch:
    """`update` is called whenever the vehicle decides."""

    def __init__(self, vehicle: "Autopilot") -> None:
        self._vehicle = vehicle
        self.lost = False
        self._since_s = math.inf
        self._missed = True  # whether the present loss matters
        self._stage: str | None = None
        self._long_due_s = math.inf
        self._mode_before, self._mode_then = 0, 0

    @property
    def next_s(self) -> float:
        """When the next stage comes [s]."""
        if math.isinf(self._since_s) or not self._missed or self._stage == LONG:
            return math.inf
        return self._long_due_s if self.lost else self._since_s + self._vehicle.tuning.rc_timeout_s

    def update(self, now: float) -> str | None:
        """Look; the stage that begins now. That the remote control is back is said here."""
        vehicle, tuning = self._vehicle, self._vehicle.tuning
        silent = tuning.rc_required or vehicle.afflictions.rc_lost
        if not (silent and tuning.rc_watched):
            self._heard()
            return None
        if math.isinf(self._since_s):
            self._since_s = now
            self._missed = vehicle.armed or tuning.rc_missed_unarmed
        if not self._missed or self._stage == LONG:
            return None
        if not self.lost and now + EPSILON_S >= self._since_s + tuning.rc_timeout_s:
            self.lost = True
            if tuning.rc_short_action is not None:
                self._stage, self._long_due_s = SHORT, now + tuning.rc_long_s
                return SHORT
            self._long_due_s = max(now, self._since_s + tuning.rc_long_s)
        if self.lost and now + EPSILON_S >= self._long_due_s:
            self._stage = LONG
            return LONG
        return None

    def acted(self, before: int, then: int) -> None:
        """The stage has put the vehicle from one mode into another."""
        self._mode_before, self._mode_then = before, then

    def _heard(self) -> None:
        if math.isinf(self._since_s):
            return
        was_lost, stage = self.lost, self._stage
        self.lost, self._stage = False, None
        self._since_s = self._long_due_s = math.inf
        if was_lost:
            self._vehicle.tell("rc_short_back" if stage == SHORT else "rc_back")
        modes = self._vehicle.modes
        if stage == SHORT and modes.mode.number == self._mode_then != self._mode_before:
            modes.enter(self._mode_before)
