"""Commands that take time: IN_PROGRESS with a percentage, then the result, or CANCELLED on request."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.command import Command

REPORT_INTERVAL_S = 0.5
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
IN_PROGRESS = int(mavlink.MAV_RESULT_IN_PROGRESS)
CANCELLED = 6  # MAV_RESULT_CANCELLED; missing in the dialect


@dataclass
class _Job:
    command: int
    sender: tuple[int, int]
    began_s: float
    duration_s: float
    next_report_s: float


class Jobs:
    """One long command of a vehicle at a time; `acknowledge` takes command, result, progress [%], sender."""

    def __init__(self, acknowledge: Callable[[int, int, int, tuple[int, int]], None]) -> None:
        self._acknowledge = acknowledge
        self._job: _Job | None = None

    def reset(self) -> None:
        self._job = None

    def begin(self, command: Command, duration_s: float, now: float) -> bool:
        """Start a command, which the caller acknowledges; return False if a command is running."""
        if self._job is not None:
            return False
        self._job = _Job(command.command, command.sender, now, duration_s, now + REPORT_INTERVAL_S)
        return True

    def cancel(self, message: Any) -> None:
        """Process COMMAND_CANCEL: end the running command if the message names that command."""
        job = self._job
        if job is not None and job.command == message.command:
            self._job = None
            self._acknowledge(job.command, CANCELLED, 0, job.sender)

    def tick(self, now: float) -> float:
        """Report progress or the result; return the time of the next call [s] (inf: no command runs)."""
        job = self._job
        if job is None:
            return float("inf")
        if now >= job.began_s + job.duration_s:
            self._job = None
            self._acknowledge(job.command, ACCEPTED, 100, job.sender)
            return float("inf")
        if now >= job.next_report_s:
            job.next_report_s += REPORT_INTERVAL_S
            percent = round(100 * (now - job.began_s) / job.duration_s)
            self._acknowledge(job.command, IN_PROGRESS, percent, job.sender)
        return job.next_report_s
