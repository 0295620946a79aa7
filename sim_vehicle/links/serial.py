"""A serial line: a telemetry radio, or the other end of a pseudo-terminal."""

import asyncio
import functools
import os

import serial

from sim_vehicle.links.base import RETRY_S, Batch, LinkCallbacks, LinkError
from sim_vehicle.links.stream import Stream
from sim_vehicle.links.url import Url

BACKLOG_S = 0.5  # transmission time of the longest backlog above 4096 bytes; more only delays telemetry
BITS_PER_BYTE = 10  # on the line, with start and stop bit


class SerialLink:
    """A serial device, reopened after a disconnection; frames beyond the backlog limit are dropped."""

    def __init__(self, url: Url, callbacks: LinkCallbacks) -> None:
        self._url, self._callbacks = url, callbacks
        self._dropped = 0
        self._port: serial.Serial | None = None
        self._stream: Stream | None = None
        self._retry_timer: asyncio.TimerHandle | None = None

    @property
    def dropped(self) -> int:
        return self._dropped + (self._stream.dropped if self._stream is not None else 0)

    def open(self) -> None:
        try:
            self._open()
        except (OSError, ValueError) as error:
            raise LinkError(
                f"cannot open {self._url}: {error}; check the cable, the baud rate, and the device's name "
                "and permissions (group dialout)"
            ) from error

    def _open(self) -> None:
        self._port = serial.Serial(self._url.host, self._url.port, timeout=0, write_timeout=0, exclusive=True)
        file = self._port.fileno()
        self._stream = Stream(
            file,
            functools.partial(os.read, file),
            functools.partial(os.write, file),
            backlog_bytes=max(4096, int(BACKLOG_S * self._url.port / BITS_PER_BYTE)),
            received=lambda data: self._callbacks.received(data, self._url, None),
            ended=self._ended,
        )

    def _ended(self, reason: str) -> None:
        self._callbacks.warn(
            f"{self._url}: the device is lost ({reason}); the link retries every {RETRY_S:g} s [device-lost]"
        )
        self._close()
        self._schedule_retry()

    def _schedule_retry(self) -> None:
        self._retry_timer = asyncio.get_running_loop().call_later(RETRY_S, self._reopen)

    def _reopen(self) -> None:
        try:
            self._open()
        except (OSError, ValueError):
            self._schedule_retry()
        else:
            self._callbacks.warn(f"{self._url}: the device is connected again [device-returned]")

    def send(self, batch: Batch) -> None:
        if self._stream is not None:
            self._stream.send(batch)

    def rebooted(self, index: int) -> None:
        """Do nothing: the line stays open."""

    def stations(self) -> int:
        """Return 1 for an open device, because a serial line does not show its ground stations."""
        return int(self._stream is not None)

    def _close(self) -> None:
        if self._stream is not None:
            self._dropped += self._stream.dropped
            self._stream.detach()
            self._stream = None
            self._callbacks.ended(self._url)
        if self._port is not None:
            self._port.close()
            self._port = None

    def close(self) -> None:
        if self._retry_timer is not None:
            self._retry_timer.cancel()
        self._close()
