"""Remote control failsafe of one vehicle: with `rc.short_action`, a short stage precedes the long stage.

The end of a loss undoes only the mode change of the short stage.
"""

import math

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.interface import Vehicle

SHORT, LONG = "rc_short", "rc"


class RemoteWatch:
    """The state of the remote control link."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.lost = False  # no frame for rc.timeout_s
        self._frame_s = -math.inf  # last frame from a ground station
        self._since_s = math.inf  # start of the time without frames; inf: frames arrive
        self._loss_counts = True  # the failsafe acts on the present loss
        self._stage: str | None = None  # SHORT or LONG, once begun
        self._long_due_s = math.inf
        self._mode_before, self._mode_after = 0, 0

    def receive_frame(self, now: float) -> None:
        """Process a frame from a ground station, which counts besides the frames of a receiver."""
        self._frame_s = now

    @property
    def next_s(self) -> float:
        """Time of the loss or of the next stage [s]; inf: neither is due."""
        if math.isinf(self._since_s) or not self._loss_counts or self._stage == LONG:
            return math.inf
        return self._long_due_s if self.lost else self._since_s + self._vehicle.flight_parameters.rc.timeout_s

    def update(self, now: float) -> str | None:
        """Check the link; return the stage that begins now, or None. Announce the end of a loss."""
        vehicle, parameters = self._vehicle, self._vehicle.flight_parameters.rc
        failed = parameters.failed or vehicle.injected_faults.effect.rc_lost
        only_frames = parameters.without_receiver and math.isfinite(self._frame_s)
        if not ((failed or only_frames) and parameters.watched):
            self._end_loss()
            return None
        ends_loss = self._frame_s > self._since_s
        if ends_loss:
            self._end_loss()
        if math.isinf(self._since_s):
            # A receiver that fails has sent its last frame now.
            self._since_s = self._frame_s if ends_loss or only_frames else now
            self._loss_counts = vehicle.armed or parameters.lost_unarmed_counts
        if not self._loss_counts or self._stage == LONG:
            return None
        if not self.lost and now + EPSILON_S >= self._since_s + parameters.timeout_s:
            self.lost = True
            if parameters.short_action is not None:
                self._stage, self._long_due_s = SHORT, now + parameters.long_s
                return SHORT
            self._long_due_s = max(now, self._since_s + parameters.long_s)
        if self.lost and now + EPSILON_S >= self._long_due_s:
            self._stage = LONG
            return LONG
        return None

    def record_mode_change(self, before: int, after: int) -> None:
        """Record the mode change of the short stage, by mode numbers, for the end of the loss."""
        self._mode_before, self._mode_after = before, after

    def _end_loss(self) -> None:
        if math.isinf(self._since_s):
            return
        was_lost, stage = self.lost, self._stage
        self.lost, self._stage = False, None
        self._since_s = self._long_due_s = math.inf
        if was_lost:
            self._vehicle.announce("rc_short_back" if stage == SHORT else "rc_back")
        modes = self._vehicle.modes
        if stage == SHORT and modes.mode.number == self._mode_after != self._mode_before:
            modes.enter(self._mode_before)
