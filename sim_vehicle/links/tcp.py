"""TCP: a server for several ground stations, or a client that reconnects."""

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import Hashable

from sim_vehicle.links.base import RETRY_S, SHORTAGES, Address, Batch, LinkCallbacks, cannot_open, resolve
from sim_vehicle.links.stream import Stream
from sim_vehicle.links.url import Url

MAX_CLIENTS = 32
BACKLOG_BYTES = 1_000_000
RECONNECT_S = 0.5  # time between two attempts to connect


class _Connections:
    """The connections of one URL."""

    def __init__(self, url: Url, callbacks: LinkCallbacks, *, single_vehicle: bool) -> None:
        self._url, self._callbacks, self._single_vehicle = url, callbacks, single_vehicle
        self._warned = False
        self._retry_timer: asyncio.TimerHandle | None = None
        self._streams: dict[Stream, tuple[socket.socket, Hashable]] = {}
        self._dropped = 0  # chunks dropped on ended connections

    @property
    def dropped(self) -> int:
        return self._dropped + sum(stream.dropped for stream in self._streams)

    def stations(self) -> int:
        return len(self._streams)

    def _add(self, connected: socket.socket, peer: Hashable) -> None:
        connected.setblocking(False)
        with contextlib.suppress(OSError):  # the other end may have closed; the next read ends the connection
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def ended(_reason: str) -> None:
            self._remove(stream)
            self._on_peer_closed()

        stream = Stream(
            connected.fileno(),
            connected.recv,
            connected.send,
            backlog_bytes=BACKLOG_BYTES,
            received=lambda data: self._received(data, peer),
            ended=ended,
        )
        self._streams[stream] = connected, peer

    def _received(self, data: bytes, peer: Hashable) -> None:
        self._callbacks.received(data, peer, None)

    def _on_peer_closed(self) -> None:
        """React after the other end has closed a connection, or after a transfer has failed."""

    def _remove(self, stream: Stream) -> None:
        self._dropped += stream.dropped
        stream.detach()
        connected, peer = self._streams.pop(stream)
        connected.close()
        self._callbacks.ended(peer)

    def send(self, batch: Batch) -> None:
        for stream in list(self._streams):
            stream.send(batch)

    def _close_connections(self) -> None:
        for stream in list(self._streams):
            self._remove(stream)


class TcpIn(_Connections):
    """A server; as on SITL, a reboot of the port's only vehicle closes the connections."""

    def __init__(self, url: Url, callbacks: LinkCallbacks, *, single_vehicle: bool) -> None:
        super().__init__(url, callbacks, single_vehicle=single_vehicle)
        self._server: socket.socket | None = None

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
        self._retry_timer = None
        asyncio.get_running_loop().add_reader(server, self._accept, server)

    def _accept(self, server: socket.socket) -> None:
        try:
            connected, address = server.accept()
        except OSError as error:  # the client has disconnected, or a shortage
            if error.errno in SHORTAGES:
                self._pause(server, error)
            return
        if len(self._streams) >= MAX_CLIENTS:
            self._callbacks.warn(
                f"{self._url}: the link refused a client, because {MAX_CLIENTS} clients are connected; "
                "disconnect another client first [refused]"
            )
            connected.close()
        else:
            self._add(connected, (self._url, address))

    def _pause(self, server: socket.socket, error: OSError) -> None:
        """Stop accepting for `RETRY_S`, because a waiting client would keep the event loop busy."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(server)
        self._retry_timer = loop.call_later(RETRY_S, self._listen, server)
        if not self._warned:
            self._warned = True
            self._callbacks.warn(
                f"{self._url}: cannot accept connections ({error.strerror or error}); "
                f"the link retries every {RETRY_S:g} s [no-connections]"
            )

    def rebooted(self, index: int) -> None:
        if self._single_vehicle:
            self._close_connections()

    def close(self) -> None:
        self._close_connections()
        if self._retry_timer is not None:
            self._retry_timer.cancel()
        if self._server is not None:
            asyncio.get_running_loop().remove_reader(self._server)
            self._server.close()
            self._server = None


class TcpOut(_Connections):
    """A client that reconnects. After a warning, failures are silent until the server has sent data."""

    def __init__(self, url: Url, callbacks: LinkCallbacks, *, single_vehicle: bool) -> None:
        super().__init__(url, callbacks, single_vehicle=single_vehicle)
        self._family = socket.AF_INET
        self._address: Address = ()
        self._connecting: socket.socket | None = None

    def open(self) -> None:
        self._family, self._address = resolve(self._url, socket.SOCK_STREAM)
        self._connect()

    def _connect(self) -> None:
        self._retry_timer = None
        try:
            connecting = self._connecting = socket.socket(self._family, socket.SOCK_STREAM)
        except OSError as error:
            self._failed(error.strerror or str(error))
            return
        connecting.setblocking(False)
        try:
            connecting.connect(self._address)
        except BlockingIOError:
            asyncio.get_running_loop().add_writer(connecting, self._finish_connecting, connecting)
        except OSError as error:
            self._failed(error.strerror or str(error))
        else:
            self._finish_connecting(connecting)

    def _finish_connecting(self, connecting: socket.socket) -> None:
        asyncio.get_running_loop().remove_writer(connecting)
        error_number = connecting.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        try:
            # On loopback a client can connect to itself.
            if not error_number and connecting.getsockname() == connecting.getpeername():
                error_number = errno.ECONNREFUSED
        except OSError as error:  # the connection has ended
            error_number = error.errno or errno.ENOTCONN
        if error_number:
            self._failed(os.strerror(error_number))
        else:
            self._connecting = None
            self._add(connecting, self._url)

    def _received(self, data: bytes, peer: Hashable) -> None:
        self._warned = False  # only after data, because some servers accept and close at once
        super()._received(data, peer)

    def _failed(self, reason: str) -> None:
        if self._connecting is not None:
            self._connecting.close()
            self._connecting = None
        if not self._warned:
            self._warned = True
            self._callbacks.warn(
                f"{self._url}: no connection ({reason}); the link retries every {RECONNECT_S:g} s [no-server]"
            )
        self._schedule_retry()

    def _on_peer_closed(self) -> None:
        self._schedule_retry()

    def _schedule_retry(self) -> None:
        self._retry_timer = asyncio.get_running_loop().call_later(RECONNECT_S, self._connect)

    def rebooted(self, index: int) -> None:
        if self._single_vehicle and self._streams:
            self._close_connections()
            self._schedule_retry()

    def close(self) -> None:
        if self._retry_timer is not None:
            self._retry_timer.cancel()
        if self._connecting is not None:
            asyncio.get_running_loop().remove_writer(self._connecting)
            self._connecting.close()
        self._close_connections()
