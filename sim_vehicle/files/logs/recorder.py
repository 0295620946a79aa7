"""The logs of one vehicle, one a flight; above the limit the oldest log is erased."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.files.logs.record import FlightLog, LogStart, Sample

FLEET_BYTES = 256 << 20  # total size of the logs of all vehicles
MOST_LOG_BYTES = 8 << 20
MOST_LOGS, FEWEST_LOGS = 10, 2
FULL_RATE_HZ = 10.0
SAMPLE_BYTES = 258  # size of a sample in the larger format
FLIGHT_S = 600.0  # shortest flight that must fit into a log, at a reduced rate
RESERVE = 0.05  # share of a log reserved for events after the last sample


@dataclass(frozen=True, slots=True)
class LogLimits:
    """The limits of one vehicle's logs."""

    rate_hz: float = FULL_RATE_HZ
    log_bytes: int = MOST_LOG_BYTES
    logs: int = MOST_LOGS


def limits_for(fleet_size: int) -> LogLimits:
    """Return limits for 256 MB of logs in the whole fleet; a larger fleet has fewer, shorter logs."""
    share = FLEET_BYTES // max(fleet_size, 1)
    needed = int(FLIGHT_S * FULL_RATE_HZ * SAMPLE_BYTES / (1 - RESERVE))
    logs = min(max(share // needed, FEWEST_LOGS), MOST_LOGS)
    log_bytes = min(share // logs, MOST_LOG_BYTES)
    return LogLimits(rate_hz=min(log_bytes / needed, 1.0) * FULL_RATE_HZ, log_bytes=log_bytes, logs=logs)


@dataclass(slots=True, eq=False)
class StoredLog:
    """One log file: a number from 1 since the last erasure, the UNIX times of first and last write [s]."""

    number: int
    begun_utc_s: float
    utc_s: float
    content: bytearray


class FlightRecorder:
    """The recorder of one vehicle's flights.

    Parameters
    ----------
    new_log: returns an empty log in the autopilot's format.
    limits: the limits of the logs.
    """

    def __init__(self, new_log: Callable[[], FlightLog], limits: LogLimits) -> None:
        self._new_log, self._limits = new_log, limits
        self.logs: list[StoredLog] = []
        self._log: FlightLog | None = None
        self._last_number = 0
        self._begun_s = 0.0
        self._due_s = math.inf
        self._full = False

    @property
    def enabled(self) -> bool:
        """Return True if the limits allow any log."""
        return self._limits.logs > 0

    @property
    def recording(self) -> bool:
        return self._log is not None

    def begin(self, now: float, start: LogStart) -> None:
        """End the current log and begin a new log at `now` [s]."""
        self.end(now)
        if not self.enabled:
            return
        del self.logs[: max(len(self.logs) + 1 - self._limits.logs, 0)]
        self._log = self._new_log()
        self._last_number += 1
        self._begun_s, self._due_s, self._full = now, now, False
        self.logs.append(StoredLog(self._last_number, start.utc_s, start.utc_s, self._log.content))
        self._log.begin(now, start)

    def end(self, now: float) -> None:
        """End the current log."""
        if self._log is not None:
            self._log.end(now)
            self._touch(now)
        self._log, self._due_s = None, math.inf

    def erase(self) -> None:
        """Erase all logs, including the current one."""
        self._log, self._due_s = None, math.inf
        self.logs.clear()
        self._last_number = 0

    def remove(self, log: StoredLog) -> None:
        """Erase one log, also the current log."""
        if self._log is not None and log is self.logs[-1]:
            self._log, self._due_s = None, math.inf
        self.logs.remove(log)

    def due(self, now: float) -> bool:
        """Return True if a sample is due at `now` [s]."""
        return now + EPSILON_S >= self._due_s

    def sample(self, now: float, sample: Sample) -> None:
        """Record a sample, unless `now` [s] is before the next due time."""
        log = self._log
        if log is None or now + EPSILON_S < self._due_s:
            return
        self._due_s = max(self._due_s + 1.0 / self._limits.rate_hz, now)
        if len(log.content) < self._limits.log_bytes * (1 - RESERVE):
            log.sample(now, sample)
        elif not self._full:
            self._full = True
            log.text(now, 4, "Log is full, samples stop")
        self.logs[-1].utc_s = self.logs[-1].begun_utc_s + now - self._begun_s

    def event(self, now: float) -> FlightLog | None:
        """Return the current log for an event at `now` [s]; None without a log or if the log is full."""
        if self._log is None or len(self._log.content) >= self._limits.log_bytes:
            return None
        self._touch(now)
        return self._log

    def _touch(self, now: float) -> None:
        self.logs[-1].utc_s = self.logs[-1].begun_utc_s + now - self._begun_s
