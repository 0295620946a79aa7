"""UDP, as a listener (udpin) or as the first sender (udpout)."""

from __future__ import annotations

import asyncio
import errno
import socket
from typing import cast

from swarmctl.links.base import TransportError
from swarmctl.links.transports.base import Address, Receive, is_readable
from swarmctl.links.url import Endpoint

_RECEIVE_BUFFER = 1 << 20
"""size for a burst of a hundred vehicles while the loop is busy [bytes]"""
_SEND_LIMIT = 1 << 16
"""length of the send queue from which on further datagrams are dropped [bytes]"""


class Udp(asyncio.DatagramProtocol):
    """One socket without SO_REUSEADDR: a second listener on the port fails to open and takes no datagrams."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.trouble = ""
        self._endpoint = endpoint
        self._peer: Address | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._receive: Receive | None = None
        self._closed = asyncio.Event()

    async def open(self, receive: Receive) -> None:
        self._receive = receive
        loop = asyncio.get_running_loop()
        address = (self._endpoint.host, self._endpoint.port)
        try:
            if self._endpoint.kind == "udpin":
                await loop.create_datagram_endpoint(lambda: self, local_addr=address)
            else:
                found = await loop.getaddrinfo(*address, type=socket.SOCK_DGRAM)
                family, _, _, _, self._peer = found[0]
                any_address = ("::", 0) if family == socket.AF_INET6 else ("0.0.0.0", 0)
                await loop.create_datagram_endpoint(lambda: self, family=family, local_addr=any_address)
        except OSError as error:
            raise TransportError(_explain(self._endpoint, error)) from error

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # In some versions asyncio's datagram transport is no subclass of DatagramTransport.
        self._transport = cast(asyncio.DatagramTransport, transport)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        self.trouble = ""
        if self._receive is not None:
            self._receive(data, addr)

    def error_received(self, exc: Exception) -> None:
        self.trouble = str(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        self._closed.set()

    def send(self, data: bytes, address: Address) -> None:
        if self._transport is None:
            return
        # asyncio queues bytes that the socket does not accept, without a limit.
        waiting = self._transport.get_write_buffer_size()  # type: ignore[attr-defined]
        if waiting < _SEND_LIMIT:
            assert isinstance(address, tuple)
            self._transport.sendto(data, address)

    def peers(self) -> tuple[Address, ...]:
        return () if self._peer is None else (self._peer,)

    @property
    def has_unread(self) -> bool:
        return is_readable(self._transport)

    async def close(self) -> None:
        if self._transport is not None:
            self._receive = None
            self._transport.close()
            await self._closed.wait()
            self._transport = None


def _explain(endpoint: Endpoint, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return (
            f"{endpoint}: another program has UDP port {endpoint.port}; "
            "close the other ground station (or swarmctl run), or choose another port [port-taken]"
        )
    return f"{endpoint}: cannot be opened: {error.strerror or error}; check host and port"
