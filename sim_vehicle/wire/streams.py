"""Message intervals of the whole fleet as one table.

Streams run on the simulation's tick, so the shortest interval is one tick.
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
STRIKES, STRIKES_INTERVAL_S = int(mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT), 1.0


class Streams:
    """Intervals of n vehicles; `tick_s` [s] is the shortest interval."""

    def __init__(self, n: int, tick_s: float) -> None:
        self._tick_s = tick_s
        self._interval_s = np.full((len(IDS), n), np.inf)
        self._due_s = np.full((len(IDS), n), np.inf)
        self._row_due_s = np.full(len(IDS), np.inf)

    def set_interval(
        self, vehicle: int, message_id: int, interval_s: float, now: float, *, first_s: float | None = None
    ) -> None:
        """Send `message_id` every `interval_s` [s]; 0 or less stops the stream.

        first_s: time of the first message [s]; None: one interval after `now`.
        Raise KeyError if STREAMS lacks the message.
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
        """Return the interval [s], None for a stopped stream; raise KeyError if STREAMS lacks the message."""
        interval_s = float(self._interval_s[ROWS[message_id], vehicle])
        return None if math.isinf(interval_s) else interval_s

    def latest_s(self, vehicle: int, message_id: int) -> float | None:
        """Return the time of the latest message of a stream [s]; None if the vehicle does not stream it."""
        row = ROWS[message_id]
        interval_s = float(self._interval_s[row, vehicle])
        return None if math.isinf(interval_s) else float(self._due_s[row, vehicle]) - interval_s

    def clear(self, vehicle: int) -> None:
        """Stop all streams of a vehicle, as a reboot does."""
        self._interval_s[:, vehicle] = self._due_s[:, vehicle] = np.inf
        self._row_due_s = self._due_s.min(axis=1)

    def due(self, now: float) -> Iterator[tuple[int, npt.NDArray[np.int64]]]:
        """Yield each message id due by `now` [s] with its vehicles; schedule their next messages."""
        for row in (self._row_due_s <= now + EPSILON_S).nonzero()[0].tolist():
            due_s = self._due_s[row]
            (vehicles,) = (due_s <= now + EPSILON_S).nonzero()
            due_s[vehicles] = np.maximum(due_s[vehicles] + self._interval_s[row, vehicles], now)
            self._row_due_s[row] = due_s.min()
            yield IDS[row], vehicles


class Rates:
    """Message intervals of one vehicle, limited to the messages that its autopilot supports."""

    def __init__(
        self,
        streams: Streams,
        vehicle: int,
        default_rates_hz: Mapping[int, float],
        unsupported: Collection[int],
    ) -> None:
        self._streams, self._vehicle, self._unsupported = streams, vehicle, unsupported
        self._default_hz = {**default_rates_hz, HEARTBEAT: HEARTBEAT_HZ}
        self._strikes_configured = False  # strike messages have begun, or a ground station has set their rate

    def can_stream(self, message_id: int) -> bool:
        """Return True if this autopilot can stream a message."""
        return message_id in STREAMS and message_id not in self._unsupported

    def set(self, message_id: int, interval_s: float, now: float) -> None:
        """Set an interval [s]; the first stream set after a boot also starts the strike messages."""
        self._streams.set_interval(self._vehicle, message_id, interval_s, now)
        if message_id == STRIKES:
            self._strikes_configured = True
        elif interval_s > 0 and not self._strikes_configured:
            self._strikes_configured = True
            if self.interval_s(STRIKES) is None:
                self._streams.set_interval(self._vehicle, STRIKES, STRIKES_INTERVAL_S, now)

    def reset(self, message_id: int, now: float) -> None:
        """Set the default rate of a message."""
        rate_hz = self._default_hz.get(message_id, 0.0)
        self.set(message_id, 1.0 / rate_hz if rate_hz else 0.0, now)

    def interval_s(self, message_id: int) -> float | None:
        """Return the interval [s]; None if this vehicle does not stream the message."""
        return self._streams.interval_s(self._vehicle, message_id) if self.can_stream(message_id) else None

    def latest_s(self, message_id: int) -> float | None:
        """Return the time of the latest message of a stream [s]; None if this vehicle does not stream it."""
        return self._streams.latest_s(self._vehicle, message_id) if self.can_stream(message_id) else None

    def boot(self, now: float, first_s: float) -> None:
        """Reset to the default streams, from `first_s` [s] on."""
        self._streams.clear(self._vehicle)
        self._strikes_configured = False
        for message_id, rate_hz in self._default_hz.items():
            self._streams.set_interval(self._vehicle, message_id, 1.0 / rate_hz, now, first_s=first_s)
