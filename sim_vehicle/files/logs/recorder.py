"""The logs of one vehicle. A new log beyond the limit erases the oldest log."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.files.filesystem import GeneratedFile
from sim_vehicle.files.logs.record import FlightLog, LogStart, Sample

FLEET_BYTES = 256 << 20  # total size of the logs of all vehicles
MAX_LOG_BYTES = 8 << 20
MAX_LOGS, MIN_LOGS = 10, 2
FULL_RATE_HZ = 10.0  # highest sampling rate; small logs have a lower rate
SAMPLE_BYTES = 258  # size of a sample in ULog; a sample in DataFlash is smaller
MIN_LOG_DURATION_S = 600.0  # flight time that fits in a log; a small log has a lower sampling rate instead
RESERVED_SHARE = 0.05  # share of a log reserved for events after the last sample


@dataclass(frozen=True, slots=True)
class LogLimits:
    rate_hz: float = FULL_RATE_HZ  # sampling rate
    log_bytes: int = MAX_LOG_BYTES  # largest size of one log
    logs: int = MAX_LOGS  # largest number of logs


NO_LOGS = LogLimits(logs=0)


def limits_for(fleet_size: int) -> LogLimits:
    """Return one vehicle's limits, so that the logs of the whole fleet need at most about FLEET_BYTES."""
    vehicle_bytes = FLEET_BYTES // max(fleet_size, 1)
    full_rate_bytes = int(MIN_LOG_DURATION_S * FULL_RATE_HZ * SAMPLE_BYTES / (1 - RESERVED_SHARE))
    logs = min(max(vehicle_bytes // full_rate_bytes, MIN_LOGS), MAX_LOGS)
    log_bytes = min(vehicle_bytes // logs, MAX_LOG_BYTES)
    rate_hz = min(log_bytes / full_rate_bytes, 1.0) * FULL_RATE_HZ
    return LogLimits(rate_hz=rate_hz, log_bytes=log_bytes, logs=logs)


@dataclass(slots=True, eq=False)
class StoredLog:
    number: int  # from 1, since the last erasure of all logs
    begun_utc_s: float  # UNIX time of the first write
    utc_s: float  # UNIX time of the last write
    content: bytearray


class FlightRecorder:
    """The recorder of one vehicle's flights; `new_log` returns an empty log in the autopilot's format."""

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
        return self._limits.logs > 0

    @property
    def recording(self) -> bool:
        return self._log is not None

    def begin(self, now: float, start: LogStart) -> None:
        """End the current log and begin a new log at `now` [s], if logs are enabled."""
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
        if self._log is not None:
            self._update_time(now)
        self._log, self._due_s = None, math.inf

    def erase(self) -> None:
        """Erase all logs, even the current log."""
        self._log, self._due_s = None, math.inf
        self.logs.clear()
        self._last_number = 0

    def remove(self, log: StoredLog) -> None:
        """Erase one log, even the current log."""
        if self._log is not None and log is self.logs[-1]:
            self._log, self._due_s = None, math.inf
        self.logs.remove(log)

    def file_of(self, log: StoredLog) -> GeneratedFile:
        """Return a log as a file; its removal erases the log."""
        return GeneratedFile(
            read=lambda _query: bytes(log.content),
            size=lambda: len(log.content),
            remove=lambda: self.remove(log),
        )

    def due(self, now: float) -> bool:
        """Return True if a sample is due at `now` [s]."""
        return now + EPSILON_S >= self._due_s

    def sample(self, now: float, sample: Sample) -> None:
        """Record a sample at `now` [s] if a sample is due; a full log receives no samples."""
        log = self._log
        if log is None or now + EPSILON_S < self._due_s:
            return
        self._due_s = max(self._due_s + 1.0 / self._limits.rate_hz, now)
        if len(log.content) < self._limits.log_bytes * (1 - RESERVED_SHARE):
            log.sample(now, sample)
        elif not self._full:
            self._full = True
            log.text(now, 4, "Log is full, samples stop")
        self._update_time(now)

    def log_for_event(self, now: float) -> FlightLog | None:
        """Return the current log for an event at `now` [s], or None if the log is absent or full."""
        if self._log is None or len(self._log.content) >= self._limits.log_bytes:
            return None
        self._update_time(now)
        return self._log

    def _update_time(self, now: float) -> None:
        self.logs[-1].utc_s = self.logs[-1].begun_utc_s + now - self._begun_s
