"""TCP: a server for several clients (tcpin), or a client that reconnects (tcpout)."""

from __future__ import annotations

import asyncio
import errno
from collections.abc import Callable

from swarmctl.links.base import TransportError
from swarmctl.links.transports.base import Address, Receive, is_readable
from swarmctl.links.url import Endpoint

_SEND_LIMIT = 1 << 16
"""length of a peer's send queue from which on further frames to this peer are dropped [bytes]"""
BACKOFF_S = (0.2, 0.5, 1.0, 2.0, 5.0)
"""pauses between attempts to connect; the last pause repeats"""
_CONNECT_LIMIT_S = 10.0


class _Connection(asyncio.Protocol):
    def __init__(
        self, receive: Receive, made: Callable[[_Connection], None], lost: Callable[[_Connection], None]
    ):
        self.address: Address = None
        self.transport: asyncio.Transport | None = None
        self.closed = asyncio.Event()
        self._receive = receive
        self._made = made
        self._lost = lost

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self.address = transport.get_extra_info("peername")
        self._made(self)

    def data_received(self, data: bytes) -> None:
        self._receive(data, self.address)

    def connection_lost(self, exc: Exception | None) -> None:
        self._lost(self)
        self.closed.set()

    def send(self, data: bytes) -> None:
        if self.transport is not None and self.transport.get_write_buffer_size() < _SEND_LIMIT:
            self.transport.write(data)

    async def close(self) -> None:
        if self.transport is not None:
            self.transport.abort()
            await self.closed.wait()


class TcpServer:
    """Server for tcpin; every client has its own address."""

    trouble = ""

    def __init__(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._server: asyncio.Server | None = None
        self._connections: dict[Address, _Connection] = {}

    async def open(self, receive: Receive) -> None:
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(
                lambda: _Connection(receive, self._made, self._lost), self._endpoint.host, self._endpoint.port
            )
        except OSError as error:
            text = f"{error.strerror or error}; check host and port"
            if error.errno == errno.EADDRINUSE:
                text = "another program has the TCP port; choose another port [port-taken]"
            raise TransportError(f"{self._endpoint}: cannot listen: {text}") from error

    def _made(self, connection: _Connection) -> None:
        self._connections[connection.address] = connection

    def _lost(self, connection: _Connection) -> None:
        self._connections.pop(connection.address, None)

    def send(self, data: bytes, address: Address) -> None:
        connection = self._connections.get(address)
        if connection is not None:
            connection.send(data)

    def peers(self) -> tuple[Address, ...]:
        return tuple(self._connections)

    @property
    def has_unread(self) -> bool:
        return any(is_readable(connection.transport) for connection in self._connections.values())

    async def close(self) -> None:
        if self._server is not None:
            self._server.close()
            for connection in list(self._connections.values()):
                await connection.close()
            await self._server.wait_closed()
            self._server = None


class TcpClient:
    """Client for tcpout; it connects, and reconnects with back-off until it is closed."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.trouble = "not connected yet"
        self._endpoint = endpoint
        self._receive: Receive | None = None
        self._connection: _Connection | None = None
        self._connecting: asyncio.Task[None] | None = None

    async def open(self, receive: Receive) -> None:
        """Begin to connect and return at once: a vehicle may start after its ground station."""
        self._receive = receive
        self._connecting = asyncio.create_task(self._connect())

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        receive = self._receive
        assert receive is not None
        attempt = 0
        while True:
            try:
                async with asyncio.timeout(_CONNECT_LIMIT_S):
                    await loop.create_connection(
                        lambda: _Connection(receive, self._made, self._lost),
                        self._endpoint.host,
                        self._endpoint.port,
                    )
            except OSError as error:  # also TimeoutError
                self.trouble = str(error.strerror or error) or "no answer to the connection attempt"
                await asyncio.sleep(BACKOFF_S[min(attempt, len(BACKOFF_S) - 1)])
                attempt += 1
            else:
                return

    def _made(self, connection: _Connection) -> None:
        # A fixed address: reconnecting does not change the vehicle's address.
        connection.address = (self._endpoint.host, self._endpoint.port)
        self._connection = connection
        self.trouble = ""

    def _lost(self, connection: _Connection) -> None:
        self._connection = None
        self.trouble = "the other side closed the connection"
        if self._receive is not None:
            self._connecting = asyncio.create_task(self._reconnect())

    async def _reconnect(self) -> None:
        await asyncio.sleep(BACKOFF_S[0])
        await self._connect()

    def send(self, data: bytes, address: Address) -> None:
        if self._connection is not None:
            self._connection.send(data)

    def peers(self) -> tuple[Address, ...]:
        return () if self._connection is None else (self._connection.address,)

    @property
    def has_unread(self) -> bool:
        return self._connection is not None and is_readable(self._connection.transport)

    async def close(self) -> None:
        self._receive = None
        if self._connecting is not None:
            self._connecting.cancel()
            await asyncio.gather(self._connecting, return_exceptions=True)
            self._connecting = None
        if self._connection is not None:
            await self._connection.close()
