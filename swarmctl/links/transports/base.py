"""`Transport`: the interface that sends bytes to addresses and calls back with received bytes."""

from __future__ import annotations

import asyncio
import select
from collections.abc import Callable, Hashable
from typing import Protocol

Address = Hashable
"""identity of a peer for its transport, such as (host, port) or a device path"""

Receive = Callable[[bytes, Address], None]


class Transport(Protocol):
    async def open(self, receive: Receive) -> None:
        """Open the transport. Raises TransportError for a port in use or a missing device."""

    def send(self, data: bytes, address: Address) -> None:
        """Send without blocking; drop bytes that cannot be sent."""

    def peers(self) -> tuple[Address, ...]:
        """Return the addresses known without received bytes: a configured target, and connected clients."""

    @property
    def has_unread(self) -> bool:
        """Return whether received bytes wait to be read."""

    @property
    def trouble(self) -> str:
        """Return the current fault for error texts; empty if none is known."""

    async def close(self) -> None: ...


def is_readable(transport: asyncio.BaseTransport | None) -> bool:
    """Return whether the kernel has received bytes that the loop has not read from the socket yet."""
    opened = None if transport is None else transport.get_extra_info("socket")
    if opened is None or opened.fileno() < 0:
        return False
    poll = select.poll()
    poll.register(opened.fileno(), select.POLLIN)
    return bool(poll.poll(0))
