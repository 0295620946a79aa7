"""TCP: a server for several ground stations, or a client that reconnects."""

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import Hashable

from sim_vehicle.links.base import AGAIN_S, FULL, Address, Batch, Ends, cannot_open, resolve
from sim_vehicle.links.stream import Stream
from sim_vehicle.links.url import Url

MAX_CLIENTS = 32
BACKLOG_BYTES = 1_000_000
RECONNECT_S = 0.5


class _Connections:
    """The connections of one URL."""

    def __init__(self, url: Url, ends: Ends) -> None:
        self._url, self._ends = url, ends
        self._open: dict[Stream, tuple[socket.socket, Hashable]] = {}
        self._dropped = 0  # on ended connections

    @property
    def dropped(self) -> int:
        return self._dropped + sum(stream.dropped for stream in self._open)

    def stations(self) -> int:
        return len(self._open)

    def _add(self, connected: socket.socket, peer: Hashable) -> None:
        connected.setblocking(False)
        with contextlib.suppress(OSError):  # the other end may have closed; the next read shows it
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ended(_why: str) -> None:
            self._remove(stream)
            self._ended()

        stream = Stream(
            connected.fileno(),
            connected.recv,
            connected.send,
            backlog_bytes=BACKLOG_BYTES,
            received=lambda data: self._received(data, peer),
            ended=ended,
        )
        self._open[stream] = connected, peer

    def _received(self, data: bytes, peer: Hashable) -> None:
        self._ends.received(data, peer, None)

    def _ended(self) -> None:
        """React to the end of a connection."""

    def _remove(self, stream: Stream) -> None:
        self._dropped += stream.dropped
        stream.detach()
        connected, peer = self._open.pop(stream)
        connected.close()
        self._ends.gone(peer)

    def send(self, batch: Batch) -> None:
        for stream in list(self._open):
            stream.send(batch)

    def _hang_up(self) -> None:
        for stream in list(self._open):
            self._remove(stream)


class TcpIn(_Connections):
    """A server; the reboot of the port's only vehicle closes its connections, as on SITL."""

    def __init__(self, url: Url, ends: Ends, *, alone: bool) -> None:
        super().__init__(url, ends)
        self._alone = alone
        self._server: socket.socket | None = None
        self._again: asyncio.TimerHandle | None = None
        self._said = False

    def open(self) -> None:
        family, address = resolve(self._url, socket.SOCK_STREAM)
        self._server = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._server.setblocking(False)
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(address)
            self._server.listen(MAX_CLIENTS)
        except OSError as error:
            self._server.close()
            self._server = None
            raise cannot_open(self._url, error) from error
        self._listen(self._server)

    def _listen(self, server: socket.socket) -> None:
        self._again = None
        asyncio.get_running_loop().add_reader(server, self._accept, server)

    def _accept(self, server: socket.socket) -> None:
        try:
            connected, address = server.accept()
        except OSError as error:  # the client has disconnected
            if error.errno in FULL:
                self._pause(server, error)
            return
        if len(self._open) >= MAX_CLIENTS:
            self._ends.warn(
                f"{self._url}: {MAX_CLIENTS} clients are connected; another one was refused [refused]"
            )
            connected.close()
        else:
            self._add(connected, (self._url, address))

    def _pause(self, server: socket.socket, error: OSError) -> None:
        """Stop accepting for a while; the waiting client would keep the event loop busy."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(server)
        self._again = loop.call_later(AGAIN_S, self._listen, server)
        if not self._said:
            self._said = True
            self._ends.warn(
                f"{self._url}: no more connections for now ({error.strerror or error}) [no-connections]"
            )

    def rebooted(self, index: int) -> None:
        if self._alone:
            self._hang_up()

    def close(self) -> None:
        self._hang_up()
        if self._again is not None:
            self._again.cancel()
        if self._server is not None:
            asyncio.get_running_loop().remove_reader(self._server)
            self._server.close()
            self._server = None


class TcpOut(_Connections):
    """A client that retries; it warns once of an absent server, until the server sends data."""

    def __init__(self, url: Url, ends: Ends, *, alone: bool) -> None:
        super().__init__(url, ends)
        self._alone = alone
        self._family = socket.AF_INET
        self._address: Address = ()
        self._dialling: socket.socket | None = None
        self._again: asyncio.TimerHandle | None = None
        self._said = False

    def open(self) -> None:
        self._family, self._address = resolve(self._url, socket.SOCK_STREAM)
        self._dial()

    def _dial(self) -> None:
        self._again = None
        try:
            dialling = self._dialling = socket.socket(self._family, socket.SOCK_STREAM)
        except OSError as error:
            self._failed(error.strerror or str(error))
            return
        dialling.setblocking(False)
        try:
            dialling.connect(self._address)
        except BlockingIOError:
            asyncio.get_running_loop().add_writer(dialling, self._answered, dialling)
        except OSError as error:
            self._failed(error.strerror or str(error))
        else:
            self._answered(dialling)

    def _answered(self, dialling: socket.socket) -> None:
        asyncio.get_running_loop().remove_writer(dialling)
        number = dialling.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        try:
            # On loopback a client can connect to itself.
            if not number and dialling.getsockname() == dialling.getpeername():
                number = errno.ECONNREFUSED
        except OSError as error:  # the connection has ended
            number = error.errno or errno.ENOTCONN
        if number:
            self._failed(os.strerror(number))
        else:
            self._dialling = None
            self._add(dialling, self._url)

    def _received(self, data: bytes, peer: Hashable) -> None:
        self._said = False  # not at the connection, because some servers accept and close at once
        super()._received(data, peer)

    def _failed(self, why: str) -> None:
        if self._dialling is not None:
            self._dialling.close()
            self._dialling = None
        if not self._said:
            self._said = True
            self._ends.warn(
                f"{self._url}: no server ({why}); trying again every {RECONNECT_S:g} s [no-server]"
            )
        self._later()

    def _ended(self) -> None:
        self._later()

    def _later(self) -> None:
        self._again = asyncio.get_running_loop().call_later(RECONNECT_S, self._dial)

    def rebooted(self, index: int) -> None:
        if self._alone and self._open:
            self._hang_up()
            self._later()

    def close(self) -> None:
        if self._again is not None:
            self._again.cancel()
        if self._dialling is not None:
            asyncio.get_running_loop().remove_writer(self._dialling)
            self._dialling.close()
        self._hang_up()
