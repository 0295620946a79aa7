"""The logs of one vehicle: begun and ended by flights, the oldest erased when there are too many."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.files.logs.record import FlightLog, LogFacts, Sample

FLEET_BYTES = 256 << 20  # of the logs of all vehicles
MOST_LOG_BYTES = 8 << 20
MOST_LOGS, FEWEST_LOGS = 10, 2
FULL_RATE_HZ = 10.0
SAMPLE_BYTES = 258  # in the format that needs more
FLIGHT_S = 600.0  # what has to fit into a log, at the cost of its rate
RESERVE = 0.05  # of a log's size, kept for events when no more samples fit


@dataclass(frozen=True, slots=True)
class LogLimits:
    """How much one vehicle records."""

    rate_hz: float = FULL_RATE_HZ
    log_bytes: int = MOST_LOG_BYTES
    logs: int = MOST_LOGS


def limits_for(fleet_size: int) -> LogLimits:
    """Limits that keep the logs of a whole fleet within 256 MB: fewer, shorter, samples further apart."""
    share = FLEET_BYTES // max(fleet_size, 1)
    needed = int(FLIGHT_S * FULL_RATE_HZ * SAMPLE_BYTES / (1 - RESERVE))
    logs = min(max(share // needed, FEWEST_LOGS), MOST_LOGS)
    log_bytes = min(share // logs, MOST_LOG_BYTES)
    return LogLimits(rate_hz=min(log_bytes / needed, 1.0) * FULL_RATE_HZ, log_bytes=log_bytes, logs=logs)


@dataclass(slots=True, eq=False)
class StoredLog:
    """One log file; `number` counts from 1 since the last erasure, `utc_s` is when it was last written to."""

    number: int
    begun_utc_s: float
    utc_s: float
    content: bytearray


class FlightRecorder:
    """Writes what happens into the current log while there is one.

    Parameters
    ----------
    new_log: makes an empty log in the autopilot's format.
    limits: how much is kept.
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
        """Whether there is room for any log."""
        return self._limits.logs > 0

    @property
    def recording(self) -> bool:
        return self._log is not None

    def begin(self, now: float, facts: LogFacts) -> None:
        """A flight begins at `now` [s]; one that was being recorded ends."""
        self.end(now)
        if not self.enabled:
            return
        del self.logs[: max(len(self.logs) + 1 - self._limits.logs, 0)]
        self._log = self._new_log()
        self._last_number += 1
        self._begun_s, self._due_s, self._full = now, now, False
        self.logs.append(StoredLog(self._last_number, facts.utc_s, facts.utc_s, self._log.content))
        self._log.begin(now, facts)

    def end(self, now: float) -> None:
        """The flight is over."""
        if self._log is not None:
            self._log.end(now)
            self._touch(now)
        self._log, self._due_s = None, math.inf

    def erase(self) -> None:
        """Erase all logs; one that is being written ends here."""
        self._log, self._due_s = None, math.inf
        self.logs.clear()
        self._last_number = 0

    def remove(self, log: StoredLog) -> None:
        """Erase one log; if it is being written it ends here."""
        if self._log is not None and log is self.logs[-1]:
            self._log, self._due_s = None, math.inf
        self.logs.remove(log)

    def due(self, now: float) -> bool:
        """Whether a sample is wanted at `now` [s]; asked before one is made."""
        return now + EPSILON_S >= self._due_s

    def sample(self, now: float, sample: Sample) -> None:
        """Record the state of the vehicle; too early, and it is dropped."""
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
        """The log to tell an event at `now` [s], if one is being written and has room."""
        if self._log is None or len(self._log.content) >= self._limits.log_bytes:
            return None
        self._touch(now)
        return self._log

    def _touch(self, now: float) -> None:
        self.logs[-1].utc_s = self.logs[-1].begun_utc_s + now - self._begun_s
