"""Serial port: a telemetry radio or a flight controller on USB."""

from __future__ import annotations

import asyncio

import serial

from swarmctl.links.base import TransportError
from swarmctl.links.transports.base import Address, Receive
from swarmctl.links.url import Endpoint

_BACKLOG_LIMIT = 8192
"""limit of the queue for a slow radio [bytes]; further frames are dropped"""
REOPEN_PERIOD_S = 2.0


class SerialPort:
    """Serial port on the loop's selector; an unplugged device is opened again when it returns."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.trouble = ""
        self._endpoint = endpoint
        self._port: serial.Serial | None = None
        self._receive: Receive | None = None
        self._backlog = bytearray()
        self._reopening: asyncio.TimerHandle | None = None

    async def open(self, receive: Receive) -> None:
        self._receive = receive
        try:
            self._open_port()
        except (OSError, ValueError) as error:
            raise TransportError(
                f"{self._endpoint}: cannot be opened: {error}; "
                "check the cable, the device name, the baud rate and your permission (group dialout)"
            ) from error

    def _open_port(self) -> None:
        self._port = serial.Serial(
            self._endpoint.host, self._endpoint.baud, timeout=0, write_timeout=0, exclusive=True
        )
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._on_readable)
        self.trouble = ""

    def _on_readable(self) -> None:
        if self._port is None or self._receive is None:
            return
        try:
            data = self._port.read(4096)
        except OSError as error:  # also serial.SerialException
            self._fail(error)
            return
        if data:
            self._receive(data, self._endpoint.host)

    def send(self, data: bytes, address: Address) -> None:
        if self._port is None or len(self._backlog) + len(data) > _BACKLOG_LIMIT:
            return
        self._backlog += data
        self._on_writable()

    def _on_writable(self) -> None:
        if self._port is None:
            return
        loop = asyncio.get_running_loop()
        try:
            written = self._port.write(bytes(self._backlog)) or 0
        except OSError as error:
            self._fail(error)
            return
        del self._backlog[:written]
        if self._backlog:
            loop.add_writer(self._port.fileno(), self._on_writable)
        else:
            loop.remove_writer(self._port.fileno())

    def _fail(self, error: OSError) -> None:
        self.trouble = f"the device failed: {error}"
        self._close_port()
        self._reopening = asyncio.get_running_loop().call_later(REOPEN_PERIOD_S, self._reopen)

    def _reopen(self) -> None:
        try:
            self._open_port()
        except (OSError, ValueError) as error:
            self._port = None
            self.trouble = f"the device is missing: {error}"
            self._reopening = asyncio.get_running_loop().call_later(REOPEN_PERIOD_S, self._reopen)

    def _close_port(self) -> None:
        if self._port is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._port.fileno())
            loop.remove_writer(self._port.fileno())
            self._port.close()
            self._port = None
        self._backlog.clear()

    def peers(self) -> tuple[Address, ...]:
        return (self._endpoint.host,)

    @property
    def has_unread(self) -> bool:
        return False  # only a simulator waits for unread bytes, and no simulator is on a serial line

    async def close(self) -> None:
        self._receive = None
        if self._reopening is not None:
            self._reopening.cancel()
        self._close_port()
