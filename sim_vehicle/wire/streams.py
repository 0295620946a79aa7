"""Which message of which vehicle is due when: intervals of the whole fleet as one table.

Streams run on the simulation's tick, so nothing is sent more often than once a tick.
"""

import math
from collections.abc import Collection, Iterator, Mapping

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.wire.telemetry import STREAMS

IDS = tuple(STREAMS)
ROWS = {message_id: row for row, message_id in enumerate(IDS)}
HEARTBEAT, HEARTBEAT_HZ = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT), 1.0
STRIKES, STRIKES_S = int(mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT), 1.0


class Streams:
    """Intervals of n vehicles; `tick_s` [s] is the shortest that is kept."""

    def __init__(self, n: int, tick_s: float) -> None:
        self._tick_s = tick_s
        self._interval_s = np.full((len(IDS), n), np.inf)
        self._due_s = np.full((len(IDS), n), np.inf)
        self._row_due_s = np.full(len(IDS), np.inf)

    def set_interval(
        self, vehicle: int, message_id: int, interval_s: float, now: float, *, first_s: float | None = None
    ) -> None:
        """Send `message_id` every `interval_s` [s] from `now` on; 0 or less stops it. KeyError: not streamed.

        `first_s` is when the first one goes out, if not one interval from now.
        """
        row = ROWS[message_id]
        if interval_s <= 0:
            self._interval_s[row, vehicle] = self._due_s[row, vehicle] = np.inf
        else:
            interval_s = max(interval_s, self._tick_s)
            self._interval_s[row, vehicle] = interval_s
            self._due_s[row, vehicle] = now + interval_s if first_s is None else first_s
        self._row_due_s[row] = self._due_s[row].min()

    def interval_s(self, vehicle: int, message_id: int) -> float | None:
        """The interval kept [s]; None where the message does not stream. KeyError: it never could."""
        interval_s = float(self._interval_s[ROWS[message_id], vehicle])
        return None if math.isinf(interval_s) else interval_s

    def wanted(self, vehicle: int, message_id: int) -> bool:
        return bool(np.isfinite(self._interval_s[ROWS[message_id], vehicle]))

    def clear(self, vehicle: int) -> None:
        """A vehicle rebooted: nothing streams."""
        self._interval_s[:, vehicle] = self._due_s[:, vehicle] = np.inf
        self._row_due_s = self._due_s.min(axis=1)

    def due(self, now: float) -> Iterator[tuple[int, npt.NDArray[np.int64]]]:
        """(message id, vehicles) that are due by `now`; each counts as sent."""
        for row in np.flatnonzero(self._row_due_s <= now + EPSILON_S).tolist():
            due_s = self._due_s[row]
            vehicles = np.flatnonzero(due_s <= now + EPSILON_S)
            due_s[vehicles] = np.maximum(due_s[vehicles] + self._interval_s[row, vehicles], now)
            self._row_due_s[row] = due_s.min()
            yield IDS[row], vehicles


class Rates:
    """One vehicle's intervals: what its autopilot can send at a rate, and what flows without being asked."""

    def __init__(
        self,
        streams: Streams,
        vehicle: int,
        default_rates_hz: Mapping[int, float],
        unsupported: Collection[int],
    ) -> None:
        self._streams, self._vehicle, self._unsupported = streams, vehicle, unsupported
        self._usual_hz = {**default_rates_hz, HEARTBEAT: HEARTBEAT_HZ}
        self._strikes_settled = False  # they have begun since the boot, or somebody has said how often

    def can(self, message_id: int) -> bool:
        """Whether this autopilot can send a message at a rate."""
        return message_id in STREAMS and message_id not in self._unsupported

    def set(self, message_id: int, interval_s: float, now: float) -> None:
        """KeyError for a message that cannot be streamed. Whoever wants telemetry also hears of strikes."""
        self._streams.set_interval(self._vehicle, message_id, interval_s, now)
        if message_id == STRIKES:
            self._strikes_settled = True
        elif interval_s > 0 and not self._strikes_settled:
            self._strikes_settled = True
            if self.interval_s(STRIKES) is None:
                self._streams.set_interval(self._vehicle, STRIKES, STRIKES_S, now)

    def reset(self, message_id: int, now: float) -> None:
        """Back to the rate that flows without being asked for."""
        rate_hz = self._usual_hz.get(message_id, 0.0)
        self.set(message_id, 1.0 / rate_hz if rate_hz else 0.0, now)

    def interval_s(self, message_id: int) -> float | None:
        """What is kept [s]; None where it does not stream, or cannot."""
        return self._streams.interval_s(self._vehicle, message_id) if self.can(message_id) else None

    def boot(self, now: float, first_s: float) -> None:
        """Everything is forgotten but what flows by itself, from `first_s` [s] on."""
        self._streams.clear(self._vehicle)
        self._strikes_settled = False
        for message_id, rate_hz in self._usual_hz.items():
            self._streams.set_interval(self._vehicle, message_id, 1.0 / rate_hz, now, first_s=first_s)
